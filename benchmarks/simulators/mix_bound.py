"""The least error that any unbiased estimate of a mix can have: from derivatives that are found by moving numbers.

NumPy and SciPy alone: what judges an estimator shares nothing with it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.mixes import Array, Mix, Noise

STEP_MM, STEP = 1e-3, 1e-6


def least_covariance(mix: Mix, noise: Noise) -> Array:
    """(7, 7): of turns on the left (rad), translation (mm) and log scale, by Cramer and Rao, at the truth.

    Args:
        mix: correspondences, whose noise moves nothing that matters here.
        noise: theirs.
    """
    information = np.zeros((7, 7))
    for part in mix.parts:
        flat = part.kind.startswith("image")
        for source, target in zip(part.source, part.target, strict=True):
            information += _information(
                mix.truth, np.atleast_2d(source), np.atleast_2d(target), noise, flat=flat
            )
    return np.linalg.inv(information)


def corner_error(truth: Array, corners: Array, covariance: Array) -> float:
    """The root mean square error of the source's corners (N, 3), mm, that a covariance makes."""
    arms = corners @ truth[:3, :3].T
    by = np.zeros((len(arms), 3, 7))
    for axis in range(3):
        by[:, :, axis] = np.cross(np.eye(3)[axis], arms)
    by[:, :, 3:6], by[:, :, 6] = np.eye(3), arms
    return float(np.sqrt(np.einsum("nia,ab,nib->n", by, covariance, by).mean()))


def _information(truth: Array, source: Array, target: Array, noise: Noise, *, flat: bool) -> Array:
    """What one correspondence says: through what moves its points across the target."""
    across = np.linalg.svd(target[1:] - target[0], full_matrices=True)[2][len(target) - 1 :]

    def away(numbers: Array, tangent: Array) -> Array:
        points, spanning = (
            numbers[: source.size].reshape(source.shape),
            numbers[source.size :].reshape(target.shape),
        )
        turned = Rotation.from_rotvec(tangent[:3]).as_matrix() @ truth[:3, :3] * np.exp(tangent[6])
        there = points @ turned.T + truth[:3, 3] + tangent[3:6] - spanning[0]
        hull = (spanning[1:] - spanning[0]).T
        if hull.shape[1]:
            there = there - (hull @ np.linalg.lstsq(hull, there.T, rcond=None)[0]).T
        return (there @ across.T).reshape(-1)

    numbers, nothing = np.concatenate([source.reshape(-1), target.reshape(-1)]), np.zeros(7)
    by_numbers = _derivative(lambda x: away(x, nothing), numbers, STEP_MM)
    by_tangent = _derivative(lambda x: away(numbers, x), nothing, STEP)
    scale = np.cbrt(np.linalg.det(truth[:3, :3]))
    px = np.tile([1.0, 1.0, 0.0 if flat else 1.0], len(source)) * noise.source_mm / scale
    sigma = np.concatenate([px, np.full(target.size, noise.target_mm)])
    covariance = (by_numbers.T * sigma**2) @ by_numbers
    return np.asarray(by_tangent @ np.linalg.solve(covariance, by_tangent.T))


def _derivative(of: Callable[[Array], Array], at: Array, step: float) -> Array:
    """(numbers, values)."""
    return np.array([(of(at + move) - of(at - move)) / (2 * step) for move in step * np.eye(len(at))])
