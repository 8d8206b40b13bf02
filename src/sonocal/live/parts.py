"""Images that arrive in parts, put together."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import igtl
from sonocal.igtl import MOST_BODY

__all__ = ["Whole"]


class Whole:
    """The image that parts are written into: what a part does not touch stays as it was."""

    def __init__(self) -> None:
        self._kept: NDArray[Any] | None = None
        self._refused = ""
        self._said: list[str] = []

    def taken(self, image: igtl.Image) -> igtl.Image | None:
        """The whole image that a message shows; None of one without pixels, or too large."""
        shape = (*image.size_px[::-1], *image.pixels.shape[3:])
        if image.pixels.shape == shape:
            return image if image.pixels.size else None
        size = int(np.prod(shape, dtype=np.int64)) * image.pixels.itemsize
        if not image.pixels.size or not 0 < size <= MOST_BODY:
            sentence = (
                f"an image of {' x '.join(map(str, image.size_px))} px was sent in parts; it is left out"
            )
            if sentence != self._refused:
                self._refused = sentence
                self._said.append(sentence)
            return None
        if self._kept is None or self._kept.shape != shape or self._kept.dtype != image.pixels.dtype:
            self._kept = np.zeros(shape, image.pixels.dtype)
        image.placed_in(self._kept)
        return replace(image, pixels=self._kept.copy(), offset_px=(0, 0, 0))

    def said(self) -> list[str]:
        """What was wrong since the last time."""
        said, self._said = self._said, []
        return said
