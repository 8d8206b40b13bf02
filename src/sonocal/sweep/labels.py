"""Candidates that may each be of any of several wires: which is of which, before anything is chosen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, LabelledDots
from sonocal.calibration.labelled import next_best_in_words
from sonocal.errors import NoConsensusError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.observations import Observations, group_codes
from sonocal.registration import Association, associate
from sonocal.sweep.candidates import TIGHTNESS, Candidates

__all__ = ["ADVICE", "label_findings", "labelled_dots", "labels_of", "unsure_in_words", "widened_mm"]

LEAST_FRAMES = 2
"""With two points or more, as hypotheses are made of pairs of one image; of volumes with one line."""
WIDEST = 2.0
"""Times the threshold that labels were found with: a fifth of the distance between wires."""
ADVICE = (
    "scan the wires from more sides: tilt and turn the probe by 20 degrees and more, and move it across them"
)


def labels_of(table: Candidates) -> Association | None:
    """The labels of candidates each of which is tried against every wire; None where they are not.

    Args:
        table: of one needle, or of points whose wire is named, there is nothing to label.

    Raises:
        NoConsensusError: candidates and wires have nothing to do with each other.
    """
    parts = _parts(table.rows) if table.may_be_of_any else None
    if parts is None:
        return None
    points, frame, wires = parts
    found = associate(points, wires, frame=frame, threshold_mm=table.within_mm, seed=table.options.seed)
    if found.verdict == "nothing fits" or found.target_from_source is None:
        raise NoConsensusError(
            f"{table.rows.source}: no labels of the {wires.shape[1]} wires fit: {found.reason}; check in the contact "
            "sheet that they are visible and marked, and that the file of targets is of this phantom",
            best_count=int(np.count_nonzero(found.labels >= 0)),
        )
    return found


def _parts(rows: Observations) -> tuple[Array, NDArray[np.int64], Array] | None:
    """Points (N, 2), or lines (N, 2, 3) of volumes, the frame of each, and wires (F, L, 2, 3).

    None where a candidate is not tried against every wire, or hardly an image shows two points.
    """
    names, wire = np.unique(rows.target, return_inverse=True)
    frame, flat = group_codes(rows.frame), rows.dimension == 2
    place = group_codes(rows.frame, *rows.points_px.T) if flat else group_codes(rows.frame, rows.split)
    tried = np.unique(np.column_stack([place, wire]), axis=0, return_index=True)[1]
    first = np.unique(place, return_index=True)[1]
    wires = np.full((int(frame.max(initial=-1)) + 1, len(names), 2, 3), np.nan)
    wires[frame, wire] = rows.segments_mm
    if len(tried) != len(first) * len(names) or (flat and len(rows) != len(tried)) or np.isnan(wires).any():
        return None
    several = np.bincount(frame[first]) > (1 if flat else 0)
    if np.count_nonzero(several) < LEAST_FRAMES:
        return None
    return (rows.points_px[first] if flat else _lines(rows, place)), frame[first], wires


def _lines(rows: Observations, place: NDArray[np.int64]) -> Array:
    """(N, 2, 3), px: the two of each candidate's points that are first and last along it."""
    points = rows.points_px
    lines = [points[place == one] for one in range(int(place.max()) + 1)]
    along = [one[np.linalg.norm(one - one[0], axis=1).argmax()] - one[0] for one in lines]
    ends = [(one @ way).argsort(kind="stable")[[0, -1]] for one, way in zip(lines, along, strict=True)]
    return np.stack([one[two] for one, two in zip(lines, ends, strict=True)])


def labelled_dots(
    table: Candidates, labels: Association | None, rows: Observations, calibration: Calibration
) -> LabelledDots | None:
    """Every candidate, and which wire the calibration has it of; None where there was nothing to label, and of volumes.

    Args:
        table: all candidates, those of a second look, too.
        labels: what was found before.
        rows: that the calibration was fitted to.
        calibration: of them.
    """
    if labels is None or table.rows.dimension == 3:
        return None
    every = table.rows
    names, wire = np.unique(every.target, return_inverse=True)
    frames, code = np.unique(every.frame, return_inverse=True)
    wires = np.full((len(frames), len(names), 2, 3), np.nan)
    wires[code, wire] = every.segments_mm
    first = np.unique(group_codes(every.frame, *every.points_px.T), return_index=True)[1]
    points, frame = every.points_px[first], every.frame[first]
    number = {(int(f), *map(float, p)): i for i, (f, p) in enumerate(zip(frame, points, strict=True))}
    of, residuals = np.full(len(first), -1, dtype=np.int64), np.full(len(first), np.nan)
    for row in np.flatnonzero(calibration.inlier):
        dot = number[(int(rows.frame[row]), *map(float, rows.points_px[row]))]
        of[dot] = np.searchsorted(names, rows.target[row])
        residuals[dot] = calibration.residuals_mm[row]
    return LabelledDots(points, frame, of, residuals, tuple(map(str, names)), frames, wires, labels)


def widened_mm(labels: Association, within_mm: float) -> float:
    """How far a wire's own candidates may be, once labels stand: as its noise has it, up to twice as far."""
    if labels.verdict != "found":
        return within_mm
    # The distance of a point to a line in space has two components: its median is 1.18 standard deviations.
    sigma_mm = float(np.nanmedian(labels.residuals_mm)) / 1.1774
    return float(np.clip(TIGHTNESS[2] * sigma_mm, within_mm, WIDEST * within_mm))


def label_findings(
    labels: Association | None, names: Sequence[str], *, in_sheet: bool = True
) -> Iterator[Diagnostic]:
    """Which wire bears which number in the contact sheet, how far the next best labels are, and where none are sure.

    Args:
        labels: None where there is nothing to label.
        names: of the wires.
        in_sheet: whether there is a contact sheet.
    """
    if labels is None:
        return
    given, count = int(np.count_nonzero(labels.labels >= 0)), len(labels.labels)
    said, advice = [f"{given} of {count} candidates were labelled", next_best_in_words(labels)], "nothing"
    if in_sheet:
        numbers = ", ".join(f"{i + 1} {name}" for i, name in enumerate(sorted(set(names))))[:250]
        said.append(f"in the contact sheet: {numbers}")
        advice = "nothing, if the numbers in the contact sheet are where these wires are"
    yield Diagnostic(code="labels-given", severity="info", message="; ".join(said), advice=advice)
    if labels.verdict == "found":
        return
    message = unsure_in_words(labels)
    yield Diagnostic(
        code=f"labels-{labels.verdict}", severity="warning", message=message[:400], advice=ADVICE
    )


def unsure_in_words(labels: Association) -> str:
    """Why labels are not sure, where they are not."""
    if labels.verdict == "ambiguous":
        rivals = ", ".join(dict.fromkeys(one.name for one in labels.rivals))
        return f"which candidate is of which wire is ambiguous: {labels.reason} (rivals: {rivals})"
    return f"the search for which candidate is of which wire was ended early: {labels.reason}"
