"""Where a stylus' tip was dragged along something straight or flat, in a long recording: stretches, line or plane each.

A tip that is led along a face stays in one plane within its noise while it goes to and fro; along an edge, on one line.
Each stretch is grown from a window that is straight, or flat and no line, for as long as what comes next still is. A
hand's way through the air may be as flat for a moment, and may go on in the plane of an edge: so stretches may share
items, and which of them are of the phantom is for its shape to say (`match_features`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.tools.rests import noise_mm

__all__ = ["Drag", "dragged_primitive", "find_drags"]

# Of a window to begin with, and of a whole drag.
WINDOWS_S, STEP_S = (6.0, 4.0, 2.8, 2.0), 0.4
LEAST_S, LEAST_SAMPLES = 2.0, 20
# Off a line or a plane: so many deviations of the tip's noise, which a face's own roughness has beside it, mm.
NOISES, LEAST_OFF_MM = 4.0, 0.8
# Rms along the line, or along the shorter side of what was covered of a plane.
LONG_MM, WIDE_MM = 6.0, 3.0
BRIDGED_S = 1.0
REGROWN = 8
BLOCK_S = 0.5
# Two stretches of one kind that share more than this part of the shorter one are one.
SHARED = 0.6


@dataclass(frozen=True, eq=False)
class Drag:
    """A stretch of a recording in which a tip went along a line or a plane.

    Attributes:
        kind: "line" or "plane".
        rows: items of it that count.
        middle_mm: (3,): mean of the tip's places.
        axes: (3, 3): rows: along it first, the normal of a plane last.
        reach_mm: (3,): rms of the places from their middle along each of the axes.
        samples: how many independent places it is worth: neighbours share their error.
    """

    kind: str
    rows: NDArray[np.int64]
    middle_mm: Array
    axes: Array
    reach_mm: Array
    samples: float

    __repr__ = brief

    @property
    def first(self) -> int:
        """Item of the recording that it begins with."""
        return int(self.rows[0])

    @property
    def last(self) -> int:
        """Item that it ends with."""
        return int(self.rows[-1])

    @property
    def across(self) -> int:
        """How many of the axes, from the last on, lead off it."""
        return 2 if self.kind == "line" else 1

    @property
    def variance_mm2(self) -> float:
        """Of one place, off it along an axis."""
        freedom = self.across * len(self.rows) - (4 if self.kind == "line" else 3)
        off = np.sum(self.reach_mm[3 - self.across :] ** 2) * len(self.rows)
        return float(off / max(freedom, 1))


def find_drags(points_mm: Array, times_s: Array) -> list[Drag]:
    """Stretches in which a tip went along a line or a plane, in the order recorded; some may share items.

    Args:
        points_mm: (N, 3): the tip's places; NaN where there is none.
        times_s: (N,), rising.
    """
    rows = np.flatnonzero(np.isfinite(points_mm).all(axis=1))
    if len(rows) < LEAST_SAMPLES:
        return []
    off_mm = max(LEAST_OFF_MM, NOISES * noise_mm(points_mm[rows]))
    found = [drag for kind in ("line", "plane") for drag in _drags_of(kind, points_mm, times_s, rows, off_mm)]
    return sorted(with_shared_errors(found, points_mm, times_s), key=lambda drag: drag.first)


def dragged_primitive(kind: str, rows: NDArray[np.int64], points_mm: Array) -> Drag:
    """The line or plane next to places of a tip, in least squares."""
    places = points_mm[rows]
    middle = places.mean(axis=0)
    _, sizes, axes = np.linalg.svd(places - middle, full_matrices=False)
    return Drag(kind, rows, middle, axes, sizes / np.sqrt(len(rows)), float(len(rows)))


def with_shared_errors(drags: Sequence[Drag], points_mm: Array, times_s: Array) -> list[Drag]:
    """The drags with as many independent places as blocks of half a second show, pooled over all of them."""
    white = blocks = 0.0
    freedom = 0
    for drag in drags:
        off = (points_mm[drag.rows] - drag.middle_mm) @ drag.axes[3 - drag.across :].T
        parts = [part for part in np.array_split(off, _blocks(drag, times_s)) if len(part)]
        if len(parts) < 3:
            continue
        blocks += sum(len(part) * float(np.sum(part.mean(axis=0) ** 2)) for part in parts)
        white += len(parts) * float(np.sum(np.mean(off**2, axis=0)))
        freedom += len(parts)
    factor = max(1.0, blocks / white) if freedom >= 6 and white > 0 else 1.0
    return [replace(drag, samples=len(drag.rows) / factor) for drag in drags]


def _blocks(drag: Drag, times_s: Array) -> int:
    return max(1, int((times_s[drag.last] - times_s[drag.first]) / BLOCK_S))


def _drags_of(
    kind: str, points: Array, times: Array, rows: NDArray[np.int64], off_mm: float
) -> Iterator[Drag]:
    kept: list[Drag] = []
    taken = np.zeros(len(points), dtype=bool)
    for window in _windows(times, rows):
        if taken[window].mean() > SHARED or not _is(kind, dragged_primitive(kind, window, points), off_mm):
            continue
        drag = _grown(dragged_primitive(kind, window, points), points, times, rows, off_mm)
        if drag is None or any(_shared(drag, other) > SHARED for other in kept):
            continue
        taken[drag.rows] = True
        kept.append(drag)
    yield from kept


def _windows(times: Array, rows: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Long windows first: what is flat for long is no way through the air."""
    stamps = times[rows]
    for length in WINDOWS_S:
        starts = np.arange(stamps[0], stamps[-1] - length + STEP_S, STEP_S)
        low, high = np.searchsorted(stamps, starts), np.searchsorted(stamps, starts + length)
        for a, b in zip(low, high, strict=True):
            if b - a >= LEAST_SAMPLES:
                yield rows[a:b]


