"""Needles in a whole recording, images and volumes alike, one image in memory at a time.

A detector looks twice: everywhere in every image, and then, once a calibration says where needles must be, for fainter
ones near there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.detection.detections import Detections
from sonocal.detection.lines import detect_line_near, detect_lines
from sonocal.detection.masks import Mask, find_mask
from sonocal.detection.options import DetectionOptions
from sonocal.detection.points import LEAST_SCORE, PointDetector
from sonocal.errors import InputError, require
from sonocal.geometry import Array, image_crossings
from sonocal.recording import ImageGeometry, Recording
from sonocal.recording.health import Progress

__all__ = ["Detector", "Found", "Images", "detect", "detector_of", "require_images"]

POINTS, LINES = 5, 3
"""Detections an image and a volume."""
FAINT_SHARE = 0.5
"""Of the detection's least score: near where the needle must be, a fainter place will do."""
MANY = 25

Found = tuple[Array, Array, Array]
"""Of one image, best first: points (K, P, D) px, their covariances (K, P, D, D) px^2, scores (K,)."""


def detect(
    recording: Recording, options: DetectionOptions | None = None, progress: Progress | None = None
) -> Detections:
    """Places that may be the needle, in every valid image of a recording.

    Args:
        recording: images, 2D or 3D.
        options: how many, and where to look; default: what suits the recording.
        progress: called with how many images are done and how many there are.

    Returns:
        Points in images, lines in volumes; best first within an image.

    Raises:
        InputError: there are no images, or an option is not for such images.
    """
    require("recording", recording, Recording)
    return detector_of(recording, options).detect(progress)


def detector_of(recording: Recording, options: DetectionOptions | None = None) -> Detector:
    """What looks into the images of a recording.

    Raises:
        InputError: there are no images, or an option is not for such images.
    """
    kind = ImageDetector if require_images(recording).dimension == 2 else VolumeDetector
    return kind(recording, options or DetectionOptions())


def require_images(recording: Recording) -> ImageGeometry:
    """What the images of a recording are.

    Raises:
        InputError: it has none.
    """
    if recording.image is None or len(recording.frames) == 0:
        raise InputError(f"{recording.name}: has no images to look for a needle in; record images too")
    return recording.image


class Images(ABC):
    """Looks into the images of one recording, one after the other. Not for use from several threads at once."""

    points_each: int
    dimension: int

    def __init__(self, recording: Recording, options: DetectionOptions) -> None:
        self.recording, self.options = recording, options

    @property
    def mask(self) -> Mask | None:
        """Where it looks; None: everywhere."""
        return None

    @abstractmethod
    def everywhere(self, image: NDArray[Any], name: str) -> Found:
        """What stands out in one image, best first."""

    def detect(self, progress: Progress | None = None) -> Detections:
        """All that stands out in every valid image; as `sonocal.detection.detect`."""
        found: list[Found] = []
        frames: list[int] = []
        for i, image in enumerate(self.recording.frames):
            if self.recording.image_valid[i]:
                found.append(self.everywhere(image, self._name(i)))
                frames += [i] * len(found[-1][2])
            if progress is not None:
                progress(i + 1, len(self.recording))
        return self.together(frames, found)

    def together(self, frames: Sequence[int], found: Sequence[Found]) -> Detections:
        """What was found in some images as one table; `frames` has an entry for each place."""
        each, axes = self.points_each, self.dimension
        none = (np.empty((0, each, axes)), np.empty((0, each, axes, axes)), np.empty(0))
        points, covariances, scores = (np.concatenate(part) for part in zip(none, *found, strict=True))
        return Detections(
            np.array(frames, dtype=np.int64),
            points,
            covariances,
            scores,
            images=len(found),
            source=self.recording.name,
        )

    def _name(self, frame: int) -> str:
        return f"{self.recording.name}, frame {frame}"


class Detector(Images):
    """Looks for needles in the images of one recording, and again where they must be."""

    @abstractmethod
    def near(self, frame: int, needle_px: Array, reach_px: float) -> Array:
        """(K, P, D) px: what may be a needle near where a calibration says that it is.

        Args:
            frame: index of the image.
            needle_px: (2, 3): two points of the needle, anywhere along it.
            reach_px: how far from it to look.
        """


class ImageDetector(Detector):
    """A needle's section, a point of an image."""

    points_each, dimension = 1, 2

    @cached_property
    def mask(self) -> Mask:
        """Given, or found from the recording."""
        given = self.options.mask
        return find_mask(self.recording.frames, name=self.recording.name) if given is None else given

    @cached_property
    def _usual(self) -> PointDetector:
        return PointDetector(
            self.mask, int(self.options.count or POINTS), centre=self.options.centre or "head"
        )

    @cached_property
    def _faint(self) -> PointDetector:
        least = FAINT_SHARE * LEAST_SCORE
        return PointDetector(self.mask, MANY, centre=self.options.centre or "head", least_score=least)

    def everywhere(self, image: NDArray[Any], name: str) -> Found:
        """What stands out in one image, best first."""
        points, covariances, scores = self._usual.detect(image, name)
        return points[:, None], covariances[:, None], scores

    def near(self, frame: int, needle_px: Array, reach_px: float) -> Array:
        """(K, 1, 2) px: fainter places near where the needle crosses the image."""
        place = image_crossings(needle_px[None])[0]
        if not (np.isfinite(place).all() and (place >= 0).all() and (place < self.mask.shape[::-1]).all()):
            return np.empty((0, 1, 2))
        points = self._faint_places(frame)
        return points[np.linalg.norm(points - place, axis=1) <= reach_px, None]

    def _faint_places(self, frame: int) -> Array:
        """All fainter places of an image; the last one's are kept, since its needles follow one another."""
        if getattr(self, "_last", (None, None))[0] != frame:
            points = self._faint.detect(self.recording.frames[frame], self._name(frame))[0]
            self._last = frame, points
        return self._last[1]


class VolumeDetector(Detector):
    """A needle's axis, a line of a volume."""

    points_each, dimension = 2, 3

    def __init__(self, recording: Recording, options: DetectionOptions) -> None:
        super().__init__(recording, options)
        for name in ("mask", "centre"):
            if getattr(options, name) is not None:
                raise InputError(
                    f"{recording.name}: has no 2D images; lines in volumes are found without {name}, leave it out"
                )

    def everywhere(self, image: NDArray[Any], name: str) -> Found:
        """Lines of one volume, best first."""
        lines = detect_lines(image, int(self.options.count or LINES), name=name)
        ends = np.array([line.ends_px for line in lines]).reshape(-1, 2, 3)
        covariances = np.array([line.covariance_px2 for line in lines]).reshape(-1, 2, 3, 3)
        return ends, covariances, np.array([line.score for line in lines], dtype=float)

    def near(self, frame: int, needle_px: Array, reach_px: float) -> Array:
        """(0 or 1, 2, 3) px: the line along the needle; how far it may be off is `detect_line_near`'s to say."""
        line = detect_line_near(self.recording.frames[frame], needle_px, name=self._name(frame))
        return np.empty((0, 2, 3)) if line is None else line.ends_px[None]
