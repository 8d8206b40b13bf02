"""Windows of a few seconds of a tool's poses: is there a point of it that rests, an axis that it turns about alone?"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.tools.poses import turns_deg

__all__ = ["Window", "pivot_windows", "spin_runs"]

WINDOW_S, STEP_S = 4.0, 1.0
SPIN_WINDOW_S, SPIN_STEP_S = 3.0, 0.75
FEWEST = 12
# A point rests within that, mm rms, and is told by turns about two axes of so many degrees rms.
RESTS_MM, TILT_DEG = 2.0, 4.0
# A window spins by so many degrees rms about one axis, and by so few across it; a whole spin by more.
TURN_DEG, ACROSS_DEG, WHOLE_TURN_DEG = 8.0, 1.5, 25.0
# A pose is of a spin while its axis points along that of the window, in degrees, and rests within mm across.
ALONG_DEG, BESIDE_MM = 3.0, 4.0
REGROWN = 6
BRIDGED_S, LEAST_SPIN_S = 1.0, 4.0


class Window(NamedTuple):
    """Items of a recording in which a point of the tool rests."""

    rows: NDArray[np.int64]
    tip_mm: Array
    spread_deg: float


def pivot_windows(matrices: Array, free: NDArray[np.bool_], times_s: Array) -> Iterator[Window]:
    """Windows of the poses (N, 4, 4) in which one point rests while the tool turns about two axes or more."""
    for rows in _windows(free, times_s, WINDOW_S, STEP_S):
        rotations, places = matrices[rows, :3, :3], matrices[rows, :3, 3]
        spread = turns_deg(rotations)[0]
        if spread < TILT_DEG:
            continue
        # The place of rest taken out: linear in the tip alone.
        system = (rotations - rotations.mean(axis=0)).reshape(-1, 3)
        right = -(places - places.mean(axis=0)).reshape(-1)
        tip = np.linalg.solve(system.T @ system, system.T @ right)
        left = (system @ tip - right).reshape(-1, 3)
        if np.sqrt(np.mean(np.sum(left**2, axis=1))) <= RESTS_MM:
            yield Window(rows, tip, spread)


def spin_runs(matrices: Array, free: NDArray[np.bool_], times_s: Array) -> Iterator[NDArray[np.int64]]:
    """Items of each stretch in which the tool turns about one axis alone, which keeps its place."""
    free = free.copy()
    for rows in _windows(free, times_s, SPIN_WINDOW_S, SPIN_STEP_S):
        if not free[rows].all():
            continue
        least, middle, most = turns_deg(matrices[rows, :3, :3])
        # Of a turn about one axis the axis itself stays, and what is at right angles to it turns alike.
        if most < TURN_DEG or least > ACROSS_DEG or middle < TURN_DEG / 2:
            continue
        run = _run_of(matrices, free, times_s, rows)
        if len(run) < FEWEST or times_s[run[-1]] - times_s[run[0]] < LEAST_SPIN_S:
            continue
        if turns_deg(matrices[run, :3, :3])[2] >= WHOLE_TURN_DEG:
            free[run[0] : run[-1] + 1] = False
            yield run


def _run_of(
    matrices: Array, free: NDArray[np.bool_], times_s: Array, rows: NDArray[np.int64]
) -> NDArray[np.int64]:
    """The items about a window in which its axis keeps its direction and its place, refined as it grows."""
    run = rows
    for _ in range(REGROWN):
        before, run = run, _grown(matrices, free, times_s, run)
        if len(run) < FEWEST or np.array_equal(before, run):
            break
    return run


def _grown(
    matrices: Array, free: NDArray[np.bool_], times_s: Array, rows: NDArray[np.int64]
) -> NDArray[np.int64]:
    """The items about some of a spin that share their axis."""
    rotations, places = matrices[:, :3, :3], matrices[:, :3, 3]
    u, _, vt = np.linalg.svd(rotations[rows].mean(axis=0))
    axis, direction = vt[0], u[:, 0]
    across = np.eye(3) - np.outer(direction, direction)
    # The axis' point that moves least across it, and where it is.
    system = across @ (rotations[rows] - rotations[rows].mean(axis=0))
    right = -(places[rows] - places[rows].mean(axis=0)) @ across
    point = np.linalg.lstsq(system.reshape(-1, 3), right.reshape(-1), rcond=1e-6)[0]
    there = (rotations @ point + places) @ across
    beside = np.linalg.norm(there - there[rows].mean(axis=0), axis=1)
    along = np.degrees(np.linalg.norm(rotations @ axis - direction, axis=1))
    of_it = np.flatnonzero(free & (along <= ALONG_DEG) & (beside <= BESIDE_MM))
    parts = np.split(of_it, np.flatnonzero(np.diff(times_s[of_it]) > BRIDGED_S) + 1)
    middle = rows[len(rows) // 2]
    return next((part for part in parts if len(part) and part[0] <= middle <= part[-1]), of_it[:0])


def _windows(
    free: NDArray[np.bool_], times_s: Array, length_s: float, step_s: float
) -> Iterator[NDArray[np.int64]]:
    """Items of windows, of which at least half of the poses count."""
    items = np.flatnonzero(free)
    if len(items) < FEWEST:
        return
    times = times_s[items]
    starts = np.arange(times[0], times[-1] - length_s + step_s, step_s)
    low, high = np.searchsorted(times, starts), np.searchsorted(times, starts + length_s)
    for a, b in zip(low, high, strict=True):
        rows = items[a:b]
        if (
            b - a >= FEWEST
            and 2 * (b - a) >= rows[-1] - rows[0] + 1
            and times[b - 1] - times[a] > length_s / 2
        ):
            yield rows
