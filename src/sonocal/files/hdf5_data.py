"""The numbers of a dataset in HDF5: in one piece of the file, or in equal pieces of it that may be compressed.

Source: "HDF5 File Format Specification Version 3.0", The HDF Group; section numbers stand where they are followed.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.files.hdf5_bytes import UNDEFINED, Bytes, Piece
from sonocal.files.hdf5_parts import Damaged, Filtered, exactly, unpacked

__all__ = ["Dataset"]

COMPACT, CONTIGUOUS, CHUNKED = 0, 1, 2
DEFLATE, SHUFFLE, FLETCHER = 1, 2, 3
# What others are called, by the HDF Group's list of registered filters.
OTHER_FILTERS = {
    **{4: "szip", 5: "n-bit", 6: "scale-offset", 305: "LZO", 307: "bzip2", 32000: "lzf", 32001: "Blosc"},
    **{32004: "LZ4", 32008: "bitshuffle", 32013: "ZFP", 32015: "Zstandard", 32026: "Blosc2"},
}
SLACK = 64
MOST_PIECES = 1 << 18
# Of what is held at once.
MOST_BYTES = 1 << 27

Numbers = NDArray[Any]


class Dataset:
    """Numbers of a file (IV.A.2.i), read row by row.

    Args:
        file: the bytes.
        shape: (rows, ...).
        dtype: of the numbers as they are stored.
        layout: the message that says where they lie.
        filters: what pieces went through, in their order.

    Raises:
        Damaged: they lie in a way that is not read.
        Filtered: they went through a filter that is not read.
    """

    def __init__(
        self, file: Bytes, shape: tuple[int, ...], dtype: np.dtype[Any], layout: bytes, filters: Sequence[int]
    ) -> None:
        self._file, self._filters = file, filters
        self.shape, self.dtype = shape, dtype
        version, self._how = exactly(layout, 2)
        rest = layout[2:]
        if version not in (3, 4) or self._how > CHUNKED or (self._how == CHUNKED and version == 4):
            raise Damaged("its numbers lie otherwise")
        if self._how == COMPACT:
            self._compact = rest[2:]
        elif self._how == CONTIGUOUS:
            (self._address,) = unpacked("<Q", rest)
        else:
            self._rank, self._address = rest[0], unpacked("<Q", rest[1:])[0]
            sizes = unpacked(f"<{self._rank}I", rest[9:])
            self.piece_shape = list(sizes[:-1])
            if (
                not shape
                or len(self.piece_shape) != len(shape)
                or sizes[-1] != dtype.itemsize
                or 0 in self.piece_shape
            ):
                raise Damaged("its pieces are not of its shape")
        if self._how == CHUNKED:
            _check_filters(filters)
        self._slab: tuple[int, Numbers] | None = None

    @classmethod
    def of_one(cls, file: Bytes, size: int, layout: bytes) -> bytes:
        """The bytes of a single value of so many."""
        data = cls(file, (1, size), np.dtype("u1"), layout, []) if layout[1:2] != bytes([CHUNKED]) else None
        if data is None:
            raise Damaged("a text lies in pieces")
        return data.all().tobytes()

    @property
    def size(self) -> int:
        """Bytes of all numbers."""
        return math.prod(self.shape) * self.dtype.itemsize

    @property
    def stored(self) -> int:
        """Bytes that the file has of them; less than `size` of a file that was cut, or that is compressed."""
        if self._how == COMPACT:
            return len(self._compact)
        if self._how == CONTIGUOUS:
            return min(max(self._file.size - self._address, 0), self.size)
        return sum(size for _, size, _ in self._pieces.values())

    @property
    def is_whole(self) -> bool:
        """Whether all numbers are there, as far as can be told without reading them."""
        if self._how == CHUNKED:
            return 0 in self.shape or len(self._pieces) == math.prod(self._grid)
        return self.stored >= self.size

    @property
    def slab_bytes(self) -> int:
        """Bytes that are held at once to read a row: those of all pieces that it is in."""
        if self._how != CHUNKED:
            return self.size // max(*self.shape[:1], 1, 1)
        rounded = (n * size for n, size in zip(self._grid[1:], self.piece_shape[1:], strict=True))
        return self.piece_shape[0] * math.prod(rounded) * self.dtype.itemsize

    def all(self) -> Numbers:
        """All numbers, in the machine's order of bytes."""
        return self.rows(0, self.shape[0]) if self.shape else self.rows(0, 1)

    def rows(self, begin: int, end: int) -> Numbers:
        """Some rows.

        Raises:
            Damaged: they are not all there.
        """
        shape = (end - begin, *self.shape[1:])
        if self._how == CHUNKED:
            found = [self._rows_of_slab(i, begin, end) for i in range(*self._slabs(begin, end))]
            return np.concatenate([np.empty((0, *shape[1:]), self.dtype), *found]).astype(
                self.dtype.newbyteorder("=")
            )
        row = math.prod(self.shape[1:]) * self.dtype.itemsize
        if self._how == COMPACT:
            data = exactly(self._compact, end * row)[begin * row :]
        else:
            data = self._file.at(self._address + begin * row, (end - begin) * row)
        return np.frombuffer(data, self.dtype).reshape(shape).astype(self.dtype.newbyteorder("="), copy=False)

    @cached_property
    def _grid(self) -> tuple[int, ...]:
        """How many pieces there are along each axis."""
        return tuple(-(-n // size) for n, size in zip(self.shape, self.piece_shape, strict=True))

    @cached_property
    def _pieces(self) -> dict[tuple[int, ...], Piece]:
        most = min(math.prod(self._grid), MOST_PIECES)
        found: dict[tuple[int, ...], Piece] = {}
        for start, piece in self._file.pieces(self._address, self._rank, most):
            found[start[:-1]] = piece
            if len(found) > most:
                raise Damaged(f"its numbers lie in more than {most} pieces")
        return found

    def _slabs(self, begin: int, end: int) -> tuple[int, int]:
        size = self.piece_shape[0]
        return begin // size, -(-end // size)

    def _rows_of_slab(self, index: int, begin: int, end: int) -> Numbers:
        first = index * self.piece_shape[0]
        return self._whole_slab(index)[max(begin - first, 0) : min(end, self.shape[0]) - first]

    def _whole_slab(self, index: int) -> Numbers:
        """All pieces along the first axis' piece `index`, joined; the last is kept, since rows are read in turn."""
        if self._slab is None or self._slab[0] != index:
            self._slab = None
            if self.slab_bytes > MOST_BYTES:
                raise Damaged("its pieces are absurdly large")
            sizes = self.piece_shape
            slab = np.empty(
                (sizes[0], *(n * size for n, size in zip(self._grid[1:], sizes[1:], strict=True))), self.dtype
            )
            for place in product(*map(range, self._grid[1:])):
                start = tuple(i * size for i, size in zip((index, *place), sizes, strict=True))
                into = tuple(slice(at, at + size) for at, size in zip(start[1:], sizes[1:], strict=True))
                slab[(slice(None), *into)] = self._piece(start)
            self._slab = index, slab[(slice(None), *map(slice, self.shape[1:]))]
        return self._slab[1]

    def _piece(self, start: tuple[int, ...]) -> Numbers:
        if start not in self._pieces:
            raise Damaged("a piece of its numbers is missing")
        address, stored, mask = self._pieces[start]
        if address == UNDEFINED:
            raise Damaged("a piece of its numbers is missing")
        size = math.prod(self.piece_shape) * self.dtype.itemsize
        data = self._unfiltered(self._file.at(address, stored), mask, size)
        return np.frombuffer(exactly(data, size), self.dtype).reshape(self.piece_shape)

    def _unfiltered(self, data: bytes, mask: int, size: int) -> bytes:
        """A piece as it was before it went through the filters (IV.A.2.l), but for those that it was spared."""
        for i, one in reversed([*enumerate(self._filters)]):
            if mask >> i & 1:
                continue
            if one == DEFLATE:
                data = _inflated(data, size)
            elif one == SHUFFLE:
                data = _unshuffled(data, self.dtype.itemsize)
            elif one == FLETCHER:
                data = data[:-4]
        return data


def _check_filters(filters: Sequence[int]) -> None:
    for one in filters:
        if one not in (DEFLATE, SHUFFLE, FLETCHER):
            raise Filtered(f"the filter {OTHER_FILTERS.get(one, 'of HDF5')} (number {one})")


def _inflated(data: bytes, size: int) -> bytes:
    try:
        return zlib.decompressobj().decompress(data, size + SLACK)
    except zlib.error:
        raise Damaged("its numbers cannot be decompressed") from None


def _unshuffled(data: bytes, width: int) -> bytes:
    """Bytes that were sorted by their place within a number, put back."""
    whole = len(data) // width * width
    return np.frombuffer(data[:whole], np.uint8).reshape(width, -1).T.tobytes() + data[whole:]
