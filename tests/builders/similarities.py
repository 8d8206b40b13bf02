"""."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from sonocal import Similarity


def random_similarity(seed, scale=None):
    rng = np.random.default_rng(seed)
    rotation = Rotation.random(random_state=rng).as_matrix()
    return Similarity(rotation, rng.uniform(-200, 200, 3), rng.uniform(0.05, 1) if scale is None else scale)
