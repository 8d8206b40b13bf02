"""A line through the bright spots of sections across it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = ["bright_sections", "fit_line"]

STEP_PX = 0.5
CUT = 0.85
CORRELATION_PX = 3.0
"""Sections closer than the point spread see the same speckle: they are not independent."""


def bright_sections(grey: NDArray[np.float32], ends: Array, reach: float) -> tuple[Array, Array]:
    """Centre and contrast of the bright spot in sections one voxel apart across a line."""
    from scipy.ndimage import map_coordinates

    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    along /= length
    side = np.cross(along, [0.0, 1.0, 0.0] if abs(along[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(along, side)
    steps = np.arange(-reach, reach + STEP_PX, STEP_PX)
    a, b = (grid.reshape(-1) for grid in np.meshgrid(steps, steps))
    inside = np.hypot(a, b) <= reach
    patch = a[inside, None] * side + b[inside, None] * other
    starts = ends[0] + np.arange(0, length + 0.5)[:, None] * along
    places = starts[:, None] + patch
    values = map_coordinates(grey, places.reshape(-1, 3).T[::-1], order=1, mode="constant").reshape(
        places.shape[:2]
    )
    background = np.median(values, axis=1, keepdims=True)
    top = values.max(axis=1, keepdims=True)
    # Only what is nearly as bright as the first echo counts: its reverberations lie right behind it.
    weight = np.maximum(values - background - CUT * (top - background), 0)
    total = weight.sum(axis=1)
    contrast = (top - background)[:, 0]
    keep = (total > 0) & (contrast > 0.3 * np.median(contrast))
    centres = starts[keep] + (weight[keep] @ patch) / total[keep, None]
    return centres, contrast[keep]


def fit_line(
    points: Array, weights: Array, floor_px2: float, independent: int | None = None
) -> tuple[Array, Array]:
    """A line by iteratively reweighted total least squares (Huber).

    Args:
        points: (N, 3).
        weights: (N,).
        floor_px2: what of an end's variance does not show in how the points scatter.
        independent: how many of the points are; default: as many as the point spread fits into the line.

    Returns:
        Its ends (2, 3) px and their covariance (2, 3, 3) px^2, across the line.
    """
    weight = weights / weights.mean()
    for _ in range(10):
        middle = np.average(points, axis=0, weights=weight)
        offset = points - middle
        along = np.linalg.eigh((weight * offset.T) @ offset)[1][:, -1]
        t = offset @ along
        distance = np.linalg.norm(offset - t[:, None] * along, axis=1)
        sigma = max(1e-3, float(np.median(distance)) / 1.1774)
        weight = weights / weights.mean() * np.minimum(1.0, 2 * sigma / np.maximum(distance, 1e-9)) ** 2
    held = distance <= 5 * sigma
    ends_t = np.array([t[held].min(), t[held].max()])
    count = independent or max(2.0, (ends_t[1] - ends_t[0]) / CORRELATION_PX)
    share = 1 / count + (ends_t - t[held].mean()) ** 2 / (count * max(t[held].var(), 1e-9))
    across = np.eye(3) - np.outer(along, along)
    covariance = (sigma**2 * share + floor_px2)[:, None, None] * across
    return middle + ends_t[:, None] * along, covariance
