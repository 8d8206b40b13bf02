"""Between which images the probe passed steadily: what lies there can be interpolated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.reconstruction.placed import Placed

__all__ = ["image_planes", "joined_images"]


def joined_images(placed: Placed, corners_mm: Array, longest_gap_mm: float) -> NDArray[np.int32]:
    """(n - 1,), not 0 where an image and the next are successive ones whose corners (n, 4, 3) moved no further.

    Nothing is made up across an image without a pose, where nobody knows the way the probe took, nor between the last
    slice of a volume and the first of the next.
    """
    moved = np.linalg.norm(np.diff(corners_mm, axis=0), axis=2).max(axis=1, initial=0.0)
    next_to = np.diff(placed.rows) == 1
    if placed.slices > 1:
        next_to &= np.diff(placed.rows // placed.slices) == 0
    return np.asarray((moved <= longest_gap_mm) & next_to, dtype=np.int32)


def image_planes(reference_from_image: Array) -> Array:
    """(n, 4, 4): (u px, v px, w mm, 1) of points of the reference frame; w is how far off the image's plane.

    Third columns of calibrations scale as they please; that of a plane is its unit normal.
    """
    frames = reference_from_image.copy()
    normal = np.cross(frames[:, :3, 0], frames[:, :3, 1])
    frames[:, :3, 2] = normal / np.linalg.norm(normal, axis=1, keepdims=True)
    return np.asarray(np.linalg.inv(frames))
