"""Mixes of simulated correspondences as registration takes them, and how far an answer is off."""

from __future__ import annotations

import numpy as np
from benchmarks.register_trust import MAKERS
from benchmarks.simulators.mixes import Mix
from scipy.spatial.transform import Rotation

from sonocal import registration as reg
from sonocal.geometry import Similarity


def rows_of(mix: Mix) -> reg.Rows:
    """All parts of a mix, planes as numbers."""
    return reg.rows(*(MAKERS[part.kind](part.source, part.target) for part in mix.parts))


def errors_of(found: Similarity, truth: np.ndarray) -> np.ndarray:
    """(7,): the truth's tangent at an answer."""
    scale = np.cbrt(np.linalg.det(truth[:3, :3]))
    turn = Rotation.from_matrix(truth[:3, :3] / scale @ found.rotation.T).as_rotvec()
    return np.concatenate([turn, truth[:3, 3] - found.translation, [np.log(scale / found.scale)]])
