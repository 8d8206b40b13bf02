"""A phantom's place from touched points and from lines and planes that a stylus was dragged along, weighed.

Of what was measured of a feature k a few numbers are left when the phantom is at R, t, each of the same noise:

    point   R^T (y - t) - x                            3       y: where the tip rested, x: the landmark
    line    U^T (R^T (c - t) - q), a U^T R^T e         4       c, e, a: middle, direction and rms reach of the drag
    plane   n . (R^T (c - t) - q), a_i n . R^T e_i     3       e_1, e_2: of the drag's plane

    min over R, t of sum r_k' r_k / (v_k + tau^2)      of directions: v_k + tau^2 / 4

A drag is worth as many places as are independent; `tau` is what touches and features are off by beyond that, so that
the sum comes to its freedom (Paule and Mandel 1982): faces are printed, edges are round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.tools.drags import Drag
from sonocal.tools.features import Feature
from sonocal.tools.landmark_fit import excess_variance
from sonocal.tools.rests import Rest

__all__ = ["FeatureMotion", "Measured", "fit_features", "measured_of", "settled"]

# A feature is left out when chance puts one so far off once in so many registrations, and when it matters, mm.
CHANCE, MATTERS_MM = 0.01, 1.0
FEWEST_TO_DROP = 5
STEPS, AT_REST = 30, 1e-10
SPARE = 3
# Of faces that are off by a shift: a tilt moves them, rms, by half of it, in variance.
TILT = 0.25


@dataclass(frozen=True, eq=False)
class Measured:
    """What was measured of a feature.

    Attributes:
        feature: it.
        places_mm: (P, 3): one place, with the steps to others: the middle, then reach times direction.
        variance_mm2: of each of the numbers that are left of it.
    """

    feature: Feature
    places_mm: Array
    variance_mm2: float

    __repr__ = brief

    @cached_property
    def normals(self) -> Array:
        """(M, 3): along which it is held, in the phantom's frame."""
        return self.feature.normals

    @cached_property
    def rows(self) -> _Rows:
        """The numbers that are left of it."""
        return _Rows.of([self])

    def distance_mm(self, motion: Array) -> float:
        """Of what was touched or dragged along from the feature: root mean square over it."""
        return float(np.linalg.norm(self.rows.residuals(motion)))


class _Rows(NamedTuple):
    """Numbers that are left of features, each along a normal: of a place, or of a direction, that a shift leaves alone.

    Attributes:
        normals: (K, 3), in the phantom's frame.
        seen: (K, 3): a place, or a direction, as measured.
        told: (K,): of places, along the normal, in the phantom's frame.
        is_place: (K,): 1, or 0.
        variance: (K,), mm^2.
    """

    normals: Array
    seen: Array
    told: Array
    is_place: Array
    variance: Array

    @classmethod
    def of(cls, measured: Sequence[Measured]) -> _Rows:
        normals, seen, told, is_place, variance = [], [], [], [], []
        for one in measured:
            count, held = len(one.places_mm), len(one.normals)
            normals.append(np.tile(one.normals, (count, 1)))
            seen.append(np.repeat(one.places_mm, held, axis=0))
            first = np.repeat(np.arange(count) == 0, held).astype(float)
            is_place.append(first)
            told.append(first * (normals[-1] @ one.feature.spanning_mm[0]))
            variance.append(np.full(count * held, max(one.variance_mm2, 1e-12)))
        return cls(*(np.concatenate(parts) for parts in (normals, seen, told, is_place, variance)))

    def with_excess(self, tau2: float) -> Array:
        """(K,) mm^2: with what features are off by beyond their noise, and what a tilt of theirs adds at the reach."""
        return np.asarray(self.variance + tau2 * (TILT + (1 - TILT) * self.is_place))

    def residuals(self, motion: Array) -> Array:
        """(K,) mm, of the phantom at (4, 4)."""
        at = (self.seen - self.is_place[:, None] * motion[:3, 3]) @ motion[:3, :3]
        return np.asarray(np.einsum("ij,ij->i", self.normals, at) - self.told)

    def jacobian(self, motion: Array) -> Array:
        """(K, 6): of that, by the turn (on the left) and the shift of the phantom."""
        turned = self.normals @ motion[:3, :3].T
        x, y = (self.seen - self.is_place[:, None] * motion[:3, 3]).T, turned.T
        arms = np.stack(
            [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]], axis=1
        )
        return np.hstack([-arms, -self.is_place[:, None] * turned])

    def information(self, motion: Array, tau2: float) -> Array:
        """(6, 6): inverse of the covariance of the turn and shift."""
        jacobian = self.jacobian(motion)
        return np.asarray(jacobian.T @ (jacobian / (self.with_excess(tau2))[:, None]))

    def settled(self, start: Array, tau2: float) -> Array:
        """The motion (4, 4) of least squares: Gauss and Newton's steps until these are at rest."""
        from scipy.spatial.transform import Rotation

        matrix, root = start.copy(), 1 / np.sqrt(self.with_excess(tau2))
        for _ in range(STEPS):
            jacobian = root[:, None] * self.jacobian(matrix)
            step = -np.linalg.lstsq(jacobian, root * self.residuals(matrix), rcond=1e-10)[0]
            matrix[:3, :3] = Rotation.from_rotvec(step[:3]).as_matrix() @ matrix[:3, :3]
            matrix[:3, 3] += step[3:]
            if np.abs(step).max() < AT_REST:
                break
        return matrix


