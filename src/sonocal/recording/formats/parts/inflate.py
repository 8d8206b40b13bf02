"""Frames inside one zlib or gzip stream, decoded on demand with the memory of about one frame."""

from __future__ import annotations

import threading
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError
from sonocal.files import file_size, read_at
from sonocal.recording.frames import Frames, Image, as_frame, check_frame_size

try:  # zlib-ng inflates several times faster; the standard library's gives the same bytes
    from zlib_ng import zlib_ng

    _zlib: Any = zlib_ng
except ImportError:  # pragma: no cover - depends on the installation
    _zlib = zlib

__all__ = ["GZIP", "ZLIB", "InflatedFrames"]

ZLIB, GZIP = 15, 31

# Read and inflated at a time: what is held beside the frame, with the decoder's own window, is some 0.1 MB.
PIECE = 1 << 14
CHECKPOINT_EVERY = 16
MOST_CHECKPOINTS = 64
# Deflate expands at most 1032 : 1; a header that asks for more lies, whatever the data hold.
LARGEST_EXPANSION = 1032


@dataclass
class _Cursor:
    """A place in the stream, just before frame `frame`."""

    position: int
    inflater: Any
    frame: int = 0
    pending: bytes = field(default=b"", repr=False)

    def copy(self) -> _Cursor:
        return _Cursor(self.position, self.inflater.copy(), self.frame, self.pending)


class InflatedFrames(Frames):
    """Frames in one deflated stream.

    Reading in order costs one pass. Reading elsewhere starts at the nearest saved state of the
    decoder (at most 64 of them, about 100 kB each), not at the start of the file.

    Args:
        path: the file.
        offset: where the stream starts, bytes.
        length: bytes of the stream, or None: all that is left.
        count: how many frames.
        shape: of one frame.
        dtype: as stored.
        wrapper: `ZLIB` or `GZIP`.

    Raises:
        FormatError: the stream is shorter than stated, or cannot hold that many pixels.
    """

    def __init__(  # noqa: PLR0917 - what a stream is, in the order of `RawFrames`
        self,
        path: Path,
        offset: int,
        length: int | None,
        count: int,
        shape: tuple[int, ...],
        dtype: np.dtype[Any],
        wrapper: int,
    ) -> None:
        self._path, self._count, self._wrapper = path, count, wrapper
        self.shape, self.dtype, self._stored = shape, dtype.newbyteorder("="), dtype
        self._start, self._end = offset, _stream_end(path, offset, length)
        check_frame_size(path.name, shape, dtype)
        self._check_expansion()
        self._lock = threading.Lock()
        self._cursor = self._first()
        self._checkpoints: dict[int, _Cursor] = {}
        self._stride = max(CHECKPOINT_EVERY, count // MOST_CHECKPOINTS)

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Image]:
        cursor = self._first()
        for _ in range(self._count):
            yield self._next(cursor)

    def read(self, index: int) -> Image:
        """Frame `index`."""
        with self._lock:
            self._go_to(index)
            return self._advance()

    def _first(self) -> _Cursor:
        return _Cursor(self._start, _zlib.decompressobj(wbits=self._wrapper))

    def _go_to(self, index: int) -> None:
        saved = max((k for k in self._checkpoints if k <= index), default=None)
        if index < self._cursor.frame or (saved is not None and saved > self._cursor.frame):
            self._cursor = self._first() if saved is None else self._checkpoints[saved].copy()
        while self._cursor.frame < index:
            self._advance()

    def _advance(self) -> Image:
        image = self._next(self._cursor)
        place = self._cursor.frame
        if place % self._stride == 0 and place not in self._checkpoints:
            self._checkpoints[place] = self._cursor.copy()
        return image

    def _next(self, cursor: _Cursor) -> Image:
        index = cursor.frame
        try:
            data = self._take(cursor, self.frame_bytes)
            if index == self._count - 1:
                self._finish(cursor)
        except (zlib.error, _zlib.error) as error:
            raise FormatError(
                f"{self._path.name}, frame {index}: its compressed pixels are damaged "
                f"({_reason(error)}); copy or record it again"
            ) from None
        if len(data) < self.frame_bytes:
            raise FormatError(
                f"{self._path.name}, frame {index}: its compressed pixels end early, {len(data)} of "
                f"{self.frame_bytes} bytes; copy or record it again"
            )
        cursor.frame += 1
        return as_frame(self._path.name, index, data, self.shape, self._stored)

    def _take(self, cursor: _Cursor, wanted: int) -> bytearray:
        """The next bytes of the stream, fewer than wanted only at its end."""
        data = bytearray(wanted)
        filled = 0
        while filled < wanted and not cursor.inflater.eof:
            if not cursor.pending:
                cursor.pending = self._chunk(cursor)
            piece = cursor.inflater.decompress(cursor.pending, min(wanted - filled, PIECE))
            if not piece and not cursor.pending:
                break
            cursor.pending = cursor.inflater.unconsumed_tail
            data[filled : filled + len(piece)] = piece
            filled += len(piece)
        del data[filled:]
        return data

    def _chunk(self, cursor: _Cursor) -> bytes:
        data = read_at(self._path, cursor.position, min(PIECE, self._end - cursor.position))
        cursor.position += len(data)
        return data

    def _finish(self, cursor: _Cursor) -> None:
        """Reach the stream's end, where its checksum is compared."""
        if self._take(cursor, 1):
            raise FormatError(
                f"{self._path.name}: holds more pixels than the {self._count} frames its header states; "
                "correct the header's size"
            )
        if not cursor.inflater.eof:
            raise FormatError(
                f"{self._path.name}: its compressed pixels lack their end; copy or record it again"
            )

    def _check_expansion(self) -> None:
        wanted, there = self._count * self.frame_bytes, self._end - self._start
        if wanted > LARGEST_EXPANSION * there + PIECE:
            raise FormatError(
                f"{self._path.name}: {there} compressed bytes cannot hold the {self._count} frames of "
                f"{'x'.join(map(str, self.shape))} that its header states; is the size right?"
            )


def _stream_end(path: Path, offset: int, length: int | None) -> int:
    size = file_size(path)
    if length is None:
        return max(size, offset)
    if not 0 <= length <= size - offset:
        raise FormatError(
            f"{path.name}: states {length} compressed bytes but holds {max(size - offset, 0)}; "
            "it was cut short, copy or record it again"
        )
    return offset + length


def _reason(error: Exception) -> str:
    return str(error).split(": ", 1)[-1]
