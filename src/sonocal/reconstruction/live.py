"""A volume that grows while the probe moves: images are put in as they come, and cuts through it are always there."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.calibration import Calibration
from sonocal.detection import find_mask
from sonocal.errors import InputError, UnsupportedError, require
from sonocal.existing import Existing
from sonocal.geometry.shown import quoted
from sonocal.reconstruction.bricks import Bricks, Span
from sonocal.reconstruction.grid import Grid, given_spacing, grid_around, grid_of_size, grid_within
from sonocal.reconstruction.item_poses import ItemPoses
from sonocal.reconstruction.options import options_of
from sonocal.reconstruction.placed import grey_levels, image_matrix
from sonocal.reconstruction.previews import Picture, picture_of
from sonocal.reconstruction.succession import Put, Succession
from sonocal.reconstruction.volume import Volume
from sonocal.recording.stream import Item

__all__ = ["LiveVolume"]

FIRST_IMAGES = 24
"""As many as a mask is made of."""
SHOWN_VOXELS = 512
"""From the place that is looked at, either way along each axis."""


class LiveVolume:
    """A volume of items that come one at a time.

    Once `finish` was called its voxels are those of `reconstruct` of the same items, with the same options and mask;
    without `bounds_mm` but for those that lie on an image's rim as closely as doubles are rounded. A mask that is not
    given is found from the first images, which wait until there are enough. Between images, what is after an image is
    known with the next: the cuts are one image behind the probe.

    Args:
        calibration: ours, a matrix of other software, or (4, 4) mm in the probe marker's frame from px.
        name: what messages call the recording.
        **options: those of `reconstruct`; without `smooth` and `error`, which rest on all poses.

    Attributes:
        images: how many were put in.
        refusal: why the last item was left out, in a sentence; "" where it was not.

    Raises:
        InputError: an option means nothing.
    """

    def __init__(
        self, calibration: Calibration | Existing | ArrayLike, *, name: str = "live", **options: Any
    ) -> None:
        self._options = options_of(options)
        if self._options.smooth or self._options.error:
            raise InputError(
                "a live volume has no smooth and no error, which rest on all poses; record the sweep, and reconstruct "
                "it then"
            )
        mask = None if self._options.mask is None else np.asarray(self._options.mask)
        if mask is not None and (mask.ndim != 2 or mask.dtype != np.bool_ or not mask.any()):
            raise InputError(
                f"mask must be (rows, columns), True where images show ultrasound, and not empty; got {mask.dtype} of "
                f"shape {mask.shape}"
            )
        self._matrix, self._name = image_matrix(calibration), name
        self._poses = ItemPoses(name, self._options)
        self._shape: tuple[int, int] | None = None
        self._dtype = np.dtype(np.uint8)
        self._images: Succession | None = None
        self.refusal = ""
        self._restart()

    def __repr__(self) -> str:
        return f"<LiveVolume {quoted(self._name)}: {self.images} images, {len(self._bricks)} bricks>"

    @property
    def left_out(self) -> int:
        """Items that had no valid pose or no image."""
        return self._poses.count - self.images - len(self._waiting)

    def add(self, item: Item) -> bool:
        """Put an item in.

        Returns:
            Whether it has an image with a valid pose; `refusal` says why not.

        Raises:
            InputError: its image is unlike those before, or the volume would grow too large; then it is left out.
            UnsupportedError: images of this kind are not put into volumes.
        """
        require("item", item, Item)
        image = None if item.image is None else self._checked(item.image)
        number, reference = self._poses.count, self._poses.reference
        pose, self.refusal = self._poses.of(item)
        if reference not in (None, self._poses.reference):
            self._restart()  # what was put in lies in another frame
        if pose is None or image is None:
            return False
        put = (number, image, pose @ self._matrix)
        if self._images is not None:
            self._put(self._images, put)
            return True
        self._waiting.append((number, image.copy(), put[2]))
        if len(self._waiting) == FIRST_IMAGES:
            self._images = self._begin()
        return True

    def slices(self, at_mm: ArrayLike | None = None) -> tuple[Picture, ...]:
        """Three cuts at right angles to z, y and x, as `preview` lays them out; none before there is anything.

        Args:
            at_mm: (3,), the place that all of them go through; None: the middle of the last image.
        """
        if not self.images:
            return ()
        grid, axes = self._grid, self._options.axes
        middle = self._middle if at_mm is None else np.asarray(at_mm, dtype=float)
        at = np.rint((middle - grid.origin_mm) / grid.spacing_mm).astype(np.int64)
        low, end = self._span()
        low, end = np.maximum(low, at - SHOWN_VOXELS), np.minimum(end, at + SHOWN_VOXELS)
        if (low >= end).any():
            return ()
        cuts = [(axis, self._bricks.cut(axis, int(at[axis]), (low, end), self._dtype)) for axis in (2, 1, 0)]
        places, shown = grid.origin_mm + grid.spacing_mm * at, self._part((low, end))
        return tuple(picture_of(cut, shown, axis, float(places[axis]), axes) for axis, cut in cuts)

    def volume(self) -> Volume:
        """What was put in so far.

        Raises:
            InputError: that is nothing, or too large.
        """
        if not self.images:
            raise InputError(f"{self._name}: no image was put in yet{self.refusal and '; '}{self.refusal}")
        span = self._span()
        grid = self._part(span)
        values, counts = self._bricks.gathered(span, self._dtype)
        filled, coverage = int(np.count_nonzero(counts)), counts if self._options.coverage else None
        reference = self._poses.reference or ""
        return Volume(
            values, grid, reference, self.images, self.left_out, filled, coverage, source=self._name
        )

    def finish(self) -> Volume:
        """The volume of all items: nothing comes after the last.

        Raises:
            InputError: as `volume`.
        """
        if self._waiting:
            self._images = self._begin()
        if self._images is not None:
            self._images.finish()
        return self.volume()

    def _restart(self) -> None:
        """Nothing is known yet."""
        options, spacing = self._options, given_spacing(self._options.spacing_mm)
        self.images = 0
        self._low, self._high, self._middle = np.full(3, np.inf), np.full(3, -np.inf), np.zeros(3)
        self._waiting: list[Put] = []
        self._bounded = options.bounds_mm is not None
        if options.bounds_mm is None:
            self._grid = grid_of_size(np.zeros(3), spacing, np.ones(3), self._name)
        else:
            self._grid = grid_within(options.bounds_mm, spacing, self._name)
        self._bricks = Bricks(self._name, self._grid, options, self._grid.size if self._bounded else None)
        self._images = None if options.mask is None else self._within(options.mask)

    def _within(self, mask: NDArray[np.bool_]) -> Succession:
        return Succession(self._name, self._grid, self._options, mask, self._bricks)

    def _checked(self, image: NDArray[Any]) -> NDArray[Any]:
        if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16, np.bool_) or min(image.shape) < 2:
            raise UnsupportedError(
                f"{self._name}: a volume is made of 2D images (rows, columns) of uint8 or uint16; got {image.shape} of "
                f"{image.dtype}"
            )
        grey = grey_levels(image)
        rows, columns = grey.shape
        mask = self._options.mask
        known = self._shape or (grey.shape if mask is None else mask.shape)
        if (known != grey.shape) or (self._shape is not None and grey.dtype != self._dtype):
            raise InputError(
                f"{self._name}: its images, and the mask, are of one size and depth; got {columns} x {rows} px, "
                f"{grey.dtype}, after {known[::-1]} px; leave the scanner's depth and format as they are"
            )
        self._shape, self._dtype = (rows, columns), grey.dtype
        return grey

    def _begin(self) -> Succession:
        """Find the mask, and put in what has waited."""
        images = self._within(find_mask([image for _, image, _ in self._waiting], 2, self._name))
        waiting, self._waiting = self._waiting, []
        for put in waiting:
            self._put(images, put)
        return images

    def _put(self, images: Succession, put: Put) -> None:
        corners = images.put(*put)
        self._middle = corners.mean(axis=0)
        self._low = np.minimum(self._low, corners.min(axis=0))
        self._high = np.maximum(self._high, corners.max(axis=0))
        self.images += 1

    def _span(self) -> Span:
        """The voxels of the volume, from the grid's first on."""
        if self._bounded:
            return np.zeros(3, np.int64), np.array(self._grid.size)
        around = grid_around(np.stack([self._low, self._high]), self._grid.spacing_mm, self._name)
        low = np.rint(around.origin_mm / around.spacing_mm).astype(np.int64)
        return low, low + around.size

    def _part(self, span: Span) -> Grid:
        low, end = span
        origin = self._grid.origin_mm + self._grid.spacing_mm * low
        return grid_of_size(origin, self._grid.spacing_mm, end - low, self._name)
