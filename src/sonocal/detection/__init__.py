"""The needle in images: candidate points in 2D, lines in 3D."""

from sonocal.detection.grey import as_grey
from sonocal.detection.lines import (
    LineCandidate,
    LineCandidates,
    detect_line_near,
    detect_lines,
    detect_volumes,
    line_through_slices,
)
from sonocal.detection.masks import find_mask, read_mask
from sonocal.detection.points import Candidates, PointDetector, detect_points
from sonocal.detection.slices import VolumeSlice, slice_volume

__all__ = [
    "Candidates",
    "LineCandidate",
    "LineCandidates",
    "PointDetector",
    "VolumeSlice",
    "as_grey",
    "detect_line_near",
    "detect_lines",
    "detect_points",
    "detect_volumes",
    "find_mask",
    "line_through_slices",
    "read_mask",
    "slice_volume",
]
