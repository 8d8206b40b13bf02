"""Random similarities, one and in batches, and what they are in plain algebra."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sonocal import AxisScaled, Similarity


def random_similarity(seed, scale=None):
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Similarity(rotation, rng.uniform(-200, 200, 3), rng.uniform(0.05, 1) if scale is None else scale)


def random_batch(seed, shape=()):
    """A similarity with leading axes."""
    rng = np.random.default_rng(seed)
    rotations = Rotation.from_quat(rng.normal(size=(*shape, 4))).as_matrix()
    return Similarity(rotations, rng.uniform(-200, 200, (*shape, 3)), rng.uniform(0.05, 2, shape))


def random_axis_scaled(seed):
    """A transform with a scale of its own along each axis."""
    rng, one = np.random.default_rng(seed), random_similarity(seed)
    return AxisScaled(one.rotation, one.translation, rng.uniform(0.05, 1, 3))


def by_matrix(matrix, points):
    """Points (..., 3) through a 4 x 4 matrix, by homogeneous coordinates alone."""
    homogeneous = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    return (homogeneous @ matrix.T)[..., :3]
