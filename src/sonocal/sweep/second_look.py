"""Fainter candidates near where the needles must be, in images whose first ones were elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sonocal.detection import PointDetector, detect_line_near
from sonocal.detection.points import LEAST_SCORE, Centre
from sonocal.geometry import (
    Array,
    AxisScaled,
    image_crossings,
    predicted_needles,
)
from sonocal.observations import Observations
from sonocal.recording import Recording

__all__ = ["SecondLook", "lines_near", "points_near"]

FAINT_SHARE = 0.5
"""Of the detection's least score: near where the needle must be, a fainter place will do."""
MANY = 25
LAST_RANK = 10**6

Find = Callable[[int, Array, float], Array]
"""The image's index, the needle (2, 3) px in it and a distance in px to candidates (K, points, dimension) px."""


class SecondLook:
    """Candidates for the needles that no candidate is near to.

    Args:
        expected: one row an image and needle that can be seen in it; where its point is does not matter.
        find: looks for a needle.
    """

    def __init__(self, expected: Observations, find: Find) -> None:
        self._expected, self._find = expected, find

    def __call__(
        self, probe_from_image: AxisScaled, near: Observations, threshold_mm: float
    ) -> list[Observations]:
        """Further candidates, where `near` holds none."""
        expected = self._expected
        needles = predicted_needles(probe_from_image, expected.segments_mm)
        reach_px = threshold_mm / float(probe_from_image.scales.mean())
        seen = set(zip(near.frame.tolist(), near.target.tolist(), strict=True))
        further = []
        for row, sighting in enumerate(zip(expected.frame.tolist(), expected.target.tolist(), strict=True)):
            if sighting not in seen:
                found = self._find(sighting[0], needles[row], reach_px)
                further += [self._rows(row, points, rank) for rank, points in enumerate(found)]
        return further

    def _rows(self, row: int, points: Array, rank: int) -> Observations:
        """A candidate: one row in an image, in a volume a row an end, whose `split` tells it from others."""
        like = self._expected.select(np.full(len(points), row))
        split = like.split if len(points) == 1 else np.full(len(points), str(LAST_RANK + rank))
        return replace(like, points_px=points, split=split)


def points_near(recording: Recording, mask: NDArray[np.bool_], centre: Centre) -> Find:
    """Looks in 2D images."""
    detector = PointDetector(mask, MANY, centre=centre, least_score=FAINT_SHARE * LEAST_SCORE)
    last: dict[int, Array] = {}

    def find(frame: int, needle: Array, reach_px: float) -> Array:
        place = image_crossings(needle[None])[0]
        if not (np.isfinite(place).all() and (place >= 0).all() and (place < mask.shape[::-1]).all()):
            return np.empty((0, 1, 2))
        if frame not in last:  # an image's wires follow one another
            last.clear()
            last[frame] = detector.detect(recording.frames[frame])[0]
        points = last[frame]
        return points[np.linalg.norm(points - place, axis=1) <= reach_px, None]

    return find


def lines_near(recording: Recording) -> Find:
    """Looks in volumes."""

    def find(frame: int, needle: Array, reach_px: float) -> Array:
        line = detect_line_near(recording.frames[frame], needle, name=f"{recording.name}, frame {frame}")
        return np.empty((0, 2, 3)) if line is None else line.ends_px[None]

    return find
