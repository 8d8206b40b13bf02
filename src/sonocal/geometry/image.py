"""An image's corners, and where needles cross it."""

from __future__ import annotations

import numpy as np

from sonocal.geometry.transforms import (
    Array,
    AxisScaled,
    segment_directions,
)

__all__ = [
    "area_places",
    "image_crossings",
    "needle_in_image",
    "needle_in_volume",
    "predicted_needles",
    "predicted_points",
]


# Of the way from an area's least to its greatest corner, (M, d): the corners, then the centre.
CORNERS_AND_CENTRE = {
    d: np.vstack([np.indices((2,) * d).reshape(d, -1).T, np.full((1, d), 0.5)]) for d in (2, 3)
}


def area_places(area_px: Array) -> Array:
    """Corners and centre (M, d) of an area given by its least and its greatest corner (2, d)."""
    shares = CORNERS_AND_CENTRE[area_px.shape[1]]
    return np.asarray((1.0 - shares) * area_px[0] + shares * area_px[1])


def predicted_needles(probe_from_image: AxisScaled, segments_mm: Array) -> Array:
    """(N, 2, 3) px: needles (N, 2, 3), mm in the probe's frame, in an image's axes."""
    matrix = probe_from_image.matrix
    ends = segments_mm - matrix[:3, 3]
    return np.asarray(np.linalg.solve(matrix[:3, :3], ends.reshape(-1, 3).T).T.reshape(-1, 2, 3))


def predicted_points(probe_from_image: AxisScaled, segments_mm: Array) -> Array:
    """(N, 2) px: where needles (N, 2, 3), mm in the probe's frame, cross a 2D image; NaN where they do not."""
    return image_crossings(predicted_needles(probe_from_image, segments_mm))


def image_crossings(needles_px: Array) -> Array:
    """(N, 2) px: where needles (N, 2, 3), px of a 2D image, cross it; NaN where they do not."""
    start, along = needles_px[:, 0], needles_px[:, 1] - needles_px[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = -start[:, 2] / along[:, 2]
        crossing = start + share[:, None] * along
    return np.asarray(np.where(np.isfinite(crossing).all(axis=1, keepdims=True), crossing, np.nan)[:, :2])


def needle_in_image(transform: AxisScaled, segments_mm: Array) -> Array:
    """Where lines (M, 2, 3) meet the image plane of a 2D probe, (M, 2) px; NaN for lines parallel to it."""
    directions = segment_directions(segments_mm)
    normal = transform.rotation[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (transform.translation - segments_mm[:, 0]) @ normal / (directions @ normal)
        met = segments_mm[:, 0] + share[:, None] * directions
        local = (met - transform.translation) @ transform.rotation / transform.scales
    return np.asarray(np.where(np.isfinite(local), local, np.nan)[:, :2])


def needle_in_volume(transform: AxisScaled, area_px: Array, segments_mm: Array) -> Array:
    """The part (M, 2, 3), px, of segments (M, 2, 3) inside the area (2, 3) of a volume; NaN for those outside it.

    Source: Liang and Barsky 1984.
    """
    start, end = np.moveaxis(
        (segments_mm - transform.translation) @ transform.rotation / transform.scales, 1, 0
    )
    along = end - start
    with np.errstate(divide="ignore", invalid="ignore"):
        shares = (area_px[:, None] - start) / along  # (2, M, 3), of each face
    enter = np.maximum(np.nanmax(shares.min(axis=0), axis=1), 0.0)
    leave = np.minimum(np.nanmin(shares.max(axis=0), axis=1), 1.0)
    within = np.where(enter < leave, [enter, leave], np.nan).T[..., None]
    return np.asarray(start[:, None] + within * along[:, None])
