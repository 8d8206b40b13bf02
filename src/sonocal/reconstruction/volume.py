"""A volume: grey levels of voxels, where they lie, and what is known of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry.shown import quoted
from sonocal.reconstruction.grid import Grid

__all__ = ["Volume"]


@dataclass(frozen=True, eq=False)
class Volume:
    """Grey levels of voxels.

    Attributes:
        values: (z, y, x), of the images' own depth; 0 where no image was.
        grid: where the voxels lie.
        reference: the frame that they lie in.
        images: how many were put in.
        left_out: how many had no valid pose.
        filled: voxels that an image was in.
        coverage: (z, y, x): values that each voxel was given; None where that was not asked for.
        error_um: (z, y, x): what 95 % of a voxel's places stay within, micrometres; 0 where no image was; None where
            that was not asked for.
        source: of which recording.
    """

    values: NDArray[Any]
    grid: Grid
    reference: str
    images: int
    left_out: int
    filled: int
    coverage: NDArray[np.uint16] | None = None
    error_um: NDArray[np.uint16] | None = None
    source: str = "recording"

    def __repr__(self) -> str:
        size = " x ".join(map(str, self.grid.size))
        spacing = " x ".join(f"{s:.4g}" for s in self.grid.spacing_mm)
        return (
            f"<Volume of {quoted(self.source)}: {size} voxels of {spacing} mm in {quoted(self.reference)}, "
            f"{self.images} images, {self.filled_share:.0%} filled>"
        )

    @property
    def filled_share(self) -> float:
        """Of all voxels, those that an image was in."""
        return self.filled / self.grid.voxels
