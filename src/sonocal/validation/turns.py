"""By how much one orientation is turned against another."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array

__all__ = ["turned_deg"]


def turned_deg(one: Array, others: Array) -> Array:
    """Angles of rotations (..., 3, 3) against one (3, 3), by their chords, which tell small ones to the last digit."""
    chords = np.linalg.norm(one.T @ others - np.eye(3), axis=(-2, -1))
    return np.asarray(np.degrees(2.0 * np.arcsin(np.minimum(chords / np.sqrt(8.0), 1.0))))
