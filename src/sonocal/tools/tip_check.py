"""Whether a stylus' tip is where it is said to be, from its turns while it rested.

    R_ij tip + t_ij = p_i + noise       i = 1..K rests, j its poses

A tip that is off by e moves the place of rest by -R_ij e as the stylus turns: linear in e, the places taken out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.tools.rests import Rest

__all__ = ["TipDoubt", "tip_doubt"]

# Of the tip's correction: beyond this many deviations it is none of chance. Sensors whose place depends on their angle
# look like a tip that is off by a millimetre or two where a stylus is turned little, and no tip that small mends them.
SURE, MATTERS_MM = 4.0, 3.0
# Known worse than that it says nothing, mm.
UNKNOWN_MM = 1.0
FEWEST_RESTS = 3


@dataclass(frozen=True, eq=False)
class TipDoubt:
    """A stylus' tip that is not where it is said to be.

    Attributes:
        stylus: its marker.
        off_mm: how far off the tip is at least, as its turns at rest show.
        tip_correction_mm: (3,): to add to the tip, in the marker's frame, along what the turns tell.
    """

    stylus: str
    off_mm: float
    tip_correction_mm: Array

    __repr__ = brief


def tip_doubt(
    reference_from_stylus: Array, tip_mm: Array, rests: Sequence[Rest], stylus: str
) -> TipDoubt | None:
    """The doubt that a tip is right, or None where the turns at rest do not contradict it.

    Args:
        reference_from_stylus: (N, 4, 4).
        tip_mm: (3,): the tip in doubt.
        rests: where the tip rested, found with the tip in doubt.
        stylus: its marker's name.
    """
    normal, scores = np.zeros((3, 3)), []
    for rest in rests:
        system, right = _centred(reference_from_stylus[rest.rows], tip_mm)
        normal += system.T @ system
        scores.append((system, right))
    if len(scores) < FEWEST_RESTS:
        return None
    values, vectors = np.linalg.eigh(normal)
    known = values > max(values[-1] * 1e-9, 1e-12)
    if not known.any():
        return None
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T
    correction = inverse @ sum(system.T @ right for system, right in scores)
    # Each rest is one measurement of it: places of one touch share their error.
    parts = np.array([system.T @ (right - system @ correction) for system, right in scores])
    covariance = inverse @ (parts.T @ parts) @ inverse * len(parts) / (len(parts) - 1)
    # Only along the directions that the turns tell.
    deviations = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", vectors.T, covariance, vectors.T), 0))
    told = known & (deviations < UNKNOWN_MM)
    along = (vectors.T @ correction)[told]
    off = float(np.linalg.norm(along))
    sure = bool((np.abs(along) > SURE * np.maximum(deviations[told], 1e-9)).any())
    if off < MATTERS_MM or not sure:
        return None
    return TipDoubt(stylus, off, vectors[:, told] @ along)


def _centred(matrices: Array, tip_mm: Array) -> tuple[Array, Array]:
    """Rows of ``-(R_j - mean R) e = x_j - mean x`` that tell the correction e; x is where the tip in doubt was."""
    rotations = matrices[:, :3, :3]
    places = rotations @ tip_mm + matrices[:, :3, 3]
    return -(rotations - rotations.mean(axis=0)).reshape(-1, 3), (places - places.mean(axis=0)).reshape(-1)
