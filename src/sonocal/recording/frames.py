"""Images of a recording, decoded when they are asked for.

A frame is an array indexed ``[v, u]`` (2D) or ``[w, v, u]`` (3D), with the colour channels last.
Frames are read-only; iterating holds one at a time.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import FormatError, UnsupportedError
from sonocal.files import file_size, read_at

__all__ = [
    "PICTURE_LIMIT",
    "ArrayFrames",
    "Frames",
    "MappedFrames",
    "RawFrames",
    "SelectedFrames",
    "check_frame_size",
    "no_frames",
]

Image = NDArray[Any]

FRAME_LIMIT = 1 << 32
"""Largest single frame, bytes; beyond it a header is taken for damaged before memory is asked for."""
PICTURE_LIMIT = 1 << 27
"""The same of 2D images in formats whose decoders make much out of few bytes: 44 million pixels in colour."""


class Frames(Sequence[Image]):
    """A sequence of images of one shape and type.

    Attributes:
        shape: of one frame: (rows, columns[, channels]) or (slices, rows, columns[, channels]).
        dtype: of the pixels.
    """

    shape: tuple[int, ...]
    dtype: np.dtype[Any]

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {len(self)} of {' x '.join(map(str, self.shape))}, {self.dtype}>"

    @abstractmethod
    def __len__(self) -> int: ...

    @abstractmethod
    def read(self, index: int) -> Image:
        """Frame `index`, with ``0 <= index < len(self)``."""

    @overload
    def __getitem__(self, index: int) -> Image: ...

    @overload
    def __getitem__(self, index: slice) -> Frames: ...

    def __getitem__(self, index: int | slice) -> Image | Frames:
        if isinstance(index, slice):
            return SelectedFrames(self, range(len(self))[index])
        position = index + len(self) if index < 0 else index
        if not 0 <= position < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        return self.read(position)

    def __iter__(self) -> Iterator[Image]:
        for index in range(len(self)):
            yield self.read(index)

    @property
    def frame_bytes(self) -> int:
        """Bytes of one frame."""
        return frame_bytes(self.shape, self.dtype)


def frame_bytes(shape: Sequence[int], dtype: np.dtype[Any]) -> int:
    """Bytes of one frame, exactly: Python integers do not overflow."""
    total = dtype.itemsize
    for n in shape:
        total *= int(n)
    return total


class ArrayFrames(Frames):
    """Frames that are in memory: an array (N, ...)."""

    def __init__(self, array: Image) -> None:
        self._array = array.view()
        self._array.flags.writeable = False
        self.shape, self.dtype = array.shape[1:], array.dtype

    def __len__(self) -> int:
        return len(self._array)

    def read(self, index: int) -> Image:
        """Frame `index`."""
        return np.asarray(self._array[index])


class RawFrames(Frames):
    """Frames stored one after the other in a file, without compression; `exactly` says that nothing follows them."""

    def __init__(
        self,
        path: Path,
        offset: int,
        count: int,
        shape: tuple[int, ...],
        dtype: np.dtype[Any],
        *,
        exactly: bool = True,
    ) -> None:
        self._path, self._offset, self._count = path, offset, count
        self.shape, self.dtype = shape, dtype.newbyteorder("=")
        self._stored = dtype
        check_frame_size(path.name, shape, dtype)
        expected, there = count * self.frame_bytes, file_size(path) - offset
        if expected > there or (exactly and expected != there):
            raise FormatError(
                f"{path.name}: holds {max(there, 0)} bytes of pixels where its header asks for {expected} "
                f"({count} frames of {'x'.join(map(str, shape))} {dtype.name}); record or copy it again"
            )

    def __len__(self) -> int:
        return self._count

    def read(self, index: int) -> Image:
        """Frame `index`."""
        data = read_at(self._path, self._offset + index * self.frame_bytes, self.frame_bytes)
        return as_frame(self._path.name, index, data, self.shape, self._stored)


class MappedFrames(Frames):
    """Frames seen through a function, such as a flip."""

    def __init__(self, frames: Frames, change: Callable[[Image], Image], shape: tuple[int, ...]) -> None:
        self._frames, self._change = frames, change
        self.shape, self.dtype = shape, frames.dtype

    def __len__(self) -> int:
        return len(self._frames)

    def read(self, index: int) -> Image:
        """Frame `index`."""
        return self._change(self._frames.read(index))

    def __iter__(self) -> Iterator[Image]:
        return map(self._change, self._frames)


class SelectedFrames(Frames):
    """Some frames of another sequence."""

    def __init__(self, frames: Frames, indices: Sequence[int]) -> None:
        self._frames, self._indices = frames, indices
        self.shape, self.dtype = frames.shape, frames.dtype

    def __len__(self) -> int:
        return len(self._indices)

    def read(self, index: int) -> Image:
        """Frame `index` of the selection."""
        return self._frames.read(int(self._indices[index]))


def no_frames() -> Frames:
    """The frames of a recording that has none."""
    return ArrayFrames(np.empty((0, 0, 0), dtype=np.uint8))


def as_frame(
    name: str, index: int, data: bytes | bytearray, shape: tuple[int, ...], stored: np.dtype[Any]
) -> Image:
    """The pixels of one frame from its bytes, in this machine's byte order."""
    if len(data) != frame_bytes(shape, stored):
        raise FormatError(f"{name}, frame {index}: the file ends within it; copy or record it again")
    frame = np.frombuffer(data, dtype=stored).reshape(shape)
    if not stored.isnative:
        frame = frame.astype(stored.newbyteorder("="))
    frame.flags.writeable = False
    return frame


def check_frame_size(
    name: str, shape: tuple[int, ...], dtype: np.dtype[Any], limit: int = FRAME_LIMIT
) -> None:
    """Refuse frames that no scanner makes, before anything is allocated."""
    if (size := frame_bytes(shape, dtype)) > limit:
        raise UnsupportedError(
            f"{name}: one frame of {'x'.join(map(str, shape))} {dtype.name} takes {size} bytes, more than "
            f"the {limit} that sonocal reads; is the header damaged?"
        )
