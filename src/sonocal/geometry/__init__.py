"""Similarities, segments and lines, and the image among them: the nouns of the package."""

from sonocal.geometry.arrays import FURTHEST, frozen, real_array
from sonocal.geometry.image import (
    area_places,
    image_crossings,
    needle_in_image,
    needle_in_volume,
    predicted_needles,
    predicted_points,
)
from sonocal.geometry.transforms import (
    Array,
    AxisScaled,
    Similarity,
    homogeneous_points,
    segment_directions,
    similarity_errors,
)
from sonocal.geometry.triangles import on_one_line

__all__ = [
    "FURTHEST",
    "Array",
    "AxisScaled",
    "Similarity",
    "area_places",
    "frozen",
    "homogeneous_points",
    "image_crossings",
    "needle_in_image",
    "needle_in_volume",
    "on_one_line",
    "predicted_needles",
    "predicted_points",
    "real_array",
    "segment_directions",
    "similarity_errors",
]
