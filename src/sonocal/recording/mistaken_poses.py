"""What poses may be where they fit nothing: themselves, written or read as something else."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from sonocal.geometry import Array

__all__ = ["CHANGES"]


def _transposed(matrices: Array) -> Array:
    changed = matrices.copy()
    changed[:, :3, :3] = np.swapaxes(matrices[:, :3, :3], 1, 2)
    return changed


def _reordered(order: Iterable[int]) -> Callable[[Array], Array]:
    """Rotations whose quaternions (w, x, y, z) are read in another order."""

    def change(matrices: Array) -> Array:
        from scipy.spatial.transform import Rotation

        wxyz = np.roll(Rotation.from_matrix(matrices[:, :3, :3]).as_quat(), 1, axis=1)
        changed = matrices.copy()
        changed[:, :3, :3] = Rotation.from_quat(np.roll(wxyz[:, list(order)], -1, axis=1)).as_matrix()
        return changed

    return change


CHANGES: dict[str, Callable[[Array], Array]] = {
    "inverted": lambda matrices: np.asarray(np.linalg.inv(matrices)),
    "turned the other way (their rotations transposed)": _transposed,
    "read with the scalar of their quaternions last": _reordered([3, 0, 1, 2]),
    "read with the scalar of their quaternions first": _reordered([1, 2, 3, 0]),
}
"""What rigid poses (N, 4, 4) may be instead, in words that follow "they fit when they are": the rest is as it was."""
