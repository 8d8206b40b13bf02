"""A small picture of a recording, for a card."""

from __future__ import annotations

import numpy as np

from sonocal.errors import SonocalError
from sonocal.files.png import Pixels, png
from sonocal.geometry.cards import WIDE_PX, png_picture
from sonocal.recording.frames import Frames, Image

__all__ = ["thumbnail"]


def thumbnail(frames: Frames, dimension: int) -> str:
    """The frame in the middle as an element of HTML, of a volume its middle slice; nothing where it cannot be read."""
    if not len(frames):
        return ""
    index = len(frames) // 2
    try:
        frame = frames[index]
    except (SonocalError, OSError):  # a damaged frame is said where frames are used
        return ""
    flat = frame if dimension == 2 else frame[len(frame) // 2]
    step = max(1, -(-flat.shape[1] // WIDE_PX), -(-flat.shape[0] // WIDE_PX))
    small = _grey_levels(flat[::step, ::step])
    return png_picture(png(small), min(WIDE_PX, small.shape[1]), f"Frame {index}")


def _grey_levels(image: Image) -> Pixels:
    """Pixels of 8 bits: others are spread over what there is."""
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    values = np.nan_to_num(image.astype(float))
    low, high = float(values.min()), float(values.max())
    return np.asarray((values - low) * (255 / max(high - low, 1e-12)), dtype=np.uint8)
