"""Consensus over minimal samples, then refinement on the rows that agree: one call into the core."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import NoConsensusError
from sonocal.geometry import Array, AxisScaled, Similarity

__all__ = ["MINIMAL_ROWS", "Fit", "Model", "fit_point_lines"]

# Four points in 2D, two points of each of two lines in 3D: 8 equations for 7 parameters.
MINIMAL_ROWS = 4

Model = Literal["similarity", "anisotropic"]


@dataclass(frozen=True, eq=False)
class Fit:
    """A transform and the rows that agree with it.

    Attributes:
        transform: mm from px.
        unit_covariance: (k, k): ``(J'J)^-1`` over the agreeing rows, so that independent residuals of
            standard deviation ``sigma`` mm give the tangent the covariance ``sigma^2 unit_covariance``.
        residuals_mm: (N,): distance of every mapped point to its line.
        inlier: (N,): whether the row is within the threshold.
        least_information: least eigenvalue of J'J a row in coordinates of order one; 0: a motion is free.
        samples: how many minimal samples were tried.
        converged: whether the refinement came to rest.
    """

    transform: AxisScaled
    unit_covariance: Array
    residuals_mm: Array
    inlier: NDArray[np.bool_]
    least_information: float
    samples: int
    converged: bool


def fit_point_lines(
    points: Array,
    segments_mm: Array,
    sightings: NDArray[np.int64],
    *,
    dimension: int,
    model: Model = "similarity",
    threshold_mm: float = 5.0,
    confidence: float = 0.99999,
    max_samples: int = 10_000,
    exhaustive_samples: int = 2_000,
    seed: int = 0,
) -> Fit:
    """The transform that most points agree with, refined on those that do.

        min over R, t, s of sum_i d(L_i, A x_i)^2        over the rows with d <= threshold

    Samples are four points (2D, paper section 6.2) or two lines of two points each (3D, closed form of
    section 5): all combinations where they are few, else random ones. The refinement is
    Levenberg-Marquardt over rotation, translation and scale (section 8).

    Args:
        points: (N, 3), px; ``w = 0`` throughout for a 2D probe.
        segments_mm: (N, 2, 3): two points of each line.
        sightings: (N,): rows of one sighting lie on one image line; counted from 0. Of no effect in 2D.
        dimension: 2 or 3, the probe's.
        model: one scale, or one along u and one along v (2D only).
        threshold_mm: rows within this distance agree (paper section 9: 5 mm).
        confidence: of having drawn a sample without outliers.
        max_samples: random samples at the most.
        exhaustive_samples: up to this many combinations are all tried.
        seed: of the random samples.

    Returns:
        The fit.

    Raises:
        NoConsensusError: no candidate agrees with more rows than a minimal sample fits anyway.

    Source: paper sections 6.2, 8 and 9.
    """
    found = _core.estimate_calibration(
        np.ascontiguousarray(points),
        np.ascontiguousarray(segments_mm),
        np.ascontiguousarray(sightings, dtype=np.int32),
        dimension=dimension,
        model=model,
        threshold_mm=threshold_mm,
        confidence=confidence,
        max_samples=max_samples,
        exhaustive_samples=exhaustive_samples,
        seed=seed,
    )
    if not found.found or found.inliers < min(MINIMAL_ROWS + 1, len(points)):
        raise NoConsensusError(
            f"no calibration brings more than {found.best_count} of {len(points)} rows within "
            f"{threshold_mm:g} mm of their lines, and any {MINIMAL_ROWS} rows can be fitted; check that rows are "
            "matched to the right needle poses and that segments are in the probe marker's frame in mm",
            best_count=found.best_count,
        )
    return fit_of(found, model, np.sqrt(found.squares) <= threshold_mm)


def fit_of(found: _core.Estimate, model: Model, inlier: NDArray[np.bool_]) -> Fit:
    """The core's plain struct as a fit."""
    if model == "similarity":
        transform: AxisScaled = Similarity(found.rotation, found.translation, found.scales[0])
    else:
        transform = AxisScaled(found.rotation, found.translation, found.scales)
    return Fit(
        transform=transform,
        unit_covariance=found.unit_covariance,
        residuals_mm=np.sqrt(found.squares),
        inlier=inlier,
        least_information=found.least_information,
        samples=found.samples,
        converged=found.converged,
    )
