"""The errors of a matrix, or of our own calibration beside it, on a table of sightings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from sonocal.calibration import Calibration, line_distances
from sonocal.calibration.held_out import independent_units
from sonocal.errors import SonocalError
from sonocal.existing.matrix import Existing
from sonocal.findings import Diagnostic
from sonocal.observations import Observations
from sonocal.validation import Quantity, leave_one_frame_out, nwire_error
from sonocal.validation.quantity import rms_quantity

__all__ = ["measured"]


def measured(
    found: Existing | Calibration,
    rows: Observations,
    nwires: Sequence[tuple[str, str, str]],
    *,
    held_out: bool,
    who: str = "This matrix",
) -> tuple[tuple[Quantity, ...], tuple[Diagnostic, ...]]:
    """The numbers of one of the two, and what has no answer.

    Args:
        found: what is measured.
        rows: on which.
        nwires: as `worth_of` has them.
        held_out: ours was fitted to other rows than these.
        who: what a matrix is called in the numbers' titles.
    """
    numbers: list[Quantity] = []
    try:
        for number in _numbers(found, rows, nwires, held_out=held_out, who=who):
            numbers.append(number)
    except SonocalError as error:
        return tuple(numbers), (_failed(found, error),)
    return tuple(numbers), ()


def _numbers(
    found: Existing | Calibration,
    rows: Observations,
    nwires: Sequence[tuple[str, str, str]],
    *,
    held_out: bool,
    who: str,
) -> Iterator[Quantity]:
    if isinstance(found, Calibration):
        who = "Ours"
    if isinstance(found, Calibration) and not held_out:
        yield replace(leave_one_frame_out(found, rows), title="Ours, one frame left out")
    else:
        yield _from_lines(found, rows, f"{who}, held-out rows" if held_out else who)
    if nwires:
        error = nwire_error(found.probe_from_image, rows, nwires)
        yield replace(error, title=f"{who}, {error.title}")


def _failed(found: Existing | Calibration, error: SonocalError) -> Diagnostic:
    what = "our own calibration" if isinstance(found, Calibration) else "the matrix"
    return Diagnostic(
        code="not-computed",
        severity="info",
        message=f"the error of {what} was not computed: {error}",
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
