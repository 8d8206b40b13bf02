"""Pieces of a volume: what their voxels have been given so far. Threads may fill several: they share nothing."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import Array
from sonocal.reconstruction.grid import Grid
from sonocal.reconstruction.options import Options

__all__ = ["SIDE", "Batch", "Piece", "boxes_of", "new_piece"]

SIDE = 128
"""Voxels of a piece along each axis: its sums stay in the processor's cache while an image crosses them."""
KEPT_PARTS, PIXEL_PARTS = 256, 1
Box = tuple[tuple[int, int, int], tuple[int, int, int]]
"""The lowest voxel of a box and its size, each along x, y and z."""


@dataclass(frozen=True, eq=False)
class Batch:
    """Some images in succession.

    Attributes:
        images: (n, rows, columns).
        voxel_from_pixel: (n, 3, 4).
        pixel_from_voxel: (n, 3, 4): (u, v, w), of which w is in mm off the image's plane.
        low, high: (n, 3), voxels: the box that each image crosses.
        joined: (n - 1,), not 0 where the probe passed steadily from an image to the next.
        goes_on: whether the last image is joined to one after it.
        spans: (k, 3): row, first and last column + 1 of runs of pixels that show ultrasound.
        mask: (rows, columns), not 0 where there is ultrasound.
        half_mm: (n,): half a voxel, along each image's normal.
        fresh: 1 where the first image was the last of the batch before, else 0.
    """

    images: NDArray[Any]
    voxel_from_pixel: Array
    pixel_from_voxel: Array
    low: Array
    high: Array
    joined: NDArray[np.int32]
    goes_on: bool
    spans: NDArray[np.int32]
    mask: NDArray[np.uint8]
    half_mm: Array
    fresh: int = 0


class Piece:
    """A box of voxels.

    Args:
        box: its lowest voxel and its size.
        options: how values come to voxels.
    """

    def __init__(self, box: Box, options: Options) -> None:
        self.low, self.size = box
        self.compounding = options.compounding
        self._low = np.array(self.low, dtype=np.int32)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of arrays [z, y, x]."""
        x, y, z = self.size
        return z, y, x

    @property
    def place(self) -> tuple[slice, slice, slice]:
        """Where it is in the volume's array [z, y, x]."""
        x, y, z = (slice(low, low + size) for low, size in zip(self.low, self.size, strict=True))
        return z, y, x

    def crossed_by(self, batch: Batch, margin: float = 1.0) -> NDArray[np.int32]:
        """Which images of a batch may reach a voxel of the piece; those that were in a batch before are left out."""
        end = np.add(self.low, self.size)
        hit = np.all((batch.high >= np.subtract(self.low, margin)) & (batch.low <= end + margin), axis=1)
        hit[: batch.fresh] = False
        return np.flatnonzero(hit).astype(np.int32)

    def insert(self, batch: Batch) -> None:
        """Give the voxels what a batch of images says of them."""
        raise NotImplementedError

    def settle(self, dtype: np.dtype[Any]) -> tuple[NDArray[Any], NDArray[np.uint32]]:
        """The values of the voxels, and how many each was given."""
        raise NotImplementedError

    def layer(self, axis: int, index: int) -> Self:
        """The piece's voxels of one layer alone: `index` from its lowest voxel along x, y or z (`axis` 0, 1, 2)."""
        part = copy(self)
        low, size = list(self.low), list(self.size)
        low[axis], size[axis] = low[axis] + index, 1
        part.low, part.size = (low[0], low[1], low[2]), (size[0], size[1], size[2])
        return part


class Nearest(Piece):
    """Each pixel goes to the nearest voxel."""

    def __init__(self, box: Box, options: Options) -> None:
        super().__init__(box, options)
        self._cells = np.zeros(self.shape, dtype=np.uint64)

    def insert(self, batch: Batch) -> None:
        """As `Piece.insert`."""
        if len(which := self.crossed_by(batch)):
            _core.insert_nearest(
                self._cells,
                self._low,
                batch.images,
                batch.voxel_from_pixel,
                which,
                batch.spans,
                self.compounding,
            )

    def settle(self, dtype: np.dtype[Any]) -> tuple[NDArray[Any], NDArray[np.uint32]]:
        """As `Piece.settle`."""
        return _settled(self._cells, self.compounding, PIXEL_PARTS, dtype)

    def layer(self, axis: int, index: int) -> Self:
        """As `Piece.layer`."""
        part = super().layer(axis, index)
        part._cells = _cut(self._cells, axis, index)
        return part


