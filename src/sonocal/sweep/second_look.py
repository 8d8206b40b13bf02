"""Fainter candidates near where the needles must be, in images whose first ones were elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sonocal.detection import Detections
from sonocal.detection.recordings import Detector
from sonocal.geometry import Array, AxisScaled, predicted_needles
from sonocal.observations import Observations
from sonocal.sweep.tabulate import tabulated
from sonocal.targets import Line

__all__ = ["SecondLook"]

LAST_RANK = 10**6
"""Behind all that the first look found: its number tells one candidate from another."""


class SecondLook:
    """Candidates for the needles that no candidate is near to.

    Args:
        detector: looks into the recording's images.
        lines: the needles and wires.
        segments_mm: (N, L, 2, 3): their ends in every item of the recording, in the probe marker's frame.
        first: what the first look found: it is not found again.
    """

    def __init__(
        self, detector: Detector, lines: Sequence[Line], segments_mm: Array, first: Detections
    ) -> None:
        self._detector, self._lines, self._all_segments = detector, lines, segments_mm
        self._known = set(_keys(first.frame.tolist(), first.points_px))
        posed = np.isfinite(segments_mm).all(axis=(2, 3)) & detector.recording.image_valid[:, None]
        frame, line = np.nonzero(posed)
        self._frame, self._segments = frame.tolist(), segments_mm[posed]
        self._target = [lines[i].name for i in line.tolist()]

    def __call__(
        self, probe_from_image: AxisScaled, near: Observations, threshold_mm: float
    ) -> Observations | None:
        """Further candidates, where `near` holds none."""
        needles = predicted_needles(probe_from_image, self._segments)
        reach_px = threshold_mm / float(probe_from_image.scales.mean())
        seen = set(zip(near.frame.tolist(), near.target.tolist(), strict=True))
        found = [
            (frame, target, rank, points)
            for frame, target, needle in zip(self._frame, self._target, needles, strict=True)
            if (frame, target) not in seen
            for rank, points in enumerate(self._unknown(frame, needle, reach_px))
        ]
        if not found:
            return None
        frames, targets, ranks, places = zip(*found, strict=True)
        further = Detections(
            np.array(frames),
            np.array(places),
            rank=LAST_RANK + np.array(ranks),
            target=np.array(targets),
            source=near.source,
        )
        recording = self._detector.recording
        return tabulated(recording, self._lines, further, self._all_segments).observations

    def _unknown(self, frame: int, needle: Array, reach_px: float) -> Iterator[Array]:
        """(P, D) px: places near a needle that the first look did not find."""
        places = self._detector.near(frame, needle, reach_px)
        keys = _keys([frame] * len(places), places)
        return (place for place, key in zip(places, keys, strict=True) if key not in self._known)


def _keys(frames: Sequence[int], points_px: Array) -> list[tuple[int, bytes]]:
    """What tells a detection from others."""
    return [(frame, points.tobytes()) for frame, points in zip(frames, points_px, strict=True)]
