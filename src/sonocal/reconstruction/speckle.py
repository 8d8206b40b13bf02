"""Images as a voxel sees them: averaged over its size, so that it shows more than the few pixels at its centre."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["averaged_over"]


def averaged_over(image: NDArray[Any], box_px: tuple[int, int]) -> NDArray[Any]:
    """The mean of (u, v) pixels around each pixel, rounded to the nearest; at the image's rim its pixels are repeated.

    Args:
        image: (rows, columns), of whole numbers.
        box_px: along u and along v; of an even number the last pixel counts half at each end.
    """
    across, down = box_px
    if across == 1 and down == 1:
        return image
    sums = _sums_along(image.astype(np.uint32), across, 1)
    sums = _sums_along(sums, down, 0)
    parts = np.uint32(4 * across * down)
    return ((sums + parts // 2) // parts).astype(image.dtype)


def _sums_along(image: NDArray[np.uint32], count: int, axis: int) -> NDArray[np.uint32]:
    """Twice the sums of so many pixels around each along an axis, in exact integers."""
    around = count // 2
    pads = [(0, 0), (0, 0)]
    pads[axis] = (around + 1, around)
    total = np.cumsum(np.pad(image, pads, mode="edge"), axis=axis, dtype=np.uint64)
    n = image.shape[axis]

    def window(reach: int) -> NDArray[np.uint64]:
        """Sums of the pixels up to `reach` to each side."""
        high = np.take(total, np.arange(n) + around + 1 + reach, axis=axis)
        low = np.take(total, np.arange(n) + around - reach, axis=axis)
        return high - low

    wide = window(around)
    both = 2 * wide if count % 2 else wide + window(around - 1)
    return both.astype(np.uint32)
