"""Any image that a scanner or a frame grabber gives, as grey levels from 0 to 255."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError, UnsupportedError

__all__ = ["LEAST_SIDE_PX", "as_grey"]

LEAST_SIDE_PX = 16
WEIGHTS = np.array([0.299, 0.587, 0.114], dtype=np.float32)  # ITU-R BT.601 luma


def as_grey(image: NDArray[Any], dimension: int = 2, name: str = "image") -> NDArray[np.float32]:
    """The image as C-contiguous float32 grey levels.

    Colour becomes its luma; 16-bit and floating-point images are scaled so that their own greatest value is
    255, because nothing says which of their levels is white.

    Args:
        image: (v, u[, 3]) or, in 3D, (w, v, u[, 3]).
        dimension: 2 or 3.
        name: what messages call it.

    Raises:
        InputError: it has another shape, is too small, or holds values that are not finite.
        UnsupportedError: its pixels are not real numbers.
    """
    if image.ndim == dimension + 1 and image.shape[-1] in (3, 4):
        image = (
            image[..., :3].astype(np.float32) @ WEIGHTS
            if image.dtype == np.uint8
            else image[..., :3].mean(-1)
        )
        image = image.astype(np.uint8) if image.max(initial=0) <= 255 else image
    if image.ndim != dimension or min(image.shape) < LEAST_SIDE_PX:
        raise InputError(
            f"{name}: detection needs {dimension}D images of {LEAST_SIDE_PX} px or more a side; "
            f"got shape {image.shape}"
        )
    if image.dtype.kind not in "uifb":
        raise UnsupportedError(
            f"{name}: pixels of type {image.dtype} are not grey levels; convert them to uint8"
        )
    grey = np.ascontiguousarray(image, dtype=np.float32)
    if image.dtype == np.uint8:
        return grey
    if not np.isfinite(grey).all():
        raise InputError(f"{name}: holds pixels that are not finite numbers; replace them by 0")
    top = float(grey.max())
    return grey * np.float32(255 / top) if top > 0 else grey
