"""Answers for targets whose place is asked for: from nothing, from targets that are known, and under a lag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import SonocalError
from sonocal.geometry import Array, Similarity
from sonocal.geometry.shown import brief
from sonocal.registration.constraints import point_line, point_plane, point_point
from sonocal.registration.constraints import rows as rows_of
from sonocal.registration.register import register
from sonocal.registration.unplaced_rows import UnplacedRows
from sonocal.registration.unplaced_time import PosesInTime

__all__ = ["Found", "find", "find_under_lag"]

# Of which one is near enough to go on from.
LAGS_S = tuple(0.05 * step for step in (0, 1, -1, 2, -2, 3, -3, 4, -4))
MOST_LAG_STEPS = 8
LAG_AT_REST_S = 1e-5
# Rows of known targets that may tell the similarity by themselves.
FEWEST_KNOWN = 6


@dataclass(frozen=True, eq=False)
class Found:
    """Answers, the best first, and the rows that they are of.

    Attributes:
        rows: with their poses where they were taken from.
        answers: the core's.
        known: (N,): rows of those given whose pose is known, in the order of their instants.
        lag_s: undone in the rows' poses; None where none was asked for.
        with_lag: covariance of the best, with the lag behind the transform.
    """

    rows: UnplacedRows
    answers: list[_core.FoundPlaces]
    known: NDArray[np.bool_]
    lag_s: float | None = None
    with_lag: Array | None = None

    __repr__ = brief


def find(rows: UnplacedRows, start: Similarity | None, how: dict[str, Any]) -> Found:
    """Answers from nothing, or from a start, or from what rows of known targets say by themselves."""
    every = np.ones(len(rows.points), dtype=bool)
    if start is not None:
        return Found(rows, _from(rows, start, how), every)
    answers = rows.find(start=None, **how) if _some_unknown(rows) else []
    told = _by_known(rows, how["threshold_mm"], how["seed"])
    if told is not None:
        answers += _from(rows, told, how)
    return Found(rows, sorted(answers, key=lambda one: _score(one, how["threshold_mm"])), every)


def find_under_lag(timed: PosesInTime, start: Similarity | None, how: dict[str, Any]) -> Found:
    """Answers, with how much later poses are stamped than images: the best of some lags, then fitted.

    Raises:
        DegenerateGeometryError: hardly anything moves.
    """
    best, lag = None, 0.0
    for tried in LAGS_S:
        rows, known = timed.at(tried, smoothed=True)
        found = find(rows, start, how) if known.any() else Found(rows, [], known)
        better = found.answers and (best is None or _mean_score(found, how) < _mean_score(best, how))
        best, lag = (found, tried) if better else (best, lag)
    if best is None:
        return Found(timed.rows, [], np.ones(len(timed.rows.points), dtype=bool))
    near = best.answers[0]
    for _ in range(MOST_LAG_STEPS):
        rows, known = timed.at(lag, smoothed=True)
        answers = rows.find(start=_matrix(near), changes=timed.changes(lag, known), **how)
        if not answers:
            break
        near = answers[0]
        lag += float(np.clip(near.lag_s, -0.5 * LAGS_S[1], 0.5 * LAGS_S[1]))
        if abs(near.lag_s) < LAG_AT_REST_S:
            break
    rows, known = timed.at(lag, smoothed=False)
    answers = rows.find(start=_matrix(near), **how)
    with_lag = rows.find(start=_matrix(near), changes=timed.changes(lag, known), **how) if answers else []
    covariance = with_lag[0].covariance * timed.averaging(lag) if with_lag else None
    return Found(rows, answers if with_lag else [], known, lag, covariance)


def _from(rows: UnplacedRows, start: Similarity, how: dict[str, Any]) -> list[_core.FoundPlaces]:
    return rows.find(start=np.ascontiguousarray(start.matrix), **how)


def _matrix(found: _core.FoundPlaces) -> Array:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = found.rotation * found.scales, found.translation
    return matrix


def _some_unknown(rows: UnplacedRows) -> bool:
    return any(rows.targets[k].spanning_mm is None for k in np.unique(rows.target))


def _by_known(rows: UnplacedRows, threshold_mm: float, seed: int) -> Similarity | None:
    """The similarity that rows of targets say whose place is known, if only roughly."""
    parts, count = [], 0
    for k, target in enumerate(rows.targets):
        mine = np.flatnonzero(rows.target == k)
        if target.spanning_mm is None or not len(mine):
            continue
        count += len(mine)
        poses = rows.poses[mine]
        spanning = target.spanning_mm @ np.swapaxes(poses[:, :, :3], 1, 2) + poses[:, None, :, 3]
        points = rows.points[mine]
        if target.spans == 1:
            parts.append(point_point(points, spanning[:, 0]))
        else:
            parts.append((point_line if target.spans == 2 else point_plane)(points, spanning))
    if count < FEWEST_KNOWN:
        return None
    try:
        return register(rows_of(*parts), threshold_mm=threshold_mm, seed=seed).target_from_source
    except SonocalError:
        return None


def _score(found: _core.FoundPlaces, threshold_mm: float) -> float:
    return float(np.sum(np.minimum(found.distances, threshold_mm) ** 2))


def _mean_score(found: Found, how: dict[str, Any]) -> float:
    return _score(found.answers[0], how["threshold_mm"]) / len(found.rows.points)
