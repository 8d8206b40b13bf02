"""The needle's section in a 2D image: several candidates, sub-pixel, each with its covariance."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.detection.grey import as_grey
from sonocal.detection.options import Centre
from sonocal.errors import InputError
from sonocal.geometry import Array

__all__ = ["LEAST_SCORE", "PointDetector"]

SCALES = 6
RATIO = 1.6
"""Between neighbouring scales; a difference of Gaussians of this ratio comes closest to the Laplacian."""
FINEST_SHARE = 1 / 300
"""Of the image's smaller side: the finest scale, at least 1 px."""
LEAST_SCORE = 4.0
LEAST_NOISE = 1.0

# Where a blob is cut (of its contrast), how deep a valley parts it, and whether its first echo is looked for.
CUTS: dict[str, tuple[float, float, bool]] = {"head": (0.55, 0.1, True), "mass": (0.2, 0.3, False)}

# error^2 = FLOOR + SHAPE x shape of the blob, by component, px^2. That of the first echo is fitted to simulated
# needles, that of the mass to what PLUS's own segmentation of real wires differs by.
FLOOR_PX2 = {"head": 0.003, "mass": 0.02}
SHAPE = {"head": np.full((2, 2), 0.00015), "mass": np.array([[0.007, 0.0213], [0.0213, 0.065]])}

# What a first echo's place is uncertain by as its tail runs into it and their phases happen to be: steeply more the
# taller it is, in units of the image's finest scale, up to what a tail can move it by; beams are not quite upright.
MERGED_SCALES = 10.0
TAIL_PX2 = np.diag([0.14, 0.9])
# The less an echo stands out, the less certain its place; the numbers above are for this contrast.
USUAL_CONTRAST = 130.0


class PointDetector:
    """Finds bright compact places in images of one size. Not for use from several threads at once.

    Args:
        mask: True where to look, shaped like an image.
        count: candidates an image at the most.
        centre: "head": the middle of the first echo, without its tail: the needle. "mass": the middle of all that
            is bright, as PLUS segments wires.
        scales_px: standard deviations of the filters, increasing; default: by the image's size.
        least_score: below it a place is noise.

    Raises:
        InputError: the mask leaves nothing to look at, or a number makes no sense.
    """

    def __init__(
        self,
        mask: NDArray[np.bool_],
        count: int = 5,
        *,
        centre: Centre = "head",
        scales_px: tuple[float, ...] | None = None,
        least_score: float = LEAST_SCORE,
    ) -> None:
        scales = scales_px or default_scales(mask.shape)
        if count < 1 or len(scales) < 2 or not all(0 < a < b for a, b in pairwise(scales)):
            raise InputError(
                f"detection needs a count and two or more increasing scales; got {count} and {scales}"
            )
        if not mask.any():
            raise InputError("the mask hides the whole image; give another one")
        if centre not in CUTS:
            raise InputError(f"centre must be one of {', '.join(CUTS)}; got {centre!r}")
        self._filter = _core.BlobFilter(
            np.ascontiguousarray(mask, dtype=np.uint8), list(scales), max(1, round(scales[0]))
        )
        self._shape, self._count, self._least, self._centre = mask.shape, count, least_score, centre

    def __repr__(self) -> str:
        height, width = self._shape
        return f"<PointDetector of images of {width} x {height} px: {self._count} candidates, centre {self._centre!r}>"

    def detect(self, image: NDArray[Any], name: str = "image") -> tuple[Array, Array, Array]:
        """Candidates of one image, best first.

        Returns:
            points (K, 2) px, covariances (K, 2, 2) px^2, scores (K,).

        Raises:
            InputError: the image has another size than the mask.
        """
        grey = as_grey(image, 2, name)
        if grey.shape != self._shape:
            raise InputError(
                f"{name}: is {grey.shape} where the mask is {self._shape}; give one of the same size"
            )
        level, split, first_echo = CUTS[self._centre]
        blobs = self._filter.detect(
            grey,
            count=self._count,
            least_score=self._least,
            least_contrast=LEAST_NOISE,
            level=level,
            split=split,
            first_echo=first_echo,
        )
        return blobs[:, :2], self._covariances(blobs), blobs[:, 2]

    def _covariances(self, blobs: Array) -> Array:
        shape = blobs[:, [5, 6, 6, 7]].reshape(-1, 2, 2)
        covariances = FLOOR_PX2[self._centre] * np.eye(2) + SHAPE[self._centre] * shape
        if self._centre == "head":
            upright = shape[:, 1, 1] - shape[:, 0, 1] ** 2 / np.maximum(shape[:, 0, 0], 1e-9)
            merged = np.clip(upright / (MERGED_SCALES * default_scales(self._shape)[0]) ** 2, 0, 1) ** 2
            covariances += merged[:, None, None] * TAIL_PX2
            covariances *= (USUAL_CONTRAST / blobs[:, 4])[:, None, None]
        return np.asarray(covariances)


def default_scales(shape: tuple[int, ...]) -> tuple[float, ...]:
    """Scales for an image of (rows, columns): from a small echo to one that fills a twentieth of the image."""
    finest = max(1.0, min(shape) * FINEST_SHARE)
    return tuple(finest * RATIO**i for i in range(SCALES))
