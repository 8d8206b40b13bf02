"""Images as a page draws them: grey, 8 bits, one byte a pixel."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sonocal.detection import as_grey
from sonocal.errors import InputError
from sonocal.recording import Frames, Recording
from sonocal.recording.frames import Image

__all__ = ["MOST_STEP", "SharedFrames", "shown_grey"]

MOST_STEP = 64


def shown_grey(recording: Recording | None, index: int, name: str, step: int = 1) -> NDArray[np.uint8]:
    """(rows, columns) of an image; of a volume, the brightest voxels along w.

    Args:
        recording: whose image; None has none.
        index: of the image.
        name: what messages call the recording.
        step: take every so many pixels, for a small picture.

    Raises:
        InputError: there is no such image, or it cannot be read.
    """
    if recording is None or recording.image is None or not 0 <= index < len(recording.frames):
        raise InputError(f"{name}: has no frame {index}")
    if not 1 <= step <= MOST_STEP:
        raise InputError(f"step must be from 1 to {MOST_STEP}; got {step}")
    image, dimension = recording.frames[index], recording.image.dimension
    if image.dtype == np.uint8 and image.ndim == dimension:
        flat = image if dimension == 2 else image.max(axis=0)
        return np.ascontiguousarray(flat[::step, ::step])
    grey = as_grey(image, dimension, f"{name}, frame {index}")
    flat = grey if dimension == 2 else grey.max(axis=0)
    return np.ascontiguousarray(flat[::step, ::step].clip(0, 255).astype(np.uint8))


class SharedFrames(Frames):
    """Frames that are looked at while the needle is looked for in them: readers of files go one at a time."""

    def __init__(self, frames: Frames) -> None:
        self._frames, self._lock = frames, threading.Lock()
        self.shape, self.dtype = frames.shape, frames.dtype

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Image]:
        inner = iter(self._frames)  # reading in order costs one pass
        while True:
            with self._lock:
                image = next(inner, None)
            if image is None:
                return
            yield image

    def read(self, index: int) -> Image:
        """Frame `index`."""
        with self._lock:
            return self._frames.read(index)