def _is(kind: str, drag: Drag, off_mm: float) -> bool:
    """Whether places are of a line, or of a plane and no line."""
    along = drag.reach_mm[0] >= LONG_MM
    wide = drag.reach_mm[1] >= WIDE_MM
    across = drag.reach_mm[3 - drag.across :]
    flat = bool(np.all(across <= off_mm / 2))
    return bool(flat and along and (kind == "line" or wide))


def _grown(begun: Drag, points: Array, times: Array, rows: NDArray[np.int64], off_mm: float) -> Drag | None:
    """The stretch about a window that is on its line or plane, refined as it grows; None if it is too short."""
    kind, run = begun.kind, begun.rows
    middle = run[len(run) // 2]
    for _ in range(REGROWN):
        drag = dragged_primitive(kind, run, points)
        near = _near(drag, points, rows, off_mm)
        parts = np.split(near, np.flatnonzero(np.diff(times[near]) > BRIDGED_S) + 1)
        part = next((part for part in parts if len(part) and part[0] <= middle <= part[-1]), near[:0])
        if len(part) < LEAST_SAMPLES // 2 or np.array_equal(part, run):
            break
        # Not further than as much again: a plane of a short window is not known far from it.
        reach = len(run)
        low, high = np.searchsorted(part, [run[0], run[-1] + 1])
        run = part[max(0, low - reach) : high + reach]
    drag = dragged_primitive(kind, run, points)
    long_enough = len(run) >= LEAST_SAMPLES and times[run[-1]] - times[run[0]] >= LEAST_S
    return drag if long_enough and _is(kind, drag, off_mm) else None


def _near(drag: Drag, points: Array, rows: NDArray[np.int64], off_mm: float) -> NDArray[np.int64]:
    """The items whose place is on it, and in the midst of others that are: one alone may cross it."""
    off = np.linalg.norm((points[rows] - drag.middle_mm) @ drag.axes[3 - drag.across :].T, axis=1)
    near = off <= off_mm
    padded = np.pad(near.astype(float), 2, mode="edge")
    company = np.convolve(padded, np.ones(5), mode="valid")
    return np.asarray(rows[near & (company >= 3)])


def _shared(first: Drag, second: Drag) -> float:
    both = len(np.intersect1d(first.rows, second.rows, assume_unique=True))
    return both / min(len(first.rows), len(second.rows))
