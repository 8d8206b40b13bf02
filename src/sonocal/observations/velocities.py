"""Velocities of a line's two points, as further columns of a table: what a lag between image and tracker moves."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from sonocal.errors import InputError
from sonocal.geometry import FURTHEST, Array
from sonocal.observations.table import Observations

__all__ = ["VELOCITY_COLUMNS", "velocities_of", "with_velocities"]

VELOCITY_COLUMNS = ("vx0_mm_s", "vy0_mm_s", "vz0_mm_s", "vx1_mm_s", "vy1_mm_s", "vz1_mm_s")


def velocities_of(observations: Observations) -> Array | None:
    """(N, 2, 3), mm/s, in the probe marker's frame, of each row's two points; NaN where cells are blank.

    Returns:
        None where the table has none of the columns.

    Raises:
        InputError: some of the columns are missing, or a cell is neither blank nor a number.
    """
    missing = [name for name in VELOCITY_COLUMNS if name not in observations.extra]
    if len(missing) == len(VELOCITY_COLUMNS):
        return None
    if missing:
        raise InputError(
            f"{observations.source}: has velocities but for the columns {', '.join(missing)}; give all six or none"
        )
    columns = [_numbers(observations, name) for name in VELOCITY_COLUMNS]
    return np.column_stack(columns).reshape(-1, 2, 3)


def with_velocities(observations: Observations, velocities: Array) -> Observations:
    """The table with velocities (N, 2, 3), mm/s; NaN are blank cells."""
    columns = velocities.reshape(len(observations), 6).T
    text = [np.where(np.isfinite(column), (column + 0.0).astype(np.str_), "") for column in columns]
    return observations.with_sound(
        extra={**observations.extra, **dict(zip(VELOCITY_COLUMNS, text, strict=True))}
    )


def _numbers(observations: Observations, name: str) -> Array:
    cells = observations.extra[name]
    numbers = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells.tolist()):
        if not cell.strip():
            continue
        with suppress(ValueError):
            numbers[row] = float(cell)
        if not abs(numbers[row]) < FURTHEST:
            raise InputError(
                f"{observations.where(row)}, column {name}: {cell[:40]!r} is no velocity in mm/s; leave the cell blank "
                "where it is not known"
            )
    return numbers
