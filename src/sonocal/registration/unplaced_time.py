"""Poses that are known at some instants, at others: where a lag of the tracker leads."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import DegenerateGeometryError, InputError
from sonocal.geometry import Array, real_array
from sonocal.geometry.shown import brief
from sonocal.registration.unplaced_rows import UnplacedRows

__all__ = ["PosesInTime", "poses_later"]

# Between two poses further apart nothing is known of the way.
LONGEST_GAP_S = 1.0
# Derivatives are taken over so much.
STEP_S = 0.005
# Where the way is smoothed: frames looked at, and up to how many of their intervals away they count.
NEIGHBOURS, REACH = 9, 4.0
# Root mean square speed of what is seen, below which no lag shows.
LEAST_SPEED_MM_S = 1.0


@dataclass(frozen=True, eq=False)
class PosesInTime:
    """Rows whose poses are taken from another moment.

    Between two frames the mean of their poses is less noisy than either, so that rows would agree best there, whatever
    the lag: it is looked for along a smoothed way, which is as noisy anywhere.

    Attributes:
        rows: with their poses as they are stamped.
        time_s: (N,): of each row's image, in the rows' order.
        tracks: of each target: the times (F,) and poses (F, 3, 4) that are known.
    """

    rows: UnplacedRows
    time_s: Array
    tracks: tuple[tuple[Array, Array], ...]

    __repr__ = brief

    @classmethod
    def of(cls, rows: UnplacedRows, time_s: ArrayLike) -> PosesInTime:
        """The rows with the time of each as they were given.

        Raises:
            InputError: there is not one finite time a row.
        """
        given = real_array("time_s", time_s)
        if given.shape != (len(rows.points),) or not np.isfinite(given).all():
            raise InputError(
                f"time_s must be {len(rows.points)} finite numbers, one a row; got {given.shape}"
            )
        time = given[rows.order]
        tracks = []
        for k in range(len(rows.targets)):
            mine = np.flatnonzero(rows.target == k)
            times, first = np.unique(time[mine], return_index=True)
            tracks.append((times, rows.poses[mine[first]]))
        return cls(rows, time, tuple(tracks))

    def at(self, lag_s: float, *, smoothed: bool) -> tuple[UnplacedRows, NDArray[np.bool_]]:
        """The rows with poses of so much later, those of which they are known, and (N,) which those are."""
        poses = self._poses(lag_s, _smoothed if smoothed else _between)
        known = np.isfinite(poses[:, 0, 0])
        chosen = np.flatnonzero(known)
        rows = self.rows
        moved = replace(
            rows,
            points=np.ascontiguousarray(rows.points[chosen]),
            poses=np.ascontiguousarray(poses[chosen]),
            group=np.ascontiguousarray(rows.group[chosen]),
            target=np.ascontiguousarray(rows.target[chosen]),
            order=np.arange(len(chosen)),
        )
        return moved, known

    def changes(self, lag_s: float, known: NDArray[np.bool_]) -> Array:
        """(M, 3, 4): derivatives of the targets' poses of the marker by the lag, of some rows.

        Raises:
            DegenerateGeometryError: hardly anything moves.
        """
        before, after = (self._poses(lag_s + step, _smoothed)[known] for step in (-STEP_S, STEP_S))
        derivative = np.nan_to_num((_inverse(after) - _inverse(before)) / (2.0 * STEP_S))
        speed = np.nan_to_num(np.linalg.norm(after[:, :, 3] - before[:, :, 3], axis=1) / (2.0 * STEP_S))
        if not np.sqrt(np.mean(speed**2)) > LEAST_SPEED_MM_S:
            raise DegenerateGeometryError(
                "the probe and its target hardly move, so that no lag shows; scan without stops, or leave the lag out",
                "lag-untold",
            )
        return np.ascontiguousarray(derivative)

    def averaging(self, lag_s: float) -> float:
        """How much less the variance of a pose is between two frames, whose poses neighbours share: 1 to 2."""
        parts = [np.ones(1)]
        for k, (times, _) in enumerate(self.tracks):
            after, share = _places(times, self.time_s[self.rows.target == k] + lag_s)
            share = share[(share >= 0) & (share <= 1) & (after > 0)]
            parts.append(1.0 / (share**2 + (1.0 - share) ** 2))
        return float(np.mean(np.concatenate(parts)))

    def _poses(self, lag_s: float, way: Callable[[Array, Array, Array], Array]) -> Array:
        poses = np.full_like(self.rows.poses, np.nan)
        for k, (times, known) in enumerate(self.tracks):
            mine = self.rows.target == k
            if len(times) > 1:
                poses[mine] = way(times, known, self.time_s[mine] + lag_s)
        return poses


def poses_later(poses: ArrayLike, target: ArrayLike, time_s: ArrayLike, lag_s: float) -> Array:
    """(N, 3, 4): poses (N, 4, 4) of targets (N,) so much later than at their times (N,).

    Where they are not known then, as they were.
    """
    given, which, times = (np.asarray(one) for one in (poses, target, time_s))
    later = np.array(given[:, :3])
    for k in np.unique(which):
        mine = np.flatnonzero(which == k)
        distinct, first = np.unique(times[mine], return_index=True)
        if len(distinct) < 2:
            continue
        there = _between(distinct, given[mine[first], :3], times[mine] + lag_s)
        later[mine] = np.where(np.isfinite(there), there, later[mine])
    return later


def _places(times: Array, at: Array) -> tuple[NDArray[np.int64], Array]:
    """The first of the times (F,) that is later than each of others (M,), and the share of the way to it."""
    after = np.clip(np.searchsorted(times, at, side="right"), 1, len(times) - 1)
    return after, (at - times[after - 1]) / (times[after] - times[after - 1])


def _between(times: Array, poses: Array, at: Array) -> Array:
    """(M, 3, 4): poses (F, 3, 4) at other times (M,): a steady turn and shift from one to the next; NaN beyond."""
    from scipy.spatial.transform import Rotation

    after, share = _places(times, at)
    inside = (share > -1e-9) & (share < 1 + 1e-9) & (times[after] - times[after - 1] < LONGEST_GAP_S)
    out = np.full((len(at), 3, 4), np.nan)
    if not inside.any():
        return out
    first, second, part = poses[after - 1][inside], poses[after][inside], share[inside, None]
    turn = Rotation.from_matrix(second[:, :, :3] @ np.swapaxes(first[:, :, :3], 1, 2)).as_rotvec()
    ways = [_way(one) for one in (first, second)]
    out[inside] = _led(first[:, :, :3], part * turn, ways[0] + part * (ways[1] - ways[0]))
    return out


def _smoothed(times: Array, poses: Array, at: Array) -> Array:
    """(M, 3, 4): of parabolas through the poses about each of other times (M,); NaN beyond, and in gaps."""
    from scipy.spatial.transform import Rotation

    count, reach = min(NEIGHBOURS, len(times)), REACH * float(np.median(np.diff(times)))
    nearest = np.clip(np.searchsorted(times, at), 0, len(times) - 1)
    near = np.clip(nearest - count // 2, 0, len(times) - count)[:, None] + np.arange(count)
    away = (times[near] - at[:, None]) / reach
    weight = np.clip(1.0 - away**2, 0.0, None)
    inside = (at >= times[0]) & (at <= times[-1]) & (np.count_nonzero(weight, axis=1) > 3)
    out = np.full((len(at), 3, 4), np.nan)
    if not inside.any():
        return out
    near, away, weight, home = near[inside], away[inside], weight[inside], poses[nearest[inside], :, :3]
    turns = poses[near][:, :, :, :3] @ np.swapaxes(home, 1, 2)[:, None]
    vectors = Rotation.from_matrix(turns.reshape(-1, 3, 3)).as_rotvec().reshape(*near.shape, 3)
    values = np.concatenate([vectors, _way(poses)[near]], axis=2)
    basis = away[:, :, None] ** np.arange(3)
    square = np.einsum("mka,mk,mkb->mab", basis, weight, basis)
    right = np.einsum("mka,mk,mkc->mac", basis, weight, values)
    now = np.linalg.solve(square, right)[:, 0]
    out[inside] = _led(home, now[:, :3], now[:, 3:])
    return out


def _way(poses: Array) -> Array:
    """(F, 3): where the probe's marker is past its target, as a hand leads it: smoother than the other way round."""
    ways: Array = -np.einsum("nji,nj->ni", poses[:, :, :3], poses[:, :, 3])
    return ways


def _led(home: Array, turn: Array, way: Array) -> Array:
    """(M, 3, 4): poses by turns (M, 3) from rotations (M, 3, 3), and where the probe's marker is."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(turn).as_matrix() @ home
    return np.concatenate([rotation, -np.einsum("nij,nj->ni", rotation, way)[:, :, None]], axis=2)


def _inverse(poses: Array) -> Array:
    turned = np.swapaxes(poses[:, :, :3], 1, 2)
    return np.concatenate([turned, -turned @ poses[:, :, 3:]], axis=2)