@dataclass(frozen=True, eq=False)
class FeatureMotion:
    """A phantom's place.

    Attributes:
        matrix: (4, 4): reference from phantom.
        covariance: (6, 6): rotation (rad) and translation (mm).
        freedom: of the residuals.
        used: (M,): the features that agree.
        tau_mm: what features are off by, a number, beyond their noise.
        scale: of the similarity beside it; 1 where the features do not tell one.
        scale_deviation: of it; infinite there.
    """

    matrix: Array
    covariance: Array
    freedom: int
    used: NDArray[np.bool_]
    tau_mm: float
    scale: float
    scale_deviation: float

    __repr__ = brief


def measured_of(feature: Feature, seen: Sequence[Rest | Drag]) -> Measured:
    """What touches of a landmark, or drags along a line or plane, say together: of several drags the longest."""
    rests = [one for one in seen if isinstance(one, Rest)]
    if rests:
        place = np.mean([rest.point_mm for rest in rests], axis=0)
        variance = np.mean([np.trace(rest.covariance) / 3 for rest in rests]) / len(rests)
        return Measured(feature, place[None], float(variance))
    drag = max((one for one in seen if isinstance(one, Drag)), key=lambda one: len(one.rows))
    steps = drag.axes[: 3 - drag.across] * drag.reach_mm[: 3 - drag.across, None]
    return Measured(feature, np.vstack([drag.middle_mm, steps]), drag.variance_mm2 / drag.samples)


def fit_features(measured: Sequence[Measured], start: Array) -> FeatureMotion:
    """The phantom's place from what was measured, from a place (4, 4) near it."""
    used = np.ones(len(measured), dtype=bool)
    for _ in range(len(used) // 4):
        worst = _worst(measured, start, used) if used.sum() >= FEWEST_TO_DROP else None
        if worst is None:
            break
        used[worst] = False
    rows = _Rows.of([one for one, is_used in zip(measured, used, strict=True) if is_used])
    matrix, tau2 = _weighed(rows, start)
    covariance = np.asarray(np.linalg.pinv(rows.information(matrix, tau2)))
    freedom = len(rows.told) - 6
    return FeatureMotion(matrix, covariance, freedom, used, float(np.sqrt(tau2)), *_scale(rows, matrix, tau2))


def settled(measured: Sequence[Measured], start: Array, tau2: float) -> Array:
    """The place (4, 4) of least squares near a start, every number of so much variance beyond its own, mm^2."""
    return _Rows.of(measured).settled(start, tau2)


def _weighed(rows: _Rows, start: Array) -> tuple[Array, float]:
    """The motion, and tau^2."""
    freedom, near = len(rows.told) - 6, [start]

    def over(tau2: float) -> tuple[float, Array]:
        near[0] = rows.settled(near[0], tau2)
        squares = rows.residuals(near[0]) ** 2 / rows.with_excess(tau2)
        # Of places by themselves, too: edges that are straight, and off, would hide it among their directions.
        of_places = float(squares @ rows.is_place) - freedom * float(rows.is_place.mean())
        return max(float(squares.sum()) - freedom, of_places), near[0]

    return excess_variance(over, float(rows.variance.max()))


def _scale(rows: _Rows, matrix: Array, tau2: float) -> tuple[float, float]:
    """How much larger the phantom is than it is said to be, by one more unknown, and its deviation."""
    # Growth about the phantom's origin moves what is held of the feature, not what was measured.
    jacobian = np.column_stack([rows.jacobian(matrix), -rows.told])
    weighed = jacobian / (rows.with_excess(tau2))[:, None]
    information, right = weighed.T @ jacobian, -weighed.T @ rows.residuals(matrix)
    spread = np.sqrt(np.diag(information)) + 1e-300
    values = np.linalg.eigvalsh(information / np.outer(spread, spread))
    if not (np.isfinite(values).all() and values[0] > 1e-9):
        return 1.0, np.inf
    return 1.0 + float(np.linalg.solve(information, right)[6]), float(
        np.sqrt(np.linalg.inv(information)[6, 6])
    )


def _worst(measured: Sequence[Measured], start: Array, used: NDArray[np.bool_]) -> int | None:
    """The feature that lies further from where all others put it than chance allows; None if none does."""
    from scipy.special import fdtrc

    index = np.flatnonzero(used).tolist()
    chances = []
    for left_out in index:
        rest = [measured[k] for k in index if k != left_out]
        rows, one = _Rows.of(rest), measured[left_out].rows
        freedom = len(rows.told) - 6
        chances.append(1.0)
        if freedom < SPARE:
            continue
        matrix, tau2 = _weighed(rows, start)
        information = rows.information(matrix, tau2)
        jacobian, off = one.jacobian(matrix), one.residuals(matrix)
        if np.linalg.norm(off) <= MATTERS_MM or np.linalg.cond(information) > 1e14:
            continue
        spread = jacobian @ np.linalg.inv(information) @ jacobian.T
        spread += np.diag(one.with_excess(tau2))
        ratio = float(off @ np.linalg.solve(spread, off)) / len(off)
        chances[-1] = float(fdtrc(len(off), freedom, ratio)) * len(index)
    return int(index[np.argmin(chances)]) if min(chances) < CHANCE else None
