"""What a matrix of other software is worth on a table of sightings, beside our own calibration of the same rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonocal.calibration import Calibration, calibrate, line_distances
from sonocal.calibration.held_out import independent_units
from sonocal.errors import InputError, SonocalError
from sonocal.existing.difference import Difference, difference
from sonocal.existing.matrix import Existing
from sonocal.existing.meaning import UNEQUAL, matrix_findings, meaning_of
from sonocal.existing.misread import misread, misread_finding
from sonocal.existing.worth_findings import (
    Said,
    against_scanner,
    not_calibrated,
    ratios_to,
    with_interval,
    worse_than_ours,
)
from sonocal.findings import Diagnostic, begun, warnings_first
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.registration.options import Model
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

MATRIX_ALONE = (
    "The file has a matrix and nothing of what it was made from: no error is predicted and no verdict given. What was "
    "measured here is all that is known of it; if it was made from these very sightings, its error is that of a fit."
)


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
        if led := next((one for one in self.diagnostics if one.code == "misread-matrix"), None):
            return f"{begun(led.message)}: {led.advice}."
        said = f"On {self.source}, {self.existing.said} is off by {with_interval(self.quantities[0])}"
        if not self.own_quantities or self.difference is None:
            return f"{said}."
        ours = f"where our own calibration, not fitted to them, is off by {with_interval(self.own_quantities[0])}"
        return f"{said}, {ours}. {self.difference.sentence}"

    @property
    def scale_sentence(self) -> str:
        """The mm/px that are said beside those of the matrix and of ours; nothing where none are said."""
        if self.said is None:
            return ""
        given = " x ".join(f"{s:.5f}" for s in self.said.mm_per_px)
        theirs = meaning_of((self.reread or self.existing).matrix).scales_mm_per_px
        name = "this matrix" if self.reread is None else "this matrix, read so,"
        parts = [f"{name} has {ratios_to(theirs, self.said)}"]
        if self.own is not None:
            parts.append(f"ours {ratios_to(self.own.probe_from_image.scales, self.said)}")
        return f"{begun(self.said.by)} says {given} mm/px: {', '.join(parts)}."


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
    ways = misread(existing, rows, own, numbers.theirs, numbers.ours)
    reread = ways[0].of(existing) if len(ways) == 1 else None
    findings = [
        *([] if refused is None else [not_calibrated(refused)]),
        *(
            [misread_finding(existing, rows, ways, numbers.theirs[0], numbers.ours[0])]
            if ways
            else worse_than_ours(existing, numbers.theirs, numbers.ours, apart)
        ),
        *(matrix_findings(reread or existing, observations.dimension) if reread or not ways else ()),
        *against_scanner(reread or existing, said),
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
