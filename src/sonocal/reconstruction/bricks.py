"""Bricks of a volume that has no bounds yet: they are made where images come."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.reconstruction.grid import Grid
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.pieces import BYTES_A_VOXEL, Batch, Piece, new_piece

__all__ = ["Bricks", "Span"]

SIDE = 64
MOST_BYTES = 2 << 30
REACH_VOXELS = 2.0
"""An image gives something to voxels no further from it."""
MOST_COUNTED = 65535
Index = tuple[int, int, int]
Span = tuple[NDArray[np.int64], NDArray[np.int64]]
"""The lowest voxel of a box and the last + 1, along x, y and z."""


class Bricks:
    """Bricks of voxels at whole multiples of `SIDE`.

    Args:
        name: of the recording, for messages.
        grid: where voxel (0, 0, 0) lies.
        options: how values come to voxels.
        size: of the grid, where its bounds are given: there are no voxels beyond.
    """

    def __init__(self, name: str, grid: Grid, options: Options, size: Index | None) -> None:
        self._name, self._grid, self._options, self._size = name, grid, options, size
        self._pieces: dict[Index, Piece] = {}

    def __len__(self) -> int:
        return len(self._pieces)

    def reached(self, batch: Batch) -> list[Piece]:
        """The pieces that a batch's images may give something to; those that are not there yet are made.

        Raises:
            InputError: there would be too many of them; then none was made.
        """
        wanted = [index for index in self._about(batch) if self._near(index, batch)]
        new = [index for index in wanted if index not in self._pieces]
        needed = (len(self._pieces) + len(new)) * SIDE**3 * BYTES_A_VOXEL[self._options.interpolation]
        if needed > MOST_BYTES:
            raise InputError(
                f"{self._name}: the live volume would take more than {MOST_BYTES >> 30} GB; give bounds_mm of the part "
                "that you want, or a larger spacing_mm"
            )
        for index in new:
            self._pieces[index] = new_piece((self._low(index), self._extent(index)), self._options)
        return [self._pieces[index] for index in wanted]

    def gathered(self, span: Span, dtype: np.dtype[Any]) -> tuple[NDArray[Any], NDArray[np.uint16]]:
        """Values and counts [z, y, x] of the voxels of a box; 0 where no brick is."""
        low, end = span
        values = np.zeros((end - low)[::-1], dtype)
        counts = np.zeros(values.shape, np.uint16)
        for piece in self._within(span):
            of_piece, times = piece.settle(dtype)
            into, part = _common(piece, span)
            values[into], counts[into] = of_piece[part], np.minimum(times[part], MOST_COUNTED)
        return values, counts

    def cut(self, axis: int, index: int, span: Span, dtype: np.dtype[Any]) -> NDArray[Any]:
        """Of a box the values of one layer, at right angles to x, y or z (`axis` 0, 1, 2)."""
        low, end = span[0].copy(), span[1].copy()
        low[axis], end[axis] = index, index + 1
        values = np.zeros((end - low)[::-1], dtype)
        for piece in self._within((low, end)):
            layer = piece.layer(axis, index - piece.low[axis])
            into, part = _common(layer, (low, end))
            values[into] = layer.settle(dtype)[0][part]
        return values.squeeze(axis=2 - axis)

    def _within(self, span: Span) -> Iterator[Piece]:
        """The pieces of which a voxel is in a box."""
        for piece in self._pieces.values():
            if (np.array(piece.low) < span[1]).all() and (np.add(piece.low, piece.size) > span[0]).all():
                yield piece

    def _about(self, batch: Batch) -> Iterator[Index]:
        """The bricks in the box around a batch's images."""
        low = np.floor((batch.low.min(axis=0) - REACH_VOXELS) / SIDE).astype(int)
        high = np.floor((batch.high.max(axis=0) + REACH_VOXELS) / SIDE).astype(int)
        if self._size is not None:
            low, high = np.maximum(low, 0), np.minimum(high, (np.array(self._size) - 1) // SIDE)
        yield from itertools.product(*(range(a, b + 1) for a, b in zip(low, high, strict=True)))

    def _near(self, index: Index, batch: Batch) -> bool:
        """Whether a brick is met by the plane of an image, or lies between two."""
        planes = batch.pixel_from_voxel[:, 2]
        middle = (np.array(index) + 0.5) * SIDE - 0.5
        off = planes[:, :3] @ middle + planes[:, 3]
        reach = np.abs(planes[:, :3]).sum(axis=1) * (SIDE / 2 + REACH_VOXELS)
        return bool((off - reach).min() <= 0 <= (off + reach).max())

    def _low(self, index: Index) -> Index:
        x, y, z = (SIDE * i for i in index)
        return x, y, z

    def _extent(self, index: Index) -> Index:
        if self._size is None:
            return SIDE, SIDE, SIDE
        x, y, z = (min(SIDE, n - low) for n, low in zip(self._size, self._low(index), strict=True))
        return x, y, z


def _common(piece: Piece, span: Span) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """What a piece and a box [z, y, x] share: where it is in the box, and where in the piece."""
    low, end = np.maximum(piece.low, span[0]), np.minimum(np.add(piece.low, piece.size), span[1])
    into, part = (
        tuple(slice(int(a), int(b)) for a, b in zip((low - start)[::-1], (end - start)[::-1], strict=True))
        for start in (span[0], np.array(piece.low))
    )
    return into, part
