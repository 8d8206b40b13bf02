"""A transform fitted to points on lines, whatever fitted it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import Array, AxisScaled, Similarity, segment_directions
from sonocal.registration.options import Model, Options, Weighting

__all__ = ["Fit", "away_from_lines", "fit_of", "transform_of"]


@dataclass(frozen=True, eq=False)
class Fit:
    """A transform and the rows that agree with it.

    Attributes:
        transform: mm from px.
        options: how it was fitted.
        covariance: (k, k), of the tangent. With the likelihood's weights it holds the noise; geometric, it is
            ``(J'J)^-1``, for residuals of 1 mm.
        sigma_px, sigma_mm: noise levels behind the likelihood's weights, given or estimated: of a point along
            each image axis, of a segment's end point along each axis. Zero when geometric.
        residuals_mm: (N,): distance of every mapped point to its line.
        inlier: (N,): whether the row was fitted.
        squares_mm2: sum of squared distances of the rows that the refinement took.
        threshold_mm: rows within this distance agree.
        least_information: least eigenvalue of J'J a row in coordinates of order one; 0: a motion is free.
        samples: how many minimal samples were tried.
        converged: whether the refinement came to rest.
        plain: whether so many rows agree that chance need not be counted; False where nobody looked.
    """

    transform: AxisScaled
    options: Options
    covariance: Array
    sigma_px: float
    sigma_mm: float
    residuals_mm: Array
    inlier: NDArray[np.bool_]
    squares_mm2: float
    threshold_mm: float
    least_information: float
    samples: int
    converged: bool
    plain: bool = False

    @property
    def model(self) -> Model:
        """One scale, one along every axis, or a known one."""
        return self.options.model

    @property
    def levelled(self) -> Options:
        """The options with the noise levels that were given or found: for another fit of the same rows."""
        return replace(self.options, sigma_px=self.sigma_px or None, sigma_mm=self.sigma_mm or None)

    @property
    def levels(self) -> tuple[float, float]:
        """Noise of a point, px, and of what spans its target, mm, that rows are weighed by; 0 where all weigh alike."""
        return (self.sigma_px, self.sigma_mm) if self.weighting == "likelihood" else (0.0, 0.0)

    @property
    def least_covariance(self) -> Array:
        """(k, k), of the tangent, if rows shared no error."""
        if self.weighting == "likelihood":
            return self.covariance
        freedom = 2 * int(self.inlier.sum()) - len(self.covariance)
        return np.asarray(self.covariance * float(np.sum(self.residuals_mm[self.inlier] ** 2)) / freedom)

    @property
    def weighting(self) -> Weighting:
        """What the refinement minimised."""
        return self.options.weighting


def away_from_lines(points_mm: Array, segments_mm: Array) -> Array:
    """(N, 3), mm: from each line to its point, at right angles to the line."""
    directions = segment_directions(segments_mm)
    away = points_mm - segments_mm[:, 0]
    return np.asarray(away - np.sum(away * directions, axis=1, keepdims=True) * directions)


def fit_of(found: _core.Estimate, options: Options, inlier: NDArray[np.bool_]) -> Fit:
    """The core's plain struct as a fit."""
    fit = object.__new__(Fit)
    # Field by field, as a frozen dataclass is filled, it takes a fiftieth of the time of a fit of fifty rows.
    fit.__dict__.update(
        transform=transform_of(found, options.model),
        options=options,
        covariance=found.covariance,
        sigma_px=found.level_px,
        sigma_mm=found.level_mm,
        residuals_mm=found.residuals_mm,
        inlier=inlier,
        squares_mm2=found.squared_sum,
        threshold_mm=found.threshold,
        least_information=found.least_information,
        samples=found.samples,
        converged=found.converged,
        plain=found.plain,
    )
    return fit


def transform_of(found: _core.Estimate, model: Model = "similarity") -> AxisScaled:
    """The core's transform.

    Raises:
        InputError: its numbers are none of a transform.
    """
    kind = AxisScaled if model == "anisotropic" else Similarity
    if found.sound:
        return kind.unchecked(found.rotation, found.translation, found.scales)
    scale = found.scales if model == "anisotropic" else found.scales[0]
    return kind(found.rotation, found.translation, scale)
