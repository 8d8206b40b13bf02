"""What derivatives have in common with residuals because the same noisy points are in both."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.mapped import Mapped, MappedRows
from sonocal.registration.whitened import whitened

__all__ = ["ABOVE_NOISE", "moved_by_noise", "noise_beyond"]

ABOVE_NOISE = 8.0
"""Deviations of its own noise: where less is left of a column, what that noise does is told too roughly. Usual scans
leave 30 to 100."""


def moved_by_noise(
    mapped: Mapped, rows: NDArray[np.int64], columns_at: Callable[[Array], Array], level_px: float
) -> Iterator[Array]:
    """Axis by axis of the image: what a deviation of the points' noise along it changes, (M, 3, k + 1), mm.

    Of the columns first, and last of the mapped points themselves, and with them of the residuals.

    Args:
        mapped: rows under the transform.
        rows: (M,): indices of those to look at.
        columns_at: of places (M, 3), px, of these rows: the columns (M, 3, k), mm.
        level_px: noise of a point, or what the rows' own are multiplied by.
    """
    table, points = mapped.table, mapped.table.points[rows]
    px = level_px * (np.ones(len(rows)) if table.sigma_px is None else table.sigma_px[rows])
    axes = mapped.transform.rotation * mapped.transform.scales
    for axis in range(table.dimension):
        step = 0.5 * np.eye(3)[axis]
        slopes = columns_at(points + step) - columns_at(points - step)
        own = np.broadcast_to(axes[:, axis, None], (len(rows), 3, 1))
        yield np.concatenate([slopes, own], axis=2) * px[:, None, None]


def noise_beyond(
    mapped: MappedRows,
    rows: NDArray[np.int64],
    columns_at: Callable[[Array], Array],
    taken: Array,
    levels: tuple[float, float],
) -> tuple[Array, Array]:
    """What the points' noise alone makes of columns beyond what the transform takes up of them, in the mean.

        E[a' b] = sum_i sigma_px^2 sum_k (W da_i/dx_k)' (W db_i/dx_k)        W whitens

    Least squares take columns for exact. Those of a scale or of an error that grows over the image are made of places
    that are off by what the residuals are off by; where motions leave little of a column, this is most of its product
    with the residuals.

    Args:
        mapped: rows under the transform.
        rows: (M,): indices of those to look at, rows of one sighting side by side.
        columns_at: of places (M, 3), px, of these rows: the columns (M, 3, k + F), mm, the transform's first.
        taken: (k, F): how much of each of these the others take up.
        levels: noise of a point, px, and of a segment's end, mm; both 0 where rows weigh alike.

    Returns:
        (F, F), products of whitened columns with one another, and (F,), with the residuals.

    Source: Fuller, Measurement Error Models, 1987, section 2.2.
    """
    turn = _turn_in_sighting(mapped, rows)
    beyond = np.vstack([-taken, np.eye(taken.shape[1])])
    products: Array = np.zeros((taken.shape[1] + 1,) * 2)
    for moved in moved_by_noise(mapped, rows, columns_at, levels[0]):
        both = np.concatenate([moved[..., :-1] @ beyond, moved[..., -1:]], axis=2)
        for one in range(int(turn.max()) + 1):  # each row of a sighting has noise of its own
            mine = both * (turn == one)[:, None, None]
            mine = np.concatenate([mine, mapped.residuals[rows][:, :, None]], axis=2)
            white = whitened(mapped, rows, mine, levels)[..., :-1].reshape(-1, len(products))
            products += white.T @ white
    return products[:-1, :-1], products[:-1, -1]


def _turn_in_sighting(mapped: MappedRows, rows: NDArray[np.int64]) -> NDArray[np.int64]:
    """(M,): which of its sighting's rows each is, counted from 0."""
    sightings = mapped.table.sightings
    if sightings is None or mapped.table.dimension == 2:
        return np.zeros(len(rows), dtype=np.int64)
    first = np.flatnonzero(np.diff(sightings[rows], prepend=-1))
    counts = np.diff(first, append=len(rows))
    return np.arange(len(rows)) - np.repeat(first, counts)
