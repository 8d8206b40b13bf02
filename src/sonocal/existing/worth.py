"""What a matrix of other software is worth on a table of sightings, beside our own calibration of the same rows."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sonocal.calibration import Calibration, calibrate
from sonocal.errors import InputError, SonocalError
from sonocal.existing.difference import Difference, difference
from sonocal.existing.fitting import Rereading
from sonocal.existing.matrix import Existing
from sonocal.existing.meaning import UNEQUAL, matrix_findings, meaning_of
from sonocal.existing.misread import misread, misread_finding, misread_on_points
from sonocal.existing.worth_findings import (
    Said,
    against_scanner,
    not_calibrated,
    ratios_to,
    with_interval,
    worse_than_ours,
)
from sonocal.existing.worth_numbers import measured
from sonocal.findings import Diagnostic, begun, warnings_first
from sonocal.observations import Observations
from sonocal.registration.options import Model
from sonocal.validation import (
    PointSightings,
    Quantity,
    fixed_point_spread,
    reconstruction_accuracy,
)

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
        rereadings: how the matrix is read so that it explains the rows, where it was misread: of several they do not
            tell which is right.
        reread_quantities: the same of the matrix, read so, where there is one such reading.
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
    rereadings: tuple[Rereading, ...] = ()
    reread_quantities: tuple[Quantity, ...] = ()

    @property
    def reread(self) -> Existing | None:
        """The matrix as it is right, where one usual mistake explains the rows."""
        return self.rereadings[0].of(self.existing) if len(self.rereadings) == 1 else None

    @property
    def misread(self) -> Diagnostic | None:
        """The finding that the matrix was misread, where it was."""
        # Warnings come first: a note may be of a matrix that it is compared with.
        found = (one for one in self.diagnostics if one.code == "misread-matrix")
        return next(found, None) if self.rereadings else None

    @property
    def sentence(self) -> str:
        """The answer in one or two sentences."""
        if not self.quantities:
            return f"Nothing was measured of {self.existing.said}."
        if (led := self.misread) is not None:
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
    held_out = split is not None
    theirs, failures = measured(existing, rows, nwires, held_out=held_out)
    ours, others = ((), ()) if own is None else measured(own, rows, nwires, held_out=held_out)
    worth = Worth(existing, observations.source, observations.sha256, theirs, own, ours, said=said)
    if own is not None:
        worth = _beside_ours(worth, own, rows)
    if (reread := worth.reread) is not None:
        so = measured(reread, rows, nwires, held_out=held_out, who="This matrix, read so")[0]
        worth = replace(worth, reread_quantities=so)
    missing = () if refused is None else (not_calibrated(refused),)
    found = [*missing, *_findings(worth, rows), *failures, *others]
    return replace(worth, diagnostics=warnings_first(found))


def _beside_ours(worth: Worth, own: Calibration, rows: Observations) -> Worth:
    """How far the matrix is from ours, as it was read and as it explains the rows."""
    ways = misread(worth.existing, rows, own, worth.own_quantities)
    apart = difference(worth.existing, own, own.area_px, "ours")
    if len(ways) == 1:
        apart = replace(apart, reread=difference(ways[0].of(worth.existing), own, own.area_px, "ours"))
    return replace(worth, difference=apart, rereadings=tuple(ways))


def _findings(worth: Worth, rows: Observations) -> Iterator[Diagnostic]:
    """What rows, its own numbers and the scanner say of a matrix, which is meant as it is right."""
    if worth.rereadings:
        yield misread_finding(worth.existing, rows, worth.rereadings, worth.own_quantities[0])
    else:
        yield from worse_than_ours(worth.existing, worth.quantities, worth.own_quantities, worth.difference)
    meant = worth.reread or worth.existing
    if worth.reread is not None or not worth.rereadings:
        yield from matrix_findings(meant, rows.dimension)
    yield from against_scanner(meant, worth.said)


def worth_on_points(existing: Existing, sightings: PointSightings) -> Worth:
    """Compare a matrix with points whose place, or whose probe's pose, is known.

    Raises:
        InputError: the points have neither.
    """
    numbers = _on_points(existing, sightings)
    if not numbers:
        raise InputError(f"{sightings.source}: gives no number; it needs places or poses of its points")
    ways, finding = misread_on_points(existing, sightings)
    worth = Worth(existing, sightings.source, sightings.sha256, numbers, rereadings=tuple(ways))
    told = () if finding is None else (finding,)
    if (reread := worth.reread) is not None:
        so = [replace(one, title=f"{one.title}, read so") for one in _on_points(reread, sightings)]
        worth = replace(worth, reread_quantities=tuple(so))
    odd = matrix_findings(reread or existing, sightings.points_px.shape[1]) if reread or not ways else ()
    return replace(worth, diagnostics=warnings_first([*told, *odd]))


def _on_points(existing: Existing, sightings: PointSightings) -> tuple[Quantity, ...]:
    numbers = []
    if sightings.points_mm is not None:
        numbers.append(reconstruction_accuracy(existing.probe_from_image, sightings))
    if sightings.tracker_from_probe is not None and len(sightings) > len(np.unique(sightings.target)):
        numbers.append(fixed_point_spread(existing.probe_from_image, sightings))
    return tuple(numbers)


def model_like(existing: Existing, dimension: int) -> Model:
    """The model that has as many scales as a matrix: what ours is compared in."""
    unequal = abs(meaning_of(existing.matrix).unequal) > UNEQUAL
    return "anisotropic" if unequal and dimension == 2 else "similarity"


def _own(
    existing: Existing, observations: Observations, split: str | None
) -> tuple[Calibration | None, SonocalError | None]:
    """Our calibration of the rows that are not measured on, or why there is none."""
    model = model_like(existing, observations.dimension)
    try:
        return calibrate(observations, model=model, test_split=split), None
    except SonocalError as error:
        return None, error
