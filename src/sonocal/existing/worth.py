"""What a matrix of other software is worth on a table of sightings, beside our own calibration of the same rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from sonocal.calibration import Calibration, calibrate, line_distances
from sonocal.calibration.held_out import independent_units
from sonocal.errors import InputError, SonocalError
from sonocal.existing.difference import Difference, difference
from sonocal.existing.matrix import Existing
from sonocal.existing.meaning import UNEQUAL, matrix_findings, meaning_of
from sonocal.existing.rereadings import Rereading, fitting, in_words, rereadings
from sonocal.findings import Diagnostic, warnings_first
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.registration.options import Model
from sonocal.setup_checks.scale import scale_doubt
from sonocal.validation import (
    PointSightings,
    Quantity,
    fixed_point_spread,
    leave_one_frame_out,
    nwire_error,
    reconstruction_accuracy,
)
from sonocal.validation.quantity import rms_quantity

__all__ = ["MATRIX_ALONE", "Said", "Worth", "model_like", "worth_of", "worth_on_points"]

MISREAD = "misread-matrix"
MATRIX_ALONE = (
    "The file has a matrix and nothing of what it was made from: no error is predicted and no verdict given. What was "
    "measured here is all that is known of it; if it was made from these very sightings, its error is that of a fit."
)


class Said(NamedTuple):
    """What is said of the mm/px.

    Attributes:
        mm_per_px: one number, or one along u and one along v.
        by: who says so, for messages.
    """

    mm_per_px: tuple[float, ...]
    by: str


@dataclass(frozen=True, eq=False)
class Worth:
    """What is known of a matrix once rows were compared with it.

    Attributes:
        existing: the matrix.
        source, sha256: of the rows.
        quantities: of the matrix.
        own: our calibration of the same rows; None where there is none.
        own_quantities: the same of ours, on rows that it was not fitted to.
        difference: from ours; None where there is none.
        said: the mm/px that the scanner or the recording states.
        diagnostics: what is odd about the matrix, and what the rows say of it; warnings first.
        reread: what the matrix is instead of what it was read as, where one usual mistake explains the rows.
    """

    existing: Existing
    source: str
    sha256: str
    quantities: tuple[Quantity, ...]
    own: Calibration | None = None
    own_quantities: tuple[Quantity, ...] = ()
    difference: Difference | None = None
    said: Said | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    reread: Existing | None = None

    @property
    def sentence(self) -> str:
        """The answer in one or two sentences."""
        if not self.quantities:
            return f"Nothing was measured of {self.existing.said}."
        if misread := next((one for one in self.diagnostics if one.code == MISREAD), None):
            return f"{misread.message[0].upper()}{misread.message[1:]}: {misread.advice}."
        said = f"On {self.source}, {self.existing.said} is off by {_with_interval(self.quantities[0])}"
        if not self.own_quantities or self.difference is None:
            return f"{said}."
        ours = f"where our own calibration, not fitted to them, is off by {_with_interval(self.own_quantities[0])}"
        return f"{said}, {ours}. {self.difference.sentence}"

    @property
    def scale_sentence(self) -> str:
        """The mm/px that are said beside those of the matrix and of ours; nothing where none are said."""
        if self.said is None:
            return ""
        given = " x ".join(f"{s:.5f}" for s in self.said.mm_per_px)
        theirs = meaning_of((self.reread or self.existing).matrix).scales_mm_per_px
        name = "this matrix" if self.reread is None else "this matrix, read so,"
        parts = [f"{name} has {_against(theirs, self.said)}"]
        if self.own is not None:
            parts.append(f"ours {_against(self.own.probe_from_image.scales, self.said)}")
        by = self.said.by[0].upper() + self.said.by[1:]
        return f"{by} says {given} mm/px: {', '.join(parts)}."


def worth_of(
    existing: Existing,
    observations: Observations,
    *,
    split: str | None = None,
    nwires: Sequence[tuple[str, str, str]] = (),
    own: Calibration | None = None,
    said: Said | None = None,
) -> Worth:
    """Compare a matrix with rows, and with our own calibration of them.

    Both are measured on rows that ours was not fitted to: those of `split`, where one is named, and ours is fitted to
    the others; else frame by frame, each under ours fitted to all other frames, on the rows that agree with ours.

    Args:
        existing: the matrix.
        observations: sightings that it was not fitted to.
        split: the rows to measure on.
        nwires: the targets (left, middle, right) of each N of an N-wire phantom.
        own: our calibration of all rows, where it is made already.
        said: the mm/px that the scanner or the recording states.

    Raises:
        InputError: there is no such split.
    """
    rows = observations if split is None else observations.select_split(split)
    own, refused = (own, None) if own is not None and split is None else _own(existing, observations, split)
    if own is not None and split is None and len(own.inlier) == len(rows) and own.inlier.any():
        rows = rows.select(own.inlier)
    numbers = _Numbers()
    failures: list[Diagnostic] = []
    for of, found in ((numbers.theirs, existing), (numbers.ours, own)):
        if found is not None:
            failures += _measure(of, found, rows, nwires, held_out=split is not None)
    area = _area(rows, own)
    apart = None if own is None else difference(existing, own, area, "ours")
    misread = [] if own is None else _misread(existing, numbers, own, rows)
    reread = misread[0].of(existing) if len(misread) == 1 else None
    findings = [
        *([] if refused is None else [_not_calibrated(refused)]),
        *(
            _misread_finding(existing, numbers, misread, rows)
            if misread
            else _worse(existing, numbers, apart)
        ),
        *(matrix_findings(reread or existing, observations.dimension) if reread or not misread else ()),
        *_scanner(reread or existing, said),
        *failures,
    ]
    return Worth(
        existing,
        observations.source,
        observations.sha256,
        tuple(numbers.theirs),
        own,
        tuple(numbers.ours),
        apart,
        said,
        warnings_first(findings),
        reread,
    )


def worth_on_points(existing: Existing, sightings: PointSightings) -> Worth:
    """Compare a matrix with points whose place, or whose probe's pose, is known.

    Raises:
        InputError: the points have neither.
    """
    found = []
    if sightings.points_mm is not None:
        found.append(reconstruction_accuracy(existing.probe_from_image, sightings))
    if sightings.tracker_from_probe is not None and len(sightings) > len(np.unique(sightings.target)):
        found.append(fixed_point_spread(existing.probe_from_image, sightings))
    if not found:
        raise InputError(f"{sightings.source}: gives no number; it needs places or poses of its points")
    findings = matrix_findings(existing, sightings.points_px.shape[1])
    return Worth(existing, sightings.source, sightings.sha256, tuple(found), diagnostics=findings)


def model_like(existing: Existing, dimension: int) -> Model:
    """The model that has as many scales as a matrix: what ours is compared in."""
    unequal = abs(meaning_of(existing.matrix).unequal) > UNEQUAL
    return "anisotropic" if unequal and dimension == 2 else "similarity"


class _Numbers:
    """Quantities of the two."""

    def __init__(self) -> None:
        self.theirs: list[Quantity] = []
        self.ours: list[Quantity] = []


def _own(
    existing: Existing, observations: Observations, split: str | None
) -> tuple[Calibration | None, SonocalError | None]:
    """Our calibration of the rows that are not measured on, or why there is none."""
    model = model_like(existing, observations.dimension)
    try:
        return calibrate(observations, model=model, test_split=split), None
    except SonocalError as error:
        return None, error


def _measure(
    numbers: list[Quantity],
    found: Existing | Calibration,
    rows: Observations,
    nwires: Sequence[tuple[str, str, str]],
    *,
    held_out: bool,
) -> Iterator[Diagnostic]:
    """Adds the numbers of one of the two; yields what has no answer."""
    ours = isinstance(found, Calibration)
    who = "Ours" if ours else "This matrix"
    try:
        if isinstance(found, Calibration) and not held_out:
            left_out = leave_one_frame_out(found, rows)
            numbers.append(replace(left_out, title="Ours, one frame left out"))
        else:
            numbers.append(_from_lines(found, rows, f"{who}, held-out rows" if held_out else who))
        if nwires:
            error = nwire_error(found.probe_from_image, rows, nwires)
            numbers.append(replace(error, title=f"{who}, {error.title}"))
    except SonocalError as error:
        yield Diagnostic(
            code="not-computed",
            severity="info",
            message=f"the error of {'our own calibration' if ours else 'the matrix'} was not computed: {error}",
            advice="scan more, or name the targets and splits, to have it",
        )


def _from_lines(found: Existing | Calibration, rows: Observations, title: str) -> Quantity:
    return rms_quantity(
        "held-out",
        title,
        "distance of a mapped image point to its line, rms",
        line_distances(found.probe_from_image, rows),
        independent_units(found.probe_from_image, rows),
    )


def _area(rows: Observations, own: Calibration | None) -> Array:
    """(2, d): the image where its size is known, else what was seen of it."""
    if own is not None:
        return own.area_px
    return np.array([rows.points_px.min(axis=0), rows.points_px.max(axis=0)])


def _worse(existing: Existing, numbers: _Numbers, apart: Difference | None) -> Iterator[Diagnostic]:
    """Where the matrix leaves more error than ours, and is further from it than ours leaves open."""
    if not numbers.theirs or not numbers.ours or apart is None or apart.beyond is None:
        return
    theirs, ours = numbers.theirs[0], numbers.ours[0]
    # Few wires hold ours loosely while it fits their neighbours in time: then the matrix may be the better one.
    if not theirs.low_mm > ours.high_mm or not apart.beyond.any():
        return
    yield Diagnostic(
        code="worse-than-ours",
        severity="warning",
        message=(
            f"{existing.said} is off by {_with_interval(theirs)} where our own calibration, on the same rows, is off "
            f"by {_with_interval(ours)}"
        ),
        advice=_why(apart) + "; if nothing did, take ours: sonocal calibrate",
    )


def _misread(existing: Existing, numbers: _Numbers, own: Calibration, rows: Observations) -> list[Rereading]:
    """What the matrix may be instead, by one usual mistake: of several, the rows do not tell which."""
    if not numbers.theirs or not numbers.ours:
        return []
    scale = float(own.probe_from_image.scales[:2].mean())
    ways = rereadings(existing, rows.dimension, rows.image_size_px, scale)
    as_read, ours = numbers.theirs[0].value_mm, numbers.ours[0].value_mm
    return fitting(ways, lambda matrix: _rms(replace(existing, matrix=matrix), rows), as_read, ours)


def _rms(existing: Existing, rows: Observations) -> float:
    return float(np.sqrt(np.mean(line_distances(existing.probe_from_image, rows) ** 2)))


def _misread_finding(
    existing: Existing, numbers: _Numbers, found: Sequence[Rereading], rows: Observations
) -> Iterator[Diagnostic]:
    words, advice = in_words(found)
    so = max(_rms(one.of(existing), rows) for one in found)
    theirs, ours = numbers.theirs[0].value_mm, numbers.ours[0].value_mm
    yield Diagnostic(
        code="misread-matrix",
        severity="warning",
        message=(
            f"{existing.said} {words}: as it was read it is off by {theirs:.2f} mm on these rows, read so by "
            f"{so:.2f} mm, and our own calibration by {ours:.2f} mm"
        ),
        advice=advice,
    )


def _why(apart: Difference) -> str:
    """What differs most, and what does that."""
    ratio = apart.scale_ratios
    if np.abs(ratio).max() > UNEQUAL:
        return (
            f"its mm/px differ by {100 * ratio[np.argmax(np.abs(ratio))]:+.1f} %: look for another depth setting, or "
            "images that were resampled or cropped since"
        )
    return (
        f"its mm/px agree, it is turned by {apart.rotation_deg:.2f} deg and {apart.distance_mm[-1]:.2f} mm off in the "
        "middle: look for a marker that was moved on the probe, or a needle or phantom that was measured otherwise"
    )


def _scanner(existing: Existing, said: Said | None) -> Iterator[Diagnostic]:
    """The matrix's mm/px, which are given without an uncertainty, against what is said."""
    if said is not None:
        scales = meaning_of(existing.matrix).scales_mm_per_px
        yield from scale_doubt(scales, np.zeros(2), said.mm_per_px, existing.said, said.by)


def _not_calibrated(error: SonocalError) -> Diagnostic:
    return Diagnostic(
        code="not-computed",
        severity="warning",
        message=f"there is no calibration of our own to compare with: {error}",
        advice="compare on rows that allow one",
    )


def _against(scales: Array, said: Said) -> str:
    ratios = scales[:2] / np.broadcast_to(said.mm_per_px[:2], (2,)) - 1.0
    return f"{100 * ratios[0]:+.1f} % along u and {100 * ratios[1]:+.1f} % along v"


def _with_interval(quantity: Quantity) -> str:
    value = f"{quantity.value_mm:.2f} mm"
    if np.isnan(quantity.low_mm):
        return value
    return f"{value} ({quantity.low_mm:.2f} to {quantity.high_mm:.2f})"
