"""Images that come one at a time, put into bricks as soon as what they need of the next is known."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.reconstruction.batches import Crossing, spans_of
from sonocal.reconstruction.bricks import Bricks
from sonocal.reconstruction.grid import Grid
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.placed import Placed
from sonocal.reconstruction.speckle import averaged_over
from sonocal.recording import ArrayFrames

__all__ = ["Put", "Succession"]

Put = tuple[int, NDArray[Any], Array]
"""The number of an item, its image [v, u], and (4, 4): mm in the volume's frame from px."""


class Succession:
    """Images in their order.

    Args:
        name: of the recording, for messages.
        grid: where voxel (0, 0, 0) lies.
        options: how values come to voxels.
        mask: (rows, columns): where the images show ultrasound.
        bricks: what they are put into.
    """

    def __init__(
        self, name: str, grid: Grid, options: Options, mask: NDArray[np.bool_], bricks: Bricks
    ) -> None:
        self._name, self._grid, self._options, self._bricks = name, grid, options, bricks
        self._mask, self._spans = np.ascontiguousarray(mask), spans_of(mask)
        rows, columns = np.nonzero(mask)
        self._rim = np.array([columns.min(), rows.min()]), np.array([columns.max(), rows.max()])
        self._pairs = options.interpolation == "between"
        self._window: list[Put] = []
        self._shared = 0
        self._box_px: tuple[int, int] | None = None

    def put(self, number: int, image: NDArray[Any], matrix: Array) -> Array:
        """Put an image in; (4, 3) mm: where its corners are.

        Raises:
            InputError: the volume would grow too large; the image is left out then.
        """
        alone = self._crossing([(number, image, matrix)])
        self._box_px = self._box_px or alone.box_px  # of the first image, as for a whole recording
        seen = averaged_over(image, self._box_px) if alone.averages else image
        window = [*self._window[-2:], (number, seen.copy(), matrix)]
        if not self._pairs:
            self._insert(window[-1:], 1)
        elif len(window) == 3:  # only now it is known whether the second goes on
            self._insert(window, 2)
            self._shared = 1
        self._window = window
        return np.asarray(alone.corners_mm[0])

    def finish(self) -> None:
        """Nothing comes after the last image."""
        if self._pairs and self._window:
            self._insert(self._window[-2:], 2)
        self._window = []

    def _insert(self, images: list[Put], count: int) -> None:
        """Give voxels what the first of some images say of them; one more says only whether the last goes on."""
        stack = np.stack([image for _, image, _ in images[:count]])
        batch = self._crossing(images).batch(0, len(stack), stack)
        batch = replace(batch, fresh=self._shared if len(images) > 1 else 0)
        for piece in self._bricks.reached(batch):
            piece.insert(batch)

    def _crossing(self, images: list[Put]) -> Crossing:
        placed = Placed(
            self._name,
            ArrayFrames(np.stack([image for _, image, _ in images])),
            np.array([number for number, _, _ in images]),
            np.stack([matrix for _, _, matrix in images]),
            "",
        )
        corners = placed.corners_mm(*self._rim)
        return Crossing(placed, self._grid, self._options, self._mask, corners, self._spans)
