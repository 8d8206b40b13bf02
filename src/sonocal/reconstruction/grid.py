"""The voxels of a volume: where they lie, found from the images or given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sonocal.errors import InputError
from sonocal.geometry import FURTHEST, Array, real_array
from sonocal.geometry.shown import brief

__all__ = ["Grid", "given_spacing", "grid_around", "grid_of_size", "grid_within"]

MOST_VOXELS = 1 << 33
MOST_SIDE = 1 << 14
# Of a voxel: corners that rounding puts past a voxel's centre need no further layer.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Grid:
    """Voxels along the axes of a frame.

        x_mm = origin_mm + spacing_mm * (i, j, k)

    Attributes:
        origin_mm: (3,), the centre of the first voxel.
        spacing_mm: (3,), along x, y and z.
        size: voxels along x, y and z.
    """

    origin_mm: Array
    spacing_mm: Array
    size: tuple[int, int, int]

    __repr__ = brief

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of an array [z, y, x]."""
        x, y, z = self.size
        return z, y, x

    @property
    def voxels(self) -> int:
        """How many there are."""
        x, y, z = self.size
        return x * y * z

    @property
    def reference_from_voxel(self) -> Array:
        """(4, 4): mm from (i, j, k)."""
        matrix = np.diag([*self.spacing_mm, 1.0])
        matrix[:3, 3] = self.origin_mm
        return matrix


def given_spacing(spacing_mm: ArrayLike) -> Array:
    """(3,) mm, of one number or three.

    Raises:
        InputError: it is neither.
    """
    spacing = real_array("spacing_mm", spacing_mm)
    if spacing.shape not in {(), (3,)} or not ((spacing > 0) & (spacing < FURTHEST)).all():
        raise InputError(
            f"spacing_mm must be one length of a voxel in mm, or three along x, y and z; got {spacing_mm!r}"[
                :200
            ]
        )
    return np.broadcast_to(spacing, (3,)).astype(float)


def grid_around(corners_mm: Array, spacing_mm: Array, name: str) -> Grid:
    """The least grid that holds all points (N, 3); its voxels lie at whole multiples of the spacing.

    So volumes of several sweeps have their voxels in common.

    Raises:
        InputError: it has too many voxels.
    """
    low = np.floor(corners_mm.min(axis=0) / spacing_mm + ROUNDING)
    high = np.ceil(corners_mm.max(axis=0) / spacing_mm - ROUNDING)
    return grid_of_size(low * spacing_mm, spacing_mm, high - low + 1, name)


def grid_within(bounds_mm: ArrayLike, spacing_mm: Array, name: str) -> Grid:
    """The voxels between two corners, of which the lowest is the first voxel's centre.

    Raises:
        InputError: they are no two corners, or have too many voxels between them.
    """
    bounds = real_array("bounds_mm", bounds_mm)
    usable = bounds.shape == (2, 3) and bool((np.abs(bounds) < FURTHEST).all())
    if not usable or not (bounds[1] >= bounds[0]).all():
        raise InputError(
            f"bounds_mm must be the lowest and the highest corner, two rows of x, y, z in mm; got {bounds_mm!r}"[
                :200
            ]
        )
    return grid_of_size(
        bounds[0], spacing_mm, np.floor((bounds[1] - bounds[0]) / spacing_mm + ROUNDING) + 1, name
    )


def grid_of_size(origin: Array, spacing: Array, size: ArrayLike, name: str) -> Grid:
    """A grid of so many voxels along x, y and z.

    Raises:
        InputError: it has too many.
    """
    size = np.asarray(size, dtype=float)
    if size.max() > MOST_SIDE or size.prod() > MOST_VOXELS:
        words = " x ".join(f"{n:.0f}" for n in size)
        raise InputError(
            f"{name}: the volume would have {words} voxels, and {MOST_SIDE} along an axis and 2^33 in all are the "
            "most; give a larger spacing, or bounds of the part that you want"
        )
    x, y, z = (int(n) for n in size)
    return Grid(np.array(origin, dtype=float), np.array(spacing, dtype=float), (x, y, z))
