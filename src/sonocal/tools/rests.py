"""Where a stylus' tip rested in a long recording, and where: a touch, or a swivel about the resting tip.

The tip rests while means over a third of a second stay together; how close follows from the noise of its places.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["Rest", "find_rests", "noise_mm", "shared_inflation"]

# Of a hand in a divot, with a tip that is known to half a mm and turned about: closer is no motion, whatever the noise.
LEAST_REACH_MM = 1.0
NOISES = 4.0
SMOOTHED_S, LOOKED_S = 0.3, 0.7
# Between two parts of one touch: poses that were lost, or a jerk.
BRIDGED_S = 1.5
LEAST_S, LEAST_SAMPLES = 0.3, 5
# A fifth of normal places in space are nearer than so many deviations; second differences have six times the variance.
# The least tenth of all differences is taken for the least fifth of those at rest, which are half of them.
CHI3_FIFTH, SECOND = 1.0026, np.sqrt(6.0)
CUT, TRIMMED = 4.0, 3
BLOCK_S = 0.5


@dataclass(frozen=True, eq=False)
class Rest:
    """A stretch of a recording in which a tip rested.

    Attributes:
        first: item of the recording that it begins with.
        last: item that it ends with.
        rows: items of it that count: valid poses, without jerks.
        point_mm: (3,): where the tip was.
        covariance: (3, 3), mm^2, of that mean: counts that neighbours share their error.
        spread_mm: rms distance of a single place from it.
        duration_s: from the first to the last.
    """

    first: int
    last: int
    rows: NDArray[np.int64]
    point_mm: Array
    covariance: Array
    spread_mm: float
    duration_s: float

    __repr__ = brief


def find_rests(points_mm: Array, times_s: Array) -> list[Rest]:
    """The stretches in which a tip rested, in the order recorded.

    Args:
        points_mm: (N, 3): the tip's places; NaN where there is none.
        times_s: (N,), rising.
    """
    rows = np.flatnonzero(np.isfinite(points_mm).all(axis=1))
    if len(rows) < LEAST_SAMPLES:
        return []
    x, t = points_mm[rows], times_s[rows]
    reach = max(LEAST_REACH_MM, NOISES * noise_mm(x))
    still = _path(_smoothed(x, t), t) <= 2 * reach
    runs = [*_joined([*_runs(still, x, t)], x, t, reach)]
    found = [_rest(run, rows, x, t) for run in runs]
    sound = [
        rest
        for rest in found
        if len(rest.rows) >= LEAST_SAMPLES and rest.duration_s >= LEAST_S and rest.spread_mm <= 2 * reach
    ]
    return shared_inflation(sound, points_mm, times_s)


def noise_mm(x: Array) -> float:
    """Deviation per coordinate, from the least second differences: those of motion are larger."""
    second = np.linalg.norm(x[2:] - 2 * x[1:-1] + x[:-2], axis=1)
    return float(np.quantile(second, 0.1) / (CHI3_FIFTH * SECOND))


def _smoothed(x: Array, t: Array) -> Array:
    """(N, 3): the mean of the places within half of `SMOOTHED_S` of each."""
    low, high = _window(t, SMOOTHED_S / 2)
    sums = np.vstack([np.zeros(3), np.cumsum(x - x[0], axis=0)])
    return np.asarray((sums[high] - sums[low]) / (high - low)[:, None] + x[0])


def _path(y: Array, t: Array) -> Array:
    """(N,): how far the places within `LOOKED_S` about each reach: twice the furthest from their middle."""
    low, high = _window(t, LOOKED_S / 2)
    parts = (y[a:b] for a, b in zip(low, high, strict=True))
    return np.array([2 * np.linalg.norm(part - part.mean(axis=0), axis=1).max() for part in parts])


def _window(t: Array, half_s: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    return np.searchsorted(t, t - half_s), np.searchsorted(t, t + half_s, side="right")


def _runs(still: NDArray[np.bool_], x: Array, t: Array) -> Iterator[NDArray[np.int64]]:
    """Neighbours that are still, parted where too long a gap lies between two."""
    index = np.flatnonzero(still)
    if len(index):
        breaks = np.flatnonzero((np.diff(index) > 1) | (np.diff(t[index]) > BRIDGED_S)) + 1
        yield from np.split(index, breaks)


def _joined(
    runs: Sequence[NDArray[np.int64]], x: Array, t: Array, reach_mm: float
) -> Iterator[NDArray[np.int64]]:
    """Runs, with those that rest at one place one after another as one."""
    here: NDArray[np.int64] | None = None
    for run in runs:
        if here is None:
            here = run
        elif t[run[0]] - t[here[-1]] <= BRIDGED_S and _apart(x[here], x[run]) <= reach_mm:
            here = np.concatenate([here, run])
        else:
            yield here
            here = run
    if here is not None:
        yield here


def _apart(first: Array, second: Array) -> float:
    return float(np.linalg.norm(first.mean(axis=0) - second.mean(axis=0)))


def _rest(run: NDArray[np.int64], rows: NDArray[np.int64], x: Array, t: Array) -> Rest:
    """The rest of a run: without the approach at its ends and the jerks in it."""
    kept = run
    for _ in range(TRIMMED):
        off = np.linalg.norm(x[run] - x[kept].mean(axis=0), axis=1)
        # Of a normal distribution in space the median distance is 1.54 deviations.
        kept = run[off <= max(CUT * float(np.median(off)) / 1.538, 1e-6)]
    places = x[kept]
    mean = places.mean(axis=0)
    left = places - mean
    white = left.T @ left / (max(len(kept) - 1, 1) * len(kept))
    spread = float(np.sqrt(np.mean(np.sum(left**2, axis=1))))
    first, last = int(rows[kept[0]]), int(rows[kept[-1]])
    return Rest(first, last, rows[kept], mean, white, spread, float(t[kept[-1]] - t[kept[0]]))


def shared_inflation(rests: Sequence[Rest], points_mm: Array, times_s: Array) -> list[Rest]:
    """The rests with the variance of means as blocks of half a second show it, pooled over all of them.

    Neighbouring places share their error (a tremor, a marker seen at one angle): of one touch too few blocks say how
    much, of all together enough.
    """
    white = blocks = 0.0
    freedom = 0
    for rest in rests:
        parts = [points_mm[part] for part in _blocks(rest.rows, times_s)]
        if len(parts) < 2:
            continue
        means, sizes = (
            np.array([part.mean(axis=0) for part in parts]),
            np.array([len(part) for part in parts]),
        )
        centre = sizes @ means / sizes.sum()
        blocks += float(sizes @ np.sum((means - centre) ** 2, axis=1))
        white += (len(parts) - 1) * rest.spread_mm**2
        freedom += len(parts) - 1
    if freedom < 3 or white == 0:
        return list(rests)
    factor = max(1.0, blocks / white)
    return [replace(rest, covariance=rest.covariance * factor) for rest in rests]


def _blocks(rows: NDArray[np.int64], times_s: Array) -> list[NDArray[np.int64]]:
    times = times_s[rows]
    count = max(1, int((times[-1] - times[0]) / BLOCK_S))
    return [part for part in np.array_split(rows, count) if len(part)]
