"""2D images cut out of a volume at any angle, as the paper makes its 2D data from 3D scans (section 9)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["VolumeSlice", "slice_volume"]


@dataclass(frozen=True, eq=False)
class VolumeSlice:
    """An image out of a volume.

    Attributes:
        image: (rows, columns), float32; 0 outside the volume.
        volume_from_slice: (4, 4): voxels (u, v, w) from the slice's pixels (u, v, 0).
    """

    image: NDArray[np.float32]
    volume_from_slice: Array

    __repr__ = brief

    def to_volume(self, points_px: ArrayLike) -> Array:
        """(N, 3): voxels of points (N, 2) of the slice."""
        points = np.asarray(points_px, dtype=float)
        return np.asarray(points @ self.volume_from_slice[:3, :2].T + self.volume_from_slice[:3, 3])


def slice_volume(
    volume: NDArray[Any],
    angle: float,
    *,
    tilt: float = 0.0,
    offset_px: float = 0.0,
    size_px: tuple[int, int] | None = None,
) -> VolumeSlice:
    """The slice through a volume's middle, turned about the depth axis and tilted about its own u axis.

    Args:
        volume: indexed [w, v, u].
        angle: rad; 0 is the plane of u and v, pi / 2 that of w and v.
        tilt: rad, about the slice's u axis.
        offset_px: along the slice's normal.
        size_px: (width, height); default: the volume's larger lateral side and its height.

    Raises:
        InputError: not a volume.
    """
    from scipy.ndimage import map_coordinates

    if volume.ndim != 3:
        raise InputError(f"a slice needs a volume of three axes; got shape {volume.shape}")
    depth, height, width = volume.shape
    columns, rows = size_px or (max(width, depth), height)
    right = np.array([np.cos(angle), 0.0, np.sin(angle)])
    normal_flat = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    down = np.cos(tilt) * np.array([0.0, 1.0, 0.0]) + np.sin(tilt) * normal_flat
    normal = np.cross(right, down)
    middle = 0.5 * (np.array([width, height, depth]) - 1) + offset_px * normal
    matrix = np.eye(4)
    matrix[:3, :3] = np.column_stack([right, down, normal])
    matrix[:3, 3] = middle - 0.5 * (columns - 1) * right - 0.5 * (rows - 1) * down
    v, u = np.mgrid[:rows, :columns]
    places = matrix[:3, :2] @ np.stack([u.reshape(-1), v.reshape(-1)]) + matrix[:3, 3:4]
    image = map_coordinates(volume, places[::-1], order=1, output=np.float32, mode="constant", cval=0.0)
    return VolumeSlice(image.reshape(rows, columns), matrix)
