"""Places of a phantom from a few measured features, from nothing: directions give the turn, the rest is linear.

    R d_k = +-e_k        d: along a line, or normal to a plane, of the phantom; e: as it was dragged along
    n . (R^T (y - t) - q) = 0 for given R: linear in R^T t

The sign of a direction is free unless a face knows its outside: every choice of signs is a start, and Gauss and
Newton's steps bring it to rest. `sonocal.registration.register` solves the same rows, and refuses so few: as many might
agree by chance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise, product

import numpy as np

from sonocal.geometry import Array
from sonocal.tools.feature_fit import Measured, settled

__all__ = ["feature_poses"]

# Of signs that are free: more directions follow from these.
MOST_SIGNS = 3
# Directions that are no further from one another tell no turn about them, sine.
LEAST_SINE = 0.1
SAME_MM, SAME_RAD = 0.5, 0.01


def feature_poses(measured: Sequence[Measured], directions: Sequence[tuple[Array, bool]]) -> list[Array]:
    """Places (4, 4) of the phantom that bring features to what was measured of them: rests of the least squares.

    Args:
        measured: of each feature.
        directions: of each, as measured; and whether its sign is that of the feature. Of points: any.
    """
    found: list[Array] = []
    for turn in _turns(measured, directions):
        start = np.eye(4)
        start[:3, :3] = turn
        start[:3, 3] = _shift(measured, turn)
        pose = settled(measured, start, 0.1)
        if not any(_same(pose, other) for other in found):
            found.append(pose)
    return found


def _turns(measured: Sequence[Measured], directions: Sequence[tuple[Array, bool]]) -> Iterator[Array]:
    known, free = _vectors(measured, directions)
    chosen = _independent(free)
    for signs in product((1.0, -1.0), repeat=len(chosen)):
        pairs = known + [(free[k][0], s * free[k][1]) for k, s in zip(chosen, signs, strict=True)]
        turn = _fitted(pairs)
        if turn is None:
            return
        # The other signs follow.
        others = [(d, e if e @ turn @ d > 0 else -e) for k, (d, e) in enumerate(free) if k not in chosen]
        again = _fitted(pairs + others)
        if again is not None:
            yield again


def _vectors(
    measured: Sequence[Measured], directions: Sequence[tuple[Array, bool]]
) -> tuple[list[tuple[Array, Array]], list[tuple[Array, Array]]]:
    """Unit vectors of the phantom with what they were measured as; those whose sign is free apart."""
    known: list[tuple[Array, Array]] = []
    free: list[tuple[Array, Array]] = []
    points = [one for one in measured if one.feature.kind == "point"]
    for one, other in pairwise(points):
        step = other.feature.spanning_mm[0] - one.feature.spanning_mm[0]
        seen = other.places_mm[0] - one.places_mm[0]
        known.append((step / np.linalg.norm(step), seen / max(float(np.linalg.norm(seen)), 1e-9)))
    for one, (direction, signed) in zip(measured, directions, strict=True):
        if one.feature.kind != "point":
            (known if signed else free).append((one.feature.direction, direction))
    return known, free


def _independent(free: Sequence[tuple[Array, Array]]) -> list[int]:
    chosen: list[int] = []
    for k, (direction, _) in enumerate(free):
        apart = [np.linalg.norm(np.cross(direction, free[m][0])) for m in chosen]
        if len(chosen) < MOST_SIGNS and all(sine > LEAST_SINE for sine in apart):
            chosen.append(k)
    return chosen


def _fitted(pairs: Sequence[tuple[Array, Array]]) -> Array | None:
    """The turn of vectors onto vectors; None where they are all along one. Source: Wahba 1965, by Markley 1988."""
    if len(pairs) < 2:
        return None
    moment = sum(np.outer(there, here) for here, there in pairs)
    u, sizes, vt = np.linalg.svd(moment)
    if sizes[1] < LEAST_SINE**2:
        return None
    return np.asarray(u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt)


def _shift(measured: Sequence[Measured], turn: Array) -> Array:
    rows = np.concatenate([one.normals @ turn.T for one in measured])
    right = np.concatenate(
        [one.normals @ (turn.T @ one.places_mm[0] - one.feature.spanning_mm[0]) for one in measured]
    )
    return np.asarray(np.linalg.lstsq(rows, right, rcond=1e-9)[0])


def _same(first: Array, second: Array) -> bool:
    moved = first - second
    return bool(np.abs(moved[:3, 3]).max() < SAME_MM and np.abs(moved[:3, :3]).max() < SAME_RAD)
