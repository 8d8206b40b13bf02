"""The rigid motion, and the similarity, that carries points to points in least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sonocal.geometry.transforms import Array

__all__ = ["fitted_motions", "fitted_scale"]


def fitted_motions(from_points: ArrayLike, to_points: ArrayLike, weights: ArrayLike | None = None) -> Array:
    """Rigid motions that carry points to points.

        min over R, t of sum w_i |R x_i + t - y_i|^2

    Args:
        from_points: (..., N, 3).
        to_points: (..., N, 3).
        weights: (..., N), not negative; default: all alike.

    Returns:
        (..., 4, 4). Where the points lie on one line a turn about it is free, and one of them is given.

    Source: Umeyama 1991, without scale.
    """
    x, y, w, middle, middles = _centred(from_points, to_points, weights)
    u, _, vt = np.linalg.svd(np.swapaxes(w * y, -1, -2) @ x)
    # The last direction turned where the best orthogonal matrix would mirror.
    u[..., :, 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    rotation = u @ vt
    matrices = np.zeros((*rotation.shape[:-2], 4, 4))
    matrices[..., :3, :3] = rotation
    matrices[..., :3, 3] = (middles - middle @ np.swapaxes(rotation, -1, -2))[..., 0, :]
    matrices[..., 3, 3] = 1.0
    return matrices


def fitted_scale(
    from_points: ArrayLike, to_points: ArrayLike, weights: ArrayLike | None = None
) -> tuple[float, float]:
    """Scale of the similarity that carries points (N, 3) to points, and its deviation for errors of variance 1 / w_i.

    Source: Umeyama 1991.
    """
    x, y, w, _, _ = _centred(from_points, to_points, weights)
    rotation = fitted_motions(x, y, w[..., 0])[:3, :3]
    spread = float(np.sum(w * x**2))
    return float(np.sum(w * y * (x @ rotation.T)) / spread), float(1 / np.sqrt(spread))


def _centred(
    from_points: ArrayLike, to_points: ArrayLike, weights: ArrayLike | None
) -> tuple[Array, Array, Array, Array, Array]:
    x, y = np.asarray(from_points, dtype=float), np.asarray(to_points, dtype=float)
    w = (np.ones(y.shape[:-1]) if weights is None else np.asarray(weights, dtype=float))[..., None]
    total = w.sum(axis=-2, keepdims=True)
    middle = (w * x).sum(axis=-2, keepdims=True) / total
    middles = (w * y).sum(axis=-2, keepdims=True) / total
    return x - middle, y - middles, w, middle, middles
