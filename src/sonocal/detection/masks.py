"""Which pixels of a recording are ultrasound: not the text, the rulers, nor the black around the fan."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.detection.grey import as_grey
from sonocal.errors import InputError
from sonocal.recording.formats import read_recording

__all__ = ["find_mask", "read_mask"]

Mask = NDArray[np.bool_]

SAMPLES = 24
STILL, STILL_SHARE = 3.0, 0.2
"""Grey levels within which a pixel stands still, and the share of its own: compressed video flickers by as much."""
STILL_AROUND, AROUND_PX = 8.0, (1, 4)
"""Grey levels within which the middle one of a pixel's surroundings varies, so that it is drawn beside the echoes or
over them; a wire that stands still has speckle around it."""
INK = 30.0
"""Grey level from which a still pixel is drawn over the image."""
BLUR_PX, BETWEEN_PX = 3, 4
RIM_PX = 2
NOTCH = 1 / 16
"""Of the image's smaller side: narrower bays in the fan's edge, by twice as much, are black for want of echoes."""
LARGEST_OVERLAY = 0.2
SMALLEST_FAN = 0.25
"""Shares of the image beyond which what was found is not what it was taken for."""


def find_mask(frames: Sequence[NDArray[Any]], dimension: int = 2, name: str = "recording") -> Mask:
    """The pixels to look at, from some images spread over a recording.

    A pixel that is bright and never changes is text, a ruler or a logo. Around the fan pixels are black in every
    image; where the fan itself is mostly black (water, low gain) its edge does not show and needs no mask.

    Args:
        frames: the recording's images; a few of them are read.
        dimension: 2 or 3.
        name: what messages call the recording.

    Returns:
        True where to look, shaped like a frame without its colours.
    """
    index = np.unique(np.linspace(0, len(frames) - 1, min(SAMPLES, len(frames))).astype(int))
    least = greatest = as_grey(frames[int(index[0])], dimension, f"{name}, frame {index[0]}")
    for i in index[1:]:
        grey = as_grey(frames[int(i)], dimension, f"{name}, frame {i}")
        least, greatest = np.minimum(least, grey), np.maximum(greatest, grey)
    overlay = _overlay(least, greatest) if len(index) > 2 else np.zeros(least.shape, dtype=bool)
    return np.asarray(_fan((greatest > 0) & ~overlay) & ~overlay)


def read_mask(path: str | Path, shape: tuple[int, ...]) -> Mask:
    """A mask drawn by hand: an image (PNG, MetaIO, ...), not black where to look.

    Args:
        path: the image.
        shape: of the images to look at, (rows, columns).

    Raises:
        InputError: it cannot be read, or has another size.
    """
    drawn = read_recording(path)
    if len(drawn.frames) != 1:
        raise InputError(f"{drawn.name}: holds {len(drawn.frames)} images; a mask is one")
    mask = as_grey(drawn.frames[0], 2, drawn.name) > 0
    if mask.shape != tuple(shape):
        raise InputError(
            f"{drawn.name}: is {mask.shape[1]} x {mask.shape[0]} px where the images are {shape[1]} x {shape[0]}; "
            "draw the mask over one of them"
        )
    return np.asarray(mask)


def _overlay(least: NDArray[np.float32], greatest: NDArray[np.float32]) -> Mask:
    from scipy.ndimage import binary_dilation, binary_erosion

    ranges = greatest - least
    still = (ranges <= STILL) & (least >= INK)
    if least.ndim == 2 and not still.mean() > LARGEST_OVERLAY:
        flickers = (ranges <= STILL_SHARE * least) & (least >= INK) & ~still
        still |= flickers & _beside_stillness(ranges, flickers)
    if still.mean() > LARGEST_OVERLAY:  # a frozen recording: everything stands still
        return np.zeros(least.shape, dtype=bool)
    # Letters are blurred at their rims where the screen was scaled; of what is between them an island would stand out.
    grown = binary_dilation(still, iterations=BLUR_PX + BETWEEN_PX)
    return np.asarray(binary_erosion(grown, iterations=BETWEEN_PX, border_value=1))


def _beside_stillness(ranges: NDArray[np.float32], where: Mask) -> Mask:
    """Pixels of some, whose surroundings hardly vary."""
    out = np.zeros(where.shape, dtype=bool)
    near, far = AROUND_PX
    padded = np.pad(ranges, far, mode="edge")
    row, column = np.nonzero(where)
    ring = [
        padded[row + far + v, column + far + u]
        for v in range(-far, far + 1)
        for u in range(-far, far + 1)
        if near < np.hypot(u, v) <= far
    ]
    if len(row):
        out[row, column] = np.median(ring, axis=0) <= STILL_AROUND
    return out


def _fan(lit: Mask) -> Mask:
    from scipy.ndimage import binary_closing, binary_erosion, binary_fill_holes, label

    everything = np.ones(lit.shape, dtype=bool)
    parts, count = label(binary_closing(np.pad(lit, 4), iterations=3)[(slice(4, -4),) * lit.ndim])
    if count == 0:
        return everything
    largest = parts == 1 + int(np.argmax(np.bincount(parts.reshape(-1))[1:]))
    fan = binary_fill_holes(largest)
    if fan.mean() < SMALLEST_FAN or (lit & largest).sum() < 0.6 * fan.sum():
        return everything
    # The outermost pixels are half black.
    return np.asarray(
        binary_erosion(np.pad(_closed(fan), RIM_PX, mode="edge"), iterations=RIM_PX)[
            (slice(RIM_PX, -RIM_PX),) * lit.ndim
        ]
    )


def _closed(fan: Mask) -> Mask:
    """The fan without its notches: closed by a ball, which a face's or a bottom's wide arc does not feel."""
    from scipy.ndimage import distance_transform_edt

    radius = max(1, round(NOTCH * min(fan.shape)))
    grown = distance_transform_edt(~np.pad(fan, radius + 1)) <= radius
    return np.asarray((distance_transform_edt(grown) > radius)[(slice(radius + 1, -radius - 1),) * fan.ndim])
