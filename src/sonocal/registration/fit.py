"""A transform fitted to points on lines, whatever fitted it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import Array, AxisScaled, Similarity, segment_directions

__all__ = ["Fit", "Model", "Weighting", "away_from_lines", "fit_of"]

Model = Literal["similarity", "anisotropic"]
Weighting = Literal["likelihood", "geometric"]


@dataclass(frozen=True, eq=False)
class Fit:
    """A transform and the rows that agree with it.

    Attributes:
        transform: mm from px.
        model: one scale, or one along u and one along v.
        weighting: what the refinement minimised.
        covariance: (k, k), of the tangent. With the likelihood's weights it holds the noise; geometric, it is
            ``(J'J)^-1``, for residuals of 1 mm.
        sigma_px, sigma_mm: noise levels behind the likelihood's weights, given or estimated: of a point along
            each image axis, of a segment's end point along each axis. Zero when geometric.
        residuals_mm: (N,): distance of every mapped point to its line.
        inlier: (N,): whether the row was fitted.
        threshold_mm: rows within this distance agree.
        least_information: least eigenvalue of J'J a row in coordinates of order one; 0: a motion is free.
        samples: how many minimal samples were tried.
        converged: whether the refinement came to rest.
    """

    transform: AxisScaled
    model: Model
    weighting: Weighting
    covariance: Array
    sigma_px: float
    sigma_mm: float
    residuals_mm: Array
    inlier: NDArray[np.bool_]
    threshold_mm: float
    least_information: float
    samples: int
    converged: bool


def away_from_lines(points_mm: Array, segments_mm: Array) -> Array:
    """(N, 3), mm: from each line to its point, at right angles to the line."""
    directions = segment_directions(segments_mm)
    away = points_mm - segments_mm[:, 0]
    return np.asarray(away - np.sum(away * directions, axis=1, keepdims=True) * directions)


def fit_of(found: _core.Estimate, model: Model, weighting: Weighting, inlier: NDArray[np.bool_]) -> Fit:
    """The core's plain struct as a fit."""
    if model == "similarity":
        transform: AxisScaled = Similarity(found.rotation, found.translation, found.scales[0])
    else:
        transform = AxisScaled(found.rotation, found.translation, found.scales)
    return Fit(
        transform=transform,
        model=model,
        weighting=weighting,
        covariance=found.covariance,
        sigma_px=found.level_px,
        sigma_mm=found.level_mm,
        residuals_mm=found.residuals_mm,
        inlier=inlier,
        threshold_mm=found.threshold_mm,
        least_information=found.least_information,
        samples=found.samples,
        converged=found.converged,
    )
