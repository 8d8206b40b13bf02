"""Correspondences that are given more than once: a copy is no second measurement."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.constraints import Rows

__all__ = ["Distinct", "distinct_of"]


@dataclass(frozen=True, eq=False)
class Distinct:
    """The correspondences that differ.

    Attributes:
        rows: of each of them once, in the order given.
        first: (D,): where each was first given.
        of_each: (C,): which of them each correspondence is.
    """

    rows: Rows
    first: NDArray[np.int64]
    of_each: NDArray[np.int64]


def distinct_of(rows: Rows, beside: Array | None = None) -> Distinct | None:
    """The correspondences that differ in a number or in how many rows they have; None: all do.

    Args:
        rows: with their copies.
        beside: (C,), what else tells two apart.
    """
    count = len(rows.first) - 1
    if len(set(rows.planes[rows.first[:-1], 3].tolist())) == count:  # as nearly always: seen at a glance
        return None
    sizes = np.diff(rows.first)
    numbers = np.concatenate([rows.points, rows.planes], axis=1) + 0.0  # -0.0 and 0.0 are the same place
    further = np.zeros(count) if beside is None else beside
    first_like = np.arange(count)
    for size in np.unique(sizes):
        chosen = np.flatnonzero(sizes == size)
        own = numbers[rows.first[chosen][:, None] + np.arange(size)].reshape(len(chosen), -1)
        keys = np.column_stack([own, further[chosen]])
        packed = keys.view(np.dtype((np.void, keys.dtype.itemsize * keys.shape[1]))).reshape(-1)
        _, first, inverse = np.unique(packed, return_index=True, return_inverse=True)
        first_like[chosen] = chosen[first[inverse.reshape(-1)]]
    kept, of_each = np.unique(first_like, return_inverse=True)
    if len(kept) == count:
        return None
    once = np.isin(np.arange(count), kept)
    return Distinct(_with_lines(rows, once), kept, of_each.reshape(-1))


def _with_lines(rows: Rows, chosen: NDArray[np.bool_]) -> Rows:
    """The rows of the chosen correspondences (C,), as points on lines, too, where they were."""
    if rows.lines is None:
        return rows.select(chosen)
    each = len(rows.lines) // len(chosen)
    return replace(rows.select(chosen), lines=rows.lines.select(np.repeat(chosen, each)))