class Linear(Piece):
    """Each pixel goes to the eight voxels around it, by their distances."""

    def __init__(self, box: Box, options: Options) -> None:
        super().__init__(box, options)
        self._sums = np.zeros((*(n + 2 for n in self.shape), 2))

    def insert(self, batch: Batch) -> None:
        """As `Piece.insert`."""
        if len(which := self.crossed_by(batch, 2.0)):
            _core.insert_linear(
                self._sums, self._low, batch.images, batch.voxel_from_pixel, which, batch.spans
            )

    def settle(self, dtype: np.dtype[Any]) -> tuple[NDArray[Any], NDArray[np.uint32]]:
        """As `Piece.settle`."""
        values, counts = np.empty(self.shape, dtype), np.empty(self.shape, np.uint32)
        _core.settle_sums(self._sums, values, counts)
        return values, counts

    def layer(self, axis: int, index: int) -> Self:
        """As `Piece.layer`."""
        part = super().layer(axis, index)
        part._sums = _cut(self._sums, axis, index, 3)  # with a layer on either side, as all of it
        return part


class Between(Piece):
    """Voxels between two images, and, where nothing is between, those within half a voxel of one."""

    def __init__(self, box: Box, options: Options) -> None:
        super().__init__(box, options)
        self._cells = np.zeros(self.shape, dtype=np.uint64)
        self._alone: NDArray[np.uint64] | None = None

    def insert(self, batch: Batch) -> None:
        """As `Piece.insert`."""
        given = (batch.images, batch.pixel_from_voxel, batch.joined)
        _core.insert_between(self._cells, self._low, *given, batch.mask, self.compounding)
        # An image that two batches share is looked at with the first of them.
        before = np.concatenate([[False], batch.joined != 0])
        after = np.concatenate([batch.joined != 0, [batch.goes_on]])
        for k in self.crossed_by(batch, 2.0):
            if not (before[k] and after[k]):
                self._insert_alone(batch, int(k), bool(before[k]), bool(after[k]))

    def _insert_alone(self, batch: Batch, k: int, before: bool, after: bool) -> None:
        if self._alone is None:
            self._alone = np.zeros(self.shape, dtype=np.uint64)
        _core.insert_alone(
            self._alone,
            self._low,
            batch.images[k : k + 1],
            batch.pixel_from_voxel[k : k + 1],
            batch.joined[:0],
            batch.mask,
            self.compounding,
            half_mm=float(batch.half_mm[k]),
            first=before,
            last=after,
        )

    def settle(self, dtype: np.dtype[Any]) -> tuple[NDArray[Any], NDArray[np.uint32]]:
        """As `Piece.settle`."""
        values, counts = _settled(self._cells, self.compounding, KEPT_PARTS, dtype)
        if self._alone is not None:
            further, times = _settled(self._alone, self.compounding, KEPT_PARTS, dtype)
            empty = counts == 0
            values[empty], counts[empty] = further[empty], times[empty]
        return values, counts

    def layer(self, axis: int, index: int) -> Self:
        """As `Piece.layer`."""
        part = super().layer(axis, index)
        part._cells = _cut(self._cells, axis, index)
        part._alone = None if self._alone is None else _cut(self._alone, axis, index)
        return part


KINDS: dict[str, type[Piece]] = {"nearest": Nearest, "linear": Linear, "between": Between}
BYTES_A_VOXEL = {"nearest": 8, "linear": 17, "between": 16}


def new_piece(box: Box, options: Options) -> Piece:
    """An empty piece."""
    return KINDS[options.interpolation](box, options)


def boxes_of(grid: Grid, threads: int) -> Iterator[Box]:
    """Boxes that fill a grid, x fastest: as large as `SIDE`, or smaller where threads would have none."""
    deep = SIDE
    if threads > 1:
        across = -(-grid.size[0] // SIDE) * -(-grid.size[1] // SIDE)
        deep = min(SIDE, max(8, -(-grid.size[2] * across // (4 * threads))))
    sides = (SIDE, SIDE, deep)
    for z in range(0, grid.size[2], deep):
        for y in range(0, grid.size[1], SIDE):
            for x in range(0, grid.size[0], SIDE):
                low = (x, y, z)
                i, j, k = (min(s, n - a) for s, n, a in zip(sides, grid.size, low, strict=True))
                yield low, (i, j, k)


def _cut(cells: NDArray[Any], axis: int, index: int, count: int = 1) -> NDArray[Any]:
    """Layers of an array [z, y, x]."""
    return np.ascontiguousarray(cells.take(range(index, index + count), axis=2 - axis))


def _settled(
    cells: NDArray[np.uint64], compounding: str, parts: int, dtype: np.dtype[Any]
) -> tuple[NDArray[Any], NDArray[np.uint32]]:
    values, counts = np.empty(cells.shape, dtype), np.empty(cells.shape, np.uint32)
    _core.settle_cells(cells, compounding, parts, values, counts)
    return values, counts
