"""What spans a target: one point a point, two a line, three a plane; as columns of a table."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, on_one_line

__all__ = [
    "SPANNING_COLUMNS",
    "flat_spans",
    "lengths_of",
    "of_spanning",
    "segments_of",
    "spans_of",
    "wrong_span",
]

SPANNING_COLUMNS = tuple(f"{axis}{point}_mm" for point in range(3) for axis in "xyz")
"""Of the first, the second and the third point."""


def spans_of(spanning_mm: Array) -> NDArray[np.int32]:
    """(N,): how many points of (N, 3, 3) span each target; the others are NaN throughout. 0: its place is not known.

    Returns -1 where a point is given in part, or follows one that is not given.
    """
    there = np.isfinite(spanning_mm)
    whole, some = np.all(there, axis=2), np.any(there, axis=2)
    in_order = (whole[:, 0] | ~whole.any(axis=1)) & (whole[:, 1] | ~whole[:, 2])
    sound = np.all(whole == some, axis=1) & in_order
    return np.where(sound, whole.sum(axis=1), -1).astype(np.int32)


def segments_of(spanning_mm: Array) -> Array:
    """(N, 2, 3): the first two points; of a point, that point twice."""
    segments = spanning_mm[:, :2].copy()
    alone = np.isnan(segments[:, 1]).all(axis=1)
    segments[alone, 1] = segments[alone, 0]
    return segments


def lengths_of(spans: NDArray[np.int32], segments_mm: Array) -> Array:
    """(M,), mm: of the first side (N, 2, 3) of what spans those of the targets (N,) that are no points."""
    sides = np.diff(segments_mm[spans >= 2], axis=1)[:, 0]
    return np.asarray(np.linalg.norm(sides, axis=1))


def of_spanning(columns: Mapping[str, Array]) -> dict[str, Array]:
    """What the table's class takes of columns with NaN where a cell is blank: lines where every row is one."""
    count = len(next(iter(columns.values())))
    absent = np.full(count, np.nan)
    spanning = np.column_stack([columns.get(name, absent) for name in SPANNING_COLUMNS]).reshape(-1, 3, 3)
    if np.isfinite(spanning[:, :2]).all() and np.isnan(spanning[:, 2]).all():
        return {"segments_mm": spanning[:, :2]}
    return {"segments_mm": segments_of(spanning), "spanning_mm": spanning}


def wrong_span(spanning_mm: Array, posed: NDArray[np.bool_] | None = None) -> tuple[int, str] | None:
    """The first row whose points span nothing, and why; None where all do, but for those that have a pose instead."""
    spans = spans_of(spanning_mm)
    partial = (spans < 0) | ((spans == 0) & ~(False if posed is None else posed))
    if partial.any() and posed is not None and spans[np.argmax(partial)] == 0:
        return int(np.argmax(partial)), "has neither points that span its target nor a pose; give one of them"
    if partial.any():
        return int(np.argmax(partial)), (
            "gives a point in part, or a later one without the one before it; fill in x, y and z of one point, of two "
            "for a line, of three for a plane"
        )
    short = flat_spans(spanning_mm[:, :2], np.minimum(spans, 2))
    if short.any():
        return int(np.argmax(short)), "has the same point twice; give two different ones of the line or plane"
    flat = flat_spans(spanning_mm, spans)
    if flat.any():
        return int(np.argmax(flat)), "has three points on one line, which span no plane; give three that do"
    return None


def flat_spans(spanning_mm: Array, spans: NDArray[np.int32]) -> NDArray[np.bool_]:
    """(N,): whether two points of a line are one, or three of a plane on one line; of points (N, K, 3)."""
    if spanning_mm.shape[1] < 2:
        return np.zeros(len(spans), dtype=bool)
    flat = (spans >= 2) & (np.linalg.norm(spanning_mm[:, 1] - spanning_mm[:, 0], axis=1) == 0)
    if spanning_mm.shape[1] == 3:
        flat |= (spans == 3) & on_one_line(spanning_mm)
    return np.asarray(flat)
