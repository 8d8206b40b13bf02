"""From candidate points to a calibration: the geometry chooses, at most one candidate an image and needle.

A wrong candidate agrees with no calibration that many images share. So fit the best-ranked candidates, see which
candidate of each image lies near its needle, and fit those again: consensus over candidates. Choosing needs transforms
only; what was chosen is calibrated once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, Unpack

import numpy as np

from sonocal.calibration import Calibration, LabelledDots, calibrate
from sonocal.calibration.options import Keywords as CalibrationKeywords
from sonocal.calibration.options import Options
from sonocal.errors import (
    DegenerateGeometryError,
    InputError,
    MirroredVolumeError,
    NoConsensusError,
    SonocalError,
    require,
)
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, AxisScaled
from sonocal.geometry.cards import card
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.registration import Association
from sonocal.sweep.agreeing import ENOUGH, Agreeing
from sonocal.sweep.candidates import Candidates, Mask
from sonocal.sweep.labels import ADVICE, label_findings, labelled_dots, labels_of, unsure_in_words, widened_mm
from sonocal.sweep.options import of_calibrate, refuse_splits
from sonocal.sweep.settled import settled_at, upper_of_two
from sonocal.sweep.slice_noise import ASLANT, calibrated_across
from sonocal.sweep.twin import twin_findings

__all__ = ["CandidateCalibration", "LookAgain", "calibrate_candidates", "calibrate_chosen"]

RANKS = (1, 2, 3, 5, 1000)
SURE = 0.9
"""Share from which not even the next is: an echo of the needle brighter than itself is in half of the images."""
LEAST_SIGHTINGS = 10
LEAST_SHARE_OF_FEW = 0.8
"""Where there are few images."""
MOST_MM = 5.0
"""Where the noise is to tell how far a chosen row may be from its line."""

LookAgain = Callable[[AxisScaled, Observations, float], Observations | None]
"""A transform, the candidates near their needles, a distance in mm: to candidates near the other needles, if any."""


@dataclass(frozen=True, eq=False)
class CandidateCalibration:
    """A calibration and what became of every candidate.

    Attributes:
        calibration: fitted to the chosen rows.
        observations: the chosen rows, one a sighting in 2D; `calibration.inlier` belongs to them.
        chosen: (N,) of the candidates given: which row was chosen (before the second look).
        sightings: images and needles looked at.
        used: sightings that took part.
        reasons: sightings that did not, counted by why.
        options: what it was made with.
        labels: of several wires in 2D images, which candidate was which wire; None where there was nothing to label.
    """

    calibration: Calibration
    observations: Observations
    chosen: Mask
    sightings: int
    used: int
    reasons: dict[str, int]
    options: Options
    labels: LabelledDots | None = None

    __repr__ = brief

    @property
    def agreeing(self) -> int:
        """Sightings that agree, those that were left out of the fit for how they lie included."""
        return self.used + self.reasons.get(ASLANT, 0)

    def _repr_html_(self) -> str:
        left_out = "".join(f"; {count} {why}" for why, count in self.reasons.items() if count)
        used = f"{self.used} of {self.sightings} sightings took part{left_out}"
        return f"{self.calibration._repr_html_()}{card('', used)}"


def calibrate_candidates(
    candidates: Observations,
    *,
    sightings: int | None = None,
    look_again: LookAgain | None = None,
    **options: Unpack[CalibrationKeywords],
) -> CandidateCalibration:
    """Calibrate from several candidates a sighting, of which at most one is right.

    Args:
        candidates: one row a candidate, best first within a frame and target; in 3D two or more rows a line
            candidate, with the candidate's number as `split`.
        sightings: images and needles looked at, where some had no candidate at all.
        look_again: finds further candidates, once a fit says where needles must be: given it, the candidates within
            a distance of their needles, and that distance in mm.
        **options: those of `sonocal.calibrate` without its splits, by name; candidates further than `threshold_mm`
            from their needle are wrong.

    Returns:
        The calibration and the share of images that it rests on.

    Raises:
        NoConsensusError: no calibration explains more images than chance would.
        DegenerateGeometryError: the sightings leave a motion free.
        InputError: there are too few candidates, or an option means nothing.
    """
    require("candidates", candidates, Observations)
    asked = Options.of(**options)
    refuse_splits(asked, "candidates are chosen first")
    return calibrate_chosen(candidates, asked, sightings or 0, look_again)


def calibrate_chosen(
    candidates: Observations,
    options: Options,
    sightings: int,
    look_again: LookAgain | None = None,
    *,
    most_mm: float = MOST_MM,
    across: Array | None = None,
    start: AxisScaled | None = None,
    kind: type[Candidates] = Candidates,
) -> CandidateCalibration:
    """As `calibrate_candidates`, with checked options.

    `most_mm` is the threshold where that is "auto"; `across` (F, 2, 3) are two axes across the needle that turn with
    it, in the probe's frame; `start` is a transform that may be near: another's calibration of the probe; `kind` is
    what candidates are grouped by.
    """
    within_mm = most_mm if options.threshold_mm == "auto" else float(options.threshold_mm)
    table = kind(candidates, options, within_mm)
    total = max(sightings, table.shown)
    labels = labels_of(table) if start is None else None
    begin = _first_consensus(table, total, start) if labels is None else labels.target_from_source
    assert begin is not None
    if labels is not None and options.threshold_mm in ("auto", most_mm):
        table = kind(candidates, options, widened_mm(labels, within_mm))
    transform, first = settled_at(table, begin)
    table, settled = _looked_again(table, look_again, transform, first)
    chosen, twin = upper_of_two(table, *settled, across)
    used = table.agreeing(chosen)
    if used < _least_agreeing(table, total, labels):  # of a few, most agree by chance, until one looks closer
        raise _nothing_found(table, total, used, labels)
    last = of_calibrate(options, threshold_mm=_last_threshold(table, chosen), latency=None)
    calibration, fitted = calibrated_across(table, chosen, settled[0], lambda rows: calibrate(rows, **last))
    reasons = {
        "no candidate or no pose": total - table.shown,
        f"no candidate near {table.wanted}": table.shown - used,
    }
    if aslant := used - table.agreeing(fitted):
        used, reasons[ASLANT] = used - aslant, aslant
    calibration = calibration.with_findings(
        [
            _report(table, used, total, reasons),
            *twin_findings(twin),
            *label_findings(labels, candidates.target.tolist()),
        ]
    )
    rows = table.at(fitted)
    dots = labelled_dots(table, labels, rows, calibration)
    return CandidateCalibration(calibration, rows, first, total, used, reasons, options, dots)


def _first_consensus(table: Candidates, total: int, start: AxisScaled | None) -> AxisScaled:
    """The transform that the most sightings beyond chance agree with, tried on ever lower ranks."""
    told = None if start is None else Agreeing.of(table, start)
    best = told
    refusal: SonocalError | None = None
    for most in RANKS if told is None or not told.is_enough(total) else ():
        keep = table.rank < most
        try:
            found = Agreeing.of(table, table.consensus(keep))
        except (NoConsensusError, DegenerateGeometryError, InputError) as error:
            refusal = refusal or error
            continue
        before, best = best, found if best is None or found.weight > best.weight else best
        settled = before is not None and before.is_enough(total)
        if (best.is_enough(total) and (settled or best.count >= SURE * total)) or keep.all():
            break
    named = isinstance(refusal, MirroredVolumeError) or not isinstance(refusal, NoConsensusError)
    if best is None and refusal is not None and named:
        raise refusal
    if best is None:
        raise _nothing_found(table, total, 0)
    # What was told beforehand was not chosen among many: far more than by chance is no chance, however few.
    few = best.count < _least_agreeing(table, total) and not (best is told and best.is_far_more)
    if few or best.may_be_chance(table):
        raise _nothing_found(table, total, best.count)
    return best.transform


def _looked_again(
    table: Candidates, look_again: LookAgain | None, transform: AxisScaled, fitted: Mask
) -> tuple[Candidates, tuple[AxisScaled, Mask]]:
    """The candidates with those of a second look, and the fit of the chosen ones, and these."""
    if look_again is None:
        return table, (transform, fitted)
    further = look_again(transform, table.at(table.nearest(transform)), table.within_mm)
    if further is None:
        return table, settled_at(table, transform, fitted)
    table = table.and_further(further)
    return table, settled_at(table, transform)


def _last_threshold(table: Candidates, chosen: Mask) -> float | Literal["auto"]:
    """The threshold for the chosen rows: "auto", as long as it stays below what tells candidates apart."""
    if table.options.threshold_mm == "auto" and table.fit(chosen, "auto").threshold_mm <= table.within_mm:
        return "auto"
    return table.within_mm


def _least_agreeing(table: Candidates, total: int, labels: Association | None = None) -> float:
    """Sightings without which a calibration is no answer; labels that are sure say enough by themselves."""
    if labels is not None and labels.verdict == "found":
        return 0.0
    return max(min(LEAST_SIGHTINGS, LEAST_SHARE_OF_FEW * total), table.least_share * total)


def _report(table: Candidates, used: int, total: int, reasons: dict[str, int]) -> Diagnostic:
    why = ", ".join(f"{count} with {reason}" for reason, count in reasons.items() if count)
    few = used + reasons.get(ASLANT, 0) < ENOUGH * total
    return Diagnostic(
        code="images-used",
        severity="warning" if few else "info",
        message=f"{used} of {total} {table.counted} took part" + (f"; left out were {why}" if why else ""),
        advice=f"look at the contact sheet; raise the scanner's gain and keep {table.wanted} across the beam"
        if few
        else f"nothing, if {table.wanted} was out of view for that share of the time",
    )


def _nothing_found(
    table: Candidates, total: int, best: int, labels: Association | None = None
) -> NoConsensusError:
    table.refuse_mirrored(best, _least_agreeing(table, total))
    if labels is not None:  # which are not sure: then so few would do
        return NoConsensusError(
            f"{table.rows.source}: {unsure_in_words(labels)}; {best} of {total} {table.counted} agree with the "
            f"likeliest answer, too few to choose by: {ADVICE}",
            best_count=best,
        )
    images = len(np.unique(table.rows.frame))
    few = best < ENOUGH * total
    check = f"check in the contact sheet that {table.wanted} is visible and marked"
    return NoConsensusError(
        f"{table.rows.source}: no calibration agrees with more than {best} of {total} {table.counted}; "
        f"{len(table)} candidates in {images} images were tried, and so {'few' if few else 'many'} agree by chance "
        f"within {table.within_mm:.3g} mm; {check if few else 'give a smaller threshold, or ' + check}",
        best_count=best,
    )
