"""Images in succession, a few at a time, with all that a piece of the volume must know of them."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.reconstruction.grid import Grid
from sonocal.reconstruction.joining import image_planes, joined_images
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.pieces import Batch
from sonocal.reconstruction.placed import Placed
from sonocal.reconstruction.speckle import averaged_over

__all__ = ["Crossing", "crossing", "spans_of"]

BATCH_BYTES = 24 << 20
FEWEST, MOST = 2, 64
"""Images of a batch: pairs need two."""


@dataclass(frozen=True, eq=False)
class Crossing:
    """Images of a sweep as they cross a grid.

    Attributes:
        placed: the images.
        grid: the voxels.
        options: how values come to voxels.
        mask: (rows, columns): where the images show ultrasound.
        corners_mm: (n, 4, 3), of the rectangle around the mask.
        spans: of the mask.
    """

    placed: Placed
    grid: Grid
    options: Options
    mask: NDArray[np.bool_]
    corners_mm: Array
    spans: NDArray[np.int32]

    @cached_property
    def voxel_from_pixel(self) -> Array:
        """(n, 3, 4)."""
        matrices = np.linalg.inv(self.grid.reference_from_voxel) @ self.placed.reference_from_image
        return np.ascontiguousarray(matrices[:, :3])

    @cached_property
    def pixel_from_voxel(self) -> Array:
        """(n, 3, 4): (u, v, w)."""
        planes = image_planes(self.placed.reference_from_image) @ self.grid.reference_from_voxel
        return np.ascontiguousarray(planes[:, :3])

    @cached_property
    def boxes(self) -> tuple[Array, Array]:
        """(n, 3) each, in voxels: the lowest and the highest corner of the box around each image."""
        corners = (self.corners_mm - self.grid.origin_mm) / self.grid.spacing_mm
        return corners.min(axis=1), corners.max(axis=1)

    @cached_property
    def joined(self) -> NDArray[np.int32]:
        """(n - 1,): as `joined_images`."""
        return joined_images(self.placed, self.corners_mm, self.options.longest_gap_mm)

    @cached_property
    def _half_mm(self) -> Array:
        normal = image_planes(self.placed.reference_from_image)[:, 2, :3]
        return np.asarray(0.5 * (np.abs(normal) * self.grid.spacing_mm).sum(axis=1))

    @cached_property
    def box_px(self) -> tuple[int, int]:
        """Pixels of the image to a voxel, along u and v: over so many speckle is averaged."""
        steps = np.linalg.norm(self.voxel_from_pixel[0, :, :2], axis=0)
        across, down = (max(1, round(1.0 / step)) for step in steps)
        return across, down

    @property
    def averages(self) -> bool:
        """Whether speckle is averaged."""
        return self.options.interpolation == "between" and self.options.speckle == "averaged"

    @property
    def overlap(self) -> int:
        """Images that a batch shares with the one before."""
        return int(self.options.interpolation == "between")

    def ranges(self) -> Iterator[tuple[int, int]]:
        """The first image and the last + 1 of each batch; pairs lie in one."""
        bytes_each = self.placed.height * self.placed.width * self.placed.dtype.itemsize
        count = int(np.clip(BATCH_BYTES // bytes_each, FEWEST, MOST))
        start, n = 0, len(self.placed)
        while start == 0 or start < n - self.overlap:
            stop = min(start + count, n)
            yield start, stop
            if stop == n:
                return
            start = stop - self.overlap

    def batch(self, start: int, stop: int, images: NDArray[Any]) -> Batch:
        """The batch of images start <= i < stop."""
        low, high = self.boxes
        part = slice(start, stop)
        return Batch(
            images=images,
            voxel_from_pixel=self.voxel_from_pixel[part],
            pixel_from_voxel=self.pixel_from_voxel[part],
            low=low[part],
            high=high[part],
            joined=self.joined[start : stop - 1],
            goes_on=stop < len(self.placed) and bool(self.joined[stop - 1]),
            spans=self.spans,
            mask=self.mask.view(np.uint8),
            half_mm=self._half_mm[part],
            fresh=self.overlap if start else 0,
        )

    def pixels(self, start: int, stop: int) -> Iterator[NDArray[Any]]:
        """Images start <= i < stop, averaged where that is wanted."""
        for image in self.placed.pixels(start, stop):
            yield averaged_over(image, self.box_px) if self.averages else image


class Images:
    """The images of a crossing, decoded once, and kept in a temporary file where a large volume asks for them again.

    Args:
        crossing: the images.
        again: whether they will be asked for more than once.
    """

    def __init__(self, crossing: Crossing, again: bool) -> None:
        self._crossing, self._again = crossing, again
        self._file = tempfile.TemporaryFile() if again else None  # noqa: SIM115 - closed with this object
        placed = crossing.placed
        self._shape = (placed.height, placed.width)
        self._dtype = placed.dtype
        self._kept = 0  # images in the file
        self._last: tuple[int, NDArray[Any]] | None = None

    def read(self, start: int, stop: int) -> NDArray[Any]:
        """(stop - start, rows, columns)."""
        images = np.empty((stop - start, *self._shape), dtype=self._dtype)
        done = 0
        if self._file is not None and self._kept >= stop:
            return self._from_file(start, images)
        if self._last is not None and self._last[0] == start:
            images[0], done = self._last[1], 1
        for i, image in enumerate(self._crossing.pixels(start + done, stop), done):
            images[i] = image
        self._last = (stop - 1, images[-1].copy())
        if self._file is not None:
            self._keep(start, stop, images)
        return images

    def close(self) -> None:
        """Give back what they are kept in."""
        if self._file is not None:
            self._file.close()

    def _from_file(self, start: int, images: NDArray[Any]) -> NDArray[Any]:
        assert self._file is not None
        self._file.seek(start * images[0].nbytes)
        self._file.readinto(images.data.cast("B"))
        return images

    def _keep(self, start: int, stop: int, images: NDArray[Any]) -> None:
        assert self._file is not None
        try:
            self._file.seek(start * images[0].nbytes)
            self._file.write(images.data.cast("B"))
        except OSError as error:
            raise InputError(
                f"{tempfile.gettempdir()}: decoded images cannot be kept there ({error.strerror}); make room, or name "
                "another folder in TMPDIR"
            ) from None
        self._kept = stop


def crossing(
    placed: Placed, grid: Grid, options: Options, mask: NDArray[np.bool_], corners_mm: Array
) -> Crossing:
    """The images of a sweep as they cross a grid."""
    return Crossing(placed, grid, options, np.ascontiguousarray(mask), corners_mm, spans_of(mask))


def spans_of(mask: NDArray[np.bool_]) -> NDArray[np.int32]:
    """(k, 3): row, first and last column + 1 of every run of pixels of a mask."""
    edges = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, first = np.nonzero(edges == 1)
    last = np.nonzero(edges == -1)[1]
    return np.stack([rows, first, last], axis=1).astype(np.int32)
