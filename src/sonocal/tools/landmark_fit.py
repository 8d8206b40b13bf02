"""The phantom's place from landmarks that were touched: weighed, without those that lie off, with its covariance.

    min over R, t of sum |R x_i + t - y_i|^2 / v_i        v_i = tau^2 + variance of the mean of touch i

`tau` is what touches and landmarks are off by beyond their own noise, so that the sum comes to its freedom (Paule and
Mandel 1982): divots are wide, phantoms are printed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, Similarity
from sonocal.geometry.fitted import fitted_motions, fitted_scale
from sonocal.registration.uncertainty import point_jacobian

__all__ = ["PhantomFit", "excess_variance", "fit_phantom"]

FEWEST_TO_DROP = 5
# A landmark is left out when chance puts one so far off once in so many registrations, and when it matters, mm.
CHANCE, MATTERS_MM = 0.01, 1.0
STEPS = 60


@dataclass(frozen=True, eq=False)
class PhantomFit:
    """A phantom's place.

    Attributes:
        matrix: (4, 4): reference from phantom.
        covariance: (6, 6): rotation (rad) and translation (mm).
        freedom: of the residuals.
        used: (M,): the landmarks that agree.
        residuals_mm: (M, 3): touch less landmark, in the reference's frame.
        tau_mm: what touches are off by, a coordinate, beyond their noise.
        scale: of the similarity, beside 1.
        scale_deviation: of it.
    """

    matrix: Array
    covariance: Array
    freedom: int
    used: NDArray[np.bool_]
    residuals_mm: Array
    tau_mm: float
    scale: float
    scale_deviation: float


def fit_phantom(landmarks_mm: Array, touches_mm: Array, variances_mm2: Array) -> PhantomFit:
    """The phantom's place from landmarks (M, 3) and touches (M, 3) of variances (M,), a coordinate."""
    used = np.ones(len(landmarks_mm), dtype=bool)
    for _ in range(len(used) // 4):
        worst = (
            _worst(landmarks_mm, touches_mm, variances_mm2, used) if used.sum() >= FEWEST_TO_DROP else None
        )
        if worst is None:
            break
        used[worst] = False
    x, y, v = landmarks_mm[used], touches_mm[used], variances_mm2[used]
    matrix, tau2 = _weighed(x, y, v)
    weights = 1 / (v + tau2)
    residuals = touches_mm - (landmarks_mm @ matrix[:3, :3].T + matrix[:3, 3])
    scale, deviation = _scale(x, y, weights, residuals[used])
    return PhantomFit(
        matrix,
        np.asarray(np.linalg.inv(_information(matrix, x, weights))),
        3 * len(x) - 6,
        used,
        residuals,
        float(np.sqrt(tau2)),
        scale,
        deviation,
    )


def _weighed(x: Array, y: Array, v: Array) -> tuple[Array, float]:
    """The motion, and tau^2."""
    freedom = 3 * len(x) - 6

    def excess(tau2: float) -> tuple[float, Array]:
        matrix = fitted_motions(x, y, 1 / (v + tau2))
        off = y - (x @ matrix[:3, :3].T + matrix[:3, 3])
        return float(np.sum(off**2 / (v + tau2)[:, None])) - freedom, matrix

    v = np.maximum(v, 1e-12)
    return excess_variance(excess, float(v.max()))


def excess_variance(over: Callable[[float], tuple[float, Array]], largest_mm2: float) -> tuple[Array, float]:
    """The motion, and the variance beyond their own that brings the weighed squares of residuals to their freedom.

    Args:
        over: of such a variance, what the squares are beyond their freedom, and the motion.
        largest_mm2: of the variances that are known.
    """
    more, matrix = over(0.0)
    if more <= 0:
        return matrix, 0.0
    low, high = 0.0, largest_mm2 * (1 + more)
    for _ in range(STEPS):
        middle = (low + high) / 2
        more, matrix = over(middle)
        low, high = (middle, high) if more > 0 else (low, middle)
    return matrix, high


def _scale(x: Array, y: Array, weights: Array, residuals: Array) -> tuple[float, float]:
    """The similarity's scale, and its deviation by what that similarity leaves: a wrong scale makes tau large."""
    scale, deviation = fitted_scale(x, y, weights)
    squares = float(np.sum(weights[:, None] * residuals**2))
    left = max(squares - ((scale - 1) / deviation) ** 2, 0.0) / max(3 * len(x) - 7, 1)
    return scale, deviation * min(1.0, float(np.sqrt(left)))


def _information(matrix: Array, x: Array, weights: Array) -> Array:
    jacobian = point_jacobian(Similarity.from_matrix(matrix), x, 6)
    return np.asarray(np.einsum("nij,n,nik->jk", jacobian, weights, jacobian))


def _worst(x: Array, y: Array, v: Array, used: NDArray[np.bool_]) -> int | None:
    """The landmark that lies further from where all others put it than chance allows; None if none does."""
    from scipy.special import fdtrc

    index = np.flatnonzero(used)
    chances = []
    for left_out in index:
        rest = index[index != left_out]
        matrix, tau2 = _weighed(x[rest], y[rest], v[rest])
        weights = 1 / (np.maximum(v[rest], 1e-12) + tau2)
        jacobian = point_jacobian(Similarity.from_matrix(matrix), x[left_out][None], 6)[0]
        carried = jacobian @ np.linalg.pinv(_information(matrix, x[rest], weights)) @ jacobian.T
        off = y[left_out] - (matrix[:3, :3] @ x[left_out] + matrix[:3, 3])
        spread = carried + (v[left_out] + tau2) * np.eye(3)
        ratio = float(off @ np.linalg.solve(spread, off)) / 3
        chance = float(fdtrc(3, 3 * len(rest) - 6, ratio)) * len(index)
        chances.append(chance if np.linalg.norm(off) > MATTERS_MM else 1.0)
    return int(index[np.argmin(chances)]) if min(chances) < CHANCE else None
