"""The needle in images: candidate points in 2D, lines in 3D."""

from sonocal.detection.grey import as_grey
from sonocal.detection.masks import find_mask
from sonocal.detection.points import Candidates, PointDetector, detect_points

__all__ = ["Candidates", "PointDetector", "as_grey", "detect_points", "find_mask"]
