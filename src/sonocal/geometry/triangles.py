"""Whether three points span a plane: one rule for files, tables and targets; the core has the same at its door."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry.transforms import Array

__all__ = ["on_one_line"]

# Of the two sides' product: a triangle that is flatter than this is none.
FLAT = 1e-9


def on_one_line(points: Array) -> NDArray[np.bool_]:
    """(...): whether three points (..., 3, 3), rows, lie on one line, or so nearly that rounding decides.

    Where a point is no number, so is what they span: they do.
    """
    along, aside = points[..., 1, :] - points[..., 0, :], points[..., 2, :] - points[..., 0, :]
    sides = np.linalg.norm(along, axis=-1) * np.linalg.norm(aside, axis=-1)
    return np.asarray(~(np.linalg.norm(np.cross(along, aside), axis=-1) > FLAT * sides))
