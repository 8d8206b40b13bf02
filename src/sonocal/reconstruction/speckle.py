"""Images as a voxel sees them: averaged over its size, so that it shows more than the few pixels at its centre."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import _core

__all__ = ["averaged_over"]

# Pixels along a side; sums of more would not fit into 32 bits.
MOST_ACROSS = 127


def averaged_over(image: NDArray[Any], box_px: tuple[int, int]) -> NDArray[Any]:
    """The mean of (u, v) pixels around each pixel, rounded to the nearest; at the image's rim its pixels are repeated.

    Args:
        image: (rows, columns), of whole numbers.
        box_px: along u and along v; of an even number the last pixel counts half at each end.
    """
    across, down = (min(max(1, count), MOST_ACROSS) for count in box_px)
    if across == 1 and down == 1:
        return image
    averaged = np.empty_like(image)
    _core.average_image(image, across, down, averaged)
    return averaged
