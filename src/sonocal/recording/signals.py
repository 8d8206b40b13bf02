"""One number an image, to be aligned with a tracker's motion."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from sonocal.geometry import Array
from sonocal.recording.frames import Image

__all__ = ["bottom_line", "bottom_line_signal"]

# The line's own neighbourhood, rows: its brightness falls off within a few.
HALF_WIDTH = 10


def bottom_line_signal(frames: Iterable[Image]) -> Array:
    """(N,) px: the row of the bright line that a flat water tank's bottom makes in each image."""
    return np.array([bottom_line(frame) for frame in frames])


def bottom_line(frame: Image) -> float:
    """The row (v, px) of the strongest horizontal line of a 2D image; NaN where there is none.

    The median over the columns of each column's brightest row, then the centre of brightness about it:
    reflections and text hold few columns and do not move it.
    """
    grey = np.asarray(frame, dtype=np.float32)
    grey = grey.mean(axis=-1) if grey.ndim == 3 else grey
    third = grey.shape[1] // 3
    middle = grey[:, third : max(grey.shape[1] - third, third + 1)]
    rows = middle.argmax(axis=0)[middle.max(axis=0) > 0]
    if len(rows) == 0:
        return float("nan")
    centre = int(np.median(rows))
    start = max(centre - HALF_WIDTH, 0)
    profile = middle[start : centre + HALF_WIDTH + 1].mean(axis=1)
    weight = profile - profile.min()
    if not weight.sum() > 0:
        return float(centre)
    return float(start + (weight @ np.arange(len(weight))) / weight.sum())
