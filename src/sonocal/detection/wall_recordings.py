"""Walls in a whole recording, images and volumes alike, one image in memory at a time."""

from __future__ import annotations

from collections import Counter
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.detection.detections import Detections
from sonocal.detection.masks import Mask, find_mask
from sonocal.detection.options import DetectionOptions
from sonocal.detection.recordings import Found, Images
from sonocal.detection.walls import COUNT, WallDetector
from sonocal.geometry import Array
from sonocal.recording import Recording
from sonocal.recording.health import Progress

__all__ = ["RecordedWalls"]

STILL_PX, STILL_SHARE, FEWEST_STILL = 1.5, 0.4, 10
"""A line that stays where it is to so many pixels, in so large a share of the images, is drawn over them or is an echo
within the probe: what is scanned moves through the image as the probe does."""


class RecordedWalls(Images):
    """Walls: lines of images, planes of volumes.

    Attributes:
        reasons: how many images showed none, by why.
    """

    def __init__(self, recording: Recording, options: DetectionOptions) -> None:
        super().__init__(recording, options)
        assert recording.image is not None
        self.dimension = self.points_each = recording.image.dimension
        self.reasons: Counter[str] = Counter()

    @cached_property
    def mask(self) -> Mask:
        """Given, or found from the recording."""
        given = self.options.mask
        if given is not None:
            return given
        return find_mask(self.recording.frames, self.dimension, self.recording.name)

    @cached_property
    def _walls(self) -> WallDetector:
        return WallDetector(self.mask, int(self.options.count or COUNT))

    def everywhere(self, image: NDArray[Any], name: str) -> Found:
        """Walls of one image, best first."""
        walls, why = self._walls.detect(image, name)
        if why:
            self.reasons[why] += 1
        axes = self.dimension
        points = np.array([wall.points_px for wall in walls]).reshape(-1, axes, axes)
        covariances = np.array([wall.covariance_px2 for wall in walls]).reshape(-1, axes, axes, axes)
        return points, covariances, np.array([wall.score for wall in walls], dtype=float)

    def detect(self, progress: Progress | None = None) -> Detections:
        """Walls of every valid image, without what stands still in many of them."""
        self.reasons.clear()
        found = super().detect(progress)
        still = _still(found)
        if not still.any():
            return found
        self.reasons["what stands out stands still in the image"] += len(np.unique(found.frame[still]))
        left = found.select(~still)
        return Detections(
            left.frame,
            left.points_px,
            left.covariance_px2,
            left.score,
            images=found.images,
            source=found.source,
        )


def _still(found: Detections) -> NDArray[np.bool_]:
    """(N,): which sheets are where those of many other images are."""
    still = np.zeros(len(found), dtype=bool)
    if found.images < FEWEST_STILL:
        return still
    for i in range(len(found)):
        if still[i]:
            continue
        alike = _apart(found.points_px, found.points_px[i]) <= STILL_PX
        if len(np.unique(found.frame[alike])) >= STILL_SHARE * found.images:
            still |= alike
    return still


def _apart(points: Array, sheet: Array) -> Array:
    """(N,): the farthest of the points (N, D, D) from the sheet through points (D, D)."""
    sides = sheet[1:] - sheet[0]
    normal = np.linalg.svd(sides)[2][-1]
    return np.asarray(np.abs((points - sheet[0]) @ normal).max(axis=1))
