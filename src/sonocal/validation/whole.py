"""Everything that a table can say of a calibration, in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.calibration import Calibration, evidence_of, line_distances, seen_at_assumed_speed
from sonocal.calibration.held_out import held_out_findings
from sonocal.errors import InputError, SonocalError, require
from sonocal.findings import Diagnostic, warnings_first
from sonocal.geometry.cards import card
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.setup_checks import check_setup
from sonocal.validation.crosswire import fixed_point_spread, reconstruction_accuracy
from sonocal.validation.held_out import (
    held_out,
    leave_one_frame_out,
    leave_one_target_out,
)
from sonocal.validation.measured import point_findings
from sonocal.validation.nwire import nwire_error
from sonocal.validation.other_scan import other_scale, sound_alone
from sonocal.validation.point_table import PointSightings
from sonocal.validation.quantity import Quantity
from sonocal.validation.repeatability import Repeatability, repeatability

__all__ = ["Validation", "fitted_and_held_out", "fitted_rows", "validate", "validate_points"]

FROM_RESIDUALS = {
    "wrong-tool-frame",
    "second-needle",
    "two-markers",
    "marker-slipped",
    "latency",
    "latency-beyond-tolerance",
}


@dataclass(frozen=True, eq=False)
class Validation:
    """The numbers of a validation.

    Attributes:
        quantities: the most trustworthy first.
        diagnostics: what could not be computed or must be known.
        repeatability: where in the image, when it was computed.
        source: the table's name.
        sha256: the table's digest, or "".
    """

    quantities: tuple[Quantity, ...]
    diagnostics: tuple[Diagnostic, ...] = ()
    repeatability: Repeatability | None = None
    source: str = ""
    sha256: str = ""

    __repr__ = brief

    def _repr_html_(self) -> str:
        rows = [(one.title, _said(one)) for one in self.quantities]
        rows += [(one.severity, one.message) for one in self.diagnostics]
        return card(f"Errors on {self.source}", rows=rows)

    def __getitem__(self, code: str) -> Quantity:
        """The quantity of a code.

        Raises:
            KeyError: it was not computed; the message names those that were.
        """
        for quantity in self.quantities:
            if quantity.code == code:
                return quantity
        raise KeyError(f"no {code!r}; there are {', '.join(q.code for q in self.quantities)}")


def _said(quantity: Quantity) -> str:
    """A quantity with its interval, in words."""
    known = ""
    if np.isfinite(quantity.low_mm) and np.isfinite(quantity.high_mm):
        known = f" ({quantity.low_mm:.2f} to {quantity.high_mm:.2f}, 95 %)"
    return (
        f"{quantity.value_mm:.2f} mm{known}, of {quantity.count} errors in {quantity.units} {quantity.unit}"
    )


def validate(
    calibration: Calibration,
    observations: Observations,
    *,
    split: str | None = None,
    nwires: Sequence[tuple[str, str, str]] = (),
    resample: bool = True,
    scanner_mm_per_px: float | None = None,
    expected_rotation: ArrayLike | None = None,
    marker_above_image: bool = False,
    seed: int = 0,
) -> Validation:
    """All numbers that a table of sightings gives.

    Rows that were fitted (the calibration's own input) give leave-one-out errors and repeatability; rows that
    were not give the held-out error, and PLUS's where the wires form Ns. What these rows say against the
    calibration, and what is known now of the set-up and was not when it was made, is among the findings. Of a
    calibration that knows of another speed of sound the rows must be of images in which it is the same.

    Args:
        calibration: the calibration.
        observations: its own input, or a table of other sightings.
        split: take only this split as held-out rows.
        nwires: the targets (left, middle, right) of each N of an N-wire phantom.
        resample: leave-one-out errors and repeatability too, which take hundreds of fits.
        scanner_mm_per_px: what the scanner says.
        expected_rotation: (3, 3): roughly, the directions of u, v and normal in the marker's frame, as columns,
            such as the rotation of another calibration of this probe and marker.
        marker_above_image: the marker is fixed to the handle, beyond the upper half of the image.
        seed: of the resampling.

    Raises:
        InputError: the rows do not fit the calibration.
    """
    require("calibration", calibration, Calibration)
    require("observations", observations, Observations)
    if observations.dimension != calibration.dimension:
        raise InputError(
            f"{observations.source}: is of a {observations.dimension}D probe and the calibration of a "
            f"{calibration.dimension}D one"
        )
    observations = seen_at_assumed_speed(calibration.sound, observations)
    fitted, unseen = fitted_and_held_out(calibration, observations, split)
    attempts = _Attempts()
    if unseen is not None:
        attempts.run("held-out error", lambda: held_out(calibration, unseen))
    if nwires:
        attempts.run(
            "N-wire error",
            lambda: nwire_error(calibration.probe_from_image, unseen or fitted or observations, nwires),
        )
    spread = None
    if fitted is not None and resample:
        attempts.run("leave-one-frame-out error", lambda: leave_one_frame_out(calibration, fitted))
        if len(np.unique(fitted.target)) > 1:
            attempts.run("leave-one-target-out error", lambda: leave_one_target_out(calibration, fitted))
        spread = attempts.repeatability(calibration, fitted, seed)
    told = {"scanner_mm_per_px": scanner_mm_per_px, "expected_rotation": expected_rotation}
    told |= {"marker_above_image": marker_above_image}
    findings = [*attempts.failures, *_said_by(calibration, observations, unseen, told)]
    return Validation(
        tuple(attempts.quantities), warnings_first(findings), spread, observations.source, observations.sha256
    )


def _said_by(
    calibration: Calibration, observations: Observations, unseen: Observations | None, told: dict[str, Any]
) -> list[Diagnostic]:
    """What rows say against a calibration; what it has found already is no news."""
    fitted = fitted_rows(calibration, observations)
    evidence = evidence_of(calibration, observations if fitted is None else fitted)
    off = [*held_out_findings(calibration, unseen)]
    findings = [*off, *check_setup(evidence, **told, seed=calibration.options.seed)]
    if fitted is None:
        # How far rows are off that had no part in the fit is no measure of the noise that its threshold cuts.
        findings = [one for one in findings if one.code != "threshold-below-noise"]
    if off and fitted is None and (own := sound_alone(calibration, observations)) is not None:
        # Rows that agree on a calibration of their own are in one frame with their images; what else residuals under
        # another depth's mm/px look like is that depth's doing.
        scale = [*other_scale(calibration, own)]
        untrue = FROM_RESIDUALS if scale else {"wrong-tool-frame"}
        findings = [*scale, *(one for one in findings if one.code not in untrue)]
    return [finding for finding in findings if finding not in calibration.diagnostics]


def validate_points(calibration: Calibration, sightings: PointSightings) -> Validation:
    """All numbers that a table of points gives: PRA where places are known, spread where poses are.

    Raises:
        InputError: the points do not fit the calibration.
    """
    require("calibration", calibration, Calibration)
    require("sightings", sightings, PointSightings)
    if sightings.points_px.shape[1] != calibration.dimension:
        raise InputError(
            f"{sightings.source}: is of a {sightings.points_px.shape[1]}D probe and the calibration of a "
            f"{calibration.dimension}D one"
        )
    if calibration.sound is not None:
        sightings = replace(sightings, points_px=calibration.sound.at_assumed_speed(sightings.points_px))
    attempts = _Attempts()
    if sightings.points_mm is not None:
        attempts.run("PRA", lambda: reconstruction_accuracy(calibration.probe_from_image, sightings))
    if sightings.tracker_from_probe is not None and len(sightings) > len(np.unique(sightings.target)):
        attempts.run("spread", lambda: fixed_point_spread(calibration.probe_from_image, sightings))
    findings = list(attempts.failures)
    for measured in attempts.quantities:
        findings += point_findings(calibration, sightings, measured)
    return Validation(tuple(attempts.quantities), tuple(findings), None, sightings.source, sightings.sha256)


def fitted_and_held_out(
    calibration: Calibration, observations: Observations, split: str | None = None
) -> tuple[Observations | None, Observations | None]:
    """The rows the calibration was fitted to, without outliers, and those it has not seen.

    A table is the calibration's own input when it has the digest that the calibration recorded.
    """
    test_split = split or calibration.options.test_split
    mask = _fitted_mask(calibration, observations)
    if mask is None:
        return None, observations if split is None else observations.select_split(split)
    fitted = observations.select(mask)
    fitted = fitted.select(line_distances(calibration.probe_from_image, fitted) <= calibration.threshold_mm)
    if not len(fitted):  # another table of that name and length
        return None, observations if split is None else observations.select_split(split)
    if test_split is None:
        return fitted, None
    unseen = observations.select((observations.split == test_split) & ~mask)
    if not len(unseen):
        raise InputError(
            f"{observations.source}: all rows of split {test_split!r} were fitted; name one that was not"
        )
    return fitted, unseen


def fitted_rows(calibration: Calibration, observations: Observations) -> Observations | None:
    """The rows that were given to the fit, outliers included; None if the table is not the calibration's input."""
    mask = _fitted_mask(calibration, observations)
    return None if mask is None else observations.select(mask)


def _fitted_mask(calibration: Calibration, observations: Observations) -> NDArray[np.bool_] | None:
    recorded, options = calibration.provenance, calibration.options
    if (recorded.get("sha256"), recorded.get("input")) != (observations.sha256, observations.source):
        return None
    fit_split, test_split = options.fit_split, options.test_split
    mask = np.ones(len(observations), dtype=bool)
    if fit_split is not None:
        mask = np.asarray(observations.split == fit_split)
    elif test_split is not None:
        mask = np.asarray(observations.split != test_split)
    # Tables made in Python have no digest: the number of rows tells them apart a little.
    return mask if mask.sum() == calibration.fit.observations else None


class _Attempts:
    """Numbers one by one; what has no answer becomes a finding instead of an end."""

    def __init__(self) -> None:
        self.quantities: list[Quantity] = []
        self.failures: list[Diagnostic] = []

    def run(self, what: str, compute: Callable[[], Quantity]) -> None:
        try:
            self.quantities.append(compute())
        except SonocalError as error:
            self._failed(what, error)

    def repeatability(
        self, calibration: Calibration, fitted: Observations, seed: int
    ) -> Repeatability | None:
        try:
            found = repeatability(calibration, fitted, seed=seed)
        except SonocalError as error:
            self._failed("repeatability", error)
            return None
        self.quantities += [found.corners, found.centre]
        return found

    def _failed(self, what: str, error: SonocalError) -> None:
        self.failures.append(
            Diagnostic(
                code="not-computed",
                severity="info",
                message=f"the {what} was not computed: {error}",
                advice="scan more, or name the targets and splits, to have it",
            )
        )
