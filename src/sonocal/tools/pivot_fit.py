"""The tip and the pivot that most poses share: from a start that half of them may spoil to least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.tools.poses import LEAST_SPREAD_DEG, refuse_little_tilt

__all__ = ["covariance", "least_median", "residuals", "reweighted", "settled"]

MINIMAL_POSES = 3
TRIALS = 300
# Poses that a start is looked for among: so many tell it, and memory stays bounded.
MOST_POSES = 5000
TUKEY = 4.685
# Distances beyond this many deviations per coordinate are no noise: 1 in 10 000 of a normal distribution in space.
CUT = 4.6
FLOOR_MM = 1e-6
BLOCKS = 20


def least_median(rotations: Array, places: Array, rng: np.random.Generator, source: str) -> Array:
    """The tip and pivot of the triple of poses whose median residual is least: over all poses, or many of them."""
    if len(rotations) > MOST_POSES:
        some = rng.choice(len(rotations), MOST_POSES, replace=False)
        rotations, places = rotations[some], places[some]
    picks = np.argsort(rng.random((TRIALS, len(rotations))), axis=1)[:, :MINIMAL_POSES]
    means = rotations[picks].mean(axis=1)
    smallest = np.linalg.eigvalsh(np.eye(3) - np.swapaxes(means, 1, 2) @ means)[:, 0]
    # Poses that hardly differ say nothing of the tip; their solution would be noise.
    telling = picks[smallest > np.radians(LEAST_SPREAD_DEG / 2) ** 2]
    if len(telling) == 0:
        refuse_little_tilt(rotations, 0.0, source)
    system = _system(rotations)[telling].reshape(-1, 3 * MINIMAL_POSES, 6)
    target = -places[telling].reshape(-1, 3 * MINIMAL_POSES, 1)
    solutions = (np.linalg.pinv(system) @ target)[..., 0]
    residuals = np.einsum("nij,tj->tni", rotations, solutions[:, :3]) + places - solutions[:, None, 3:]
    scores = np.median(np.sum(residuals**2, axis=2), axis=1)
    return np.asarray(solutions[np.argmin(scores)])


def reweighted(rotations: Array, places: Array, solution: Array) -> tuple[Array, float]:
    """Tukey's biweight to rest; the scale comes from the start and is then refined with the inliers."""
    sigma = _robust_sigma(residuals(rotations, places, solution))
    for _ in range(50):
        ratio = np.linalg.norm(residuals(rotations, places, solution), axis=1) / (TUKEY * sigma)
        weight = np.where(ratio < 1, (1 - np.minimum(ratio, 1) ** 2) ** 2, 0.0)
        if (weight > 0).sum() < MINIMAL_POSES:
            break
        change, solution = solution, _solve(rotations, places, weight)
        sigma = min(sigma, _robust_sigma(residuals(rotations, places, solution)))
        if np.abs(change - solution).max() < 1e-9:
            break
    return solution, sigma


def settled(
    rotations: Array, places: Array, solution: Array, sigma: float
) -> tuple[Array, NDArray[np.bool_]]:
    """Least squares over the poses within the cut, which follows from them, until the set is at rest.

    Clean recordings have flat tails, not outliers: all of them count then, and nothing is lost to the weights.
    """
    agrees = np.zeros(len(rotations), dtype=bool)
    for _ in range(50):
        distance = np.linalg.norm(residuals(rotations, places, solution), axis=1)
        before, agrees = agrees, distance <= max(CUT * sigma, FLOOR_MM)
        if agrees.sum() < MINIMAL_POSES or np.array_equal(before, agrees):
            break
        solution = _solve(rotations, places, agrees.astype(float))
        left = residuals(rotations[agrees], places[agrees], solution)
        sigma = float(np.sqrt(np.mean(left**2)))
    return solution, agrees


def _robust_sigma(residuals: Array) -> float:
    """Standard deviation per coordinate from the median distance of a normal distribution in space."""
    return max(float(np.median(np.linalg.norm(residuals, axis=1))) / 1.538, FLOOR_MM / TUKEY)


def _solve(rotations: Array, places: Array, weight: Array) -> Array:
    """(6,): tip and pivot of ``R_i tip - pivot = -t_i`` in weighted least squares."""
    root = np.sqrt(weight)[:, None, None]
    system = _system(rotations) * root
    target = -(places * root[..., 0]).reshape(-1)
    return np.asarray(np.linalg.lstsq(system.reshape(-1, 6), target, rcond=None)[0])


def _system(rotations: Array) -> Array:
    """(N, 3, 6): the rows of one pose."""
    return np.concatenate([rotations, np.broadcast_to(-np.eye(3), rotations.shape)], axis=2)


def residuals(rotations: Array, places: Array, solution: Array) -> Array:
    """(N, 3) mm: how far each pose puts the tip from the pivot."""
    return np.asarray(rotations @ solution[:3] + places - solution[3:])


def covariance(rotations: Array, residuals: Array) -> Array:
    """(6, 6): the larger of the textbook covariance and the one that blocks of neighbours show.

    Neighbouring poses share their error (a marker seen at one angle), so counting each as a measurement of
    its own promises far too much.
    """
    jacobian = _system(rotations)
    n = len(jacobian)
    bread = np.linalg.inv(np.einsum("nij,nik->jk", jacobian, jacobian))
    white = bread * float(np.sum(residuals**2)) / max(3 * n - 6, 1)
    blocks = min(BLOCKS, n // 5)
    if blocks < 6:
        return np.asarray(white)
    gradient = np.einsum("nij,ni->nj", jacobian, residuals)
    sums = np.array([part.sum(axis=0) for part in np.array_split(gradient, blocks)])
    clustered = bread @ (sums.T @ sums) @ bread * blocks / (blocks - 1)
    return np.asarray(clustered if np.trace(clustered[:3, :3]) > np.trace(white[:3, :3]) else white)
