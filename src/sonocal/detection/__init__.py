"""Needles and walls in images: points and lines in 2D, lines and planes in 3D; of an image, and of a recording."""

from sonocal.detection.detections import Detections
from sonocal.detection.grey import as_grey
from sonocal.detection.lines import (
    LineCandidate,
    detect_line_near,
    detect_lines,
    line_through_slices,
)
from sonocal.detection.masks import find_mask, read_mask
from sonocal.detection.options import DetectionOptions
from sonocal.detection.points import PointDetector
from sonocal.detection.points_file import read_detections
from sonocal.detection.recordings import detect
from sonocal.detection.slices import VolumeSlice, slice_volume
from sonocal.detection.walls import WallCandidate, WallDetector

__all__ = [
    "DetectionOptions",
    "Detections",
    "LineCandidate",
    "PointDetector",
    "VolumeSlice",
    "WallCandidate",
    "WallDetector",
    "as_grey",
    "detect",
    "detect_line_near",
    "detect_lines",
    "find_mask",
    "line_through_slices",
    "read_detections",
    "read_mask",
    "slice_volume",
]
