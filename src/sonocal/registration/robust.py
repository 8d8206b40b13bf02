"""Consensus over minimal samples, then refinement on the rows that agree: one call into the core."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import NoConsensusError
from sonocal.geometry import Array, AxisScaled, Similarity, segment_directions
from sonocal.registration.rows import PointLineRows

__all__ = ["MINIMAL_ROWS", "Fit", "Model", "Weighting", "fit_point_lines"]

# Four points in 2D, two points of each of two lines in 3D: 8 equations for 7 parameters.
MINIMAL_ROWS = 4
# How many other rows' lines each point is compared with to see what agrees by chance.
CHANCE_SHIFTS = 12

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


def fit_point_lines(
    rows: PointLineRows,
    *,
    model: Model = "similarity",
    weighting: Weighting = "likelihood",
    threshold_mm: float | Literal["auto"] = 5.0,
    sigma_px: float | None = None,
    sigma_mm: float | None = None,
    confidence: float = 0.99999,
    max_samples: int = 10_000,
    exhaustive_samples: int = 2_000,
    seed: int = 0,
) -> Fit:
    """The transform that most points agree with, refined on those that do.

    Samples are four points (2D, paper section 6.2) or two lines of two points each (3D, closed form of
    section 5): all combinations where they are few, else random ones from different frames and targets.
    Candidates are scored by truncated squared distances (MSAC) and refined on the rows that agree.

    The last refinement minimises, over rotation, translation and scale,

        sum_i d(L_i, A x_i)^2                      "geometric": paper section 8
        sum_i r_i' V_i^-1 r_i                      "likelihood"

    where V_i is the covariance that pixel noise through A and both end points' noise at the point's place
    on its line give the residual, shared among points of one 3D line. Noise levels that are not given are
    estimated by restricted maximum likelihood. Sightings further off than four standard deviations count
    less (Huber).

    Args:
        rows: points and lines.
        model: one scale, or one along u and one along v (2D only).
        weighting: what to minimise.
        threshold_mm: rows within this distance agree (paper section 9: 5 mm); "auto": 3.3 standard deviations
            of the noise, itself from the median distance, while more than half of the rows are sound.
        sigma_px: noise of a point along every axis, px, where known; a factor of the rows' own column.
        sigma_mm: noise of a segment's end point along every axis, mm, where known; likewise.
        confidence: of having drawn a sample without outliers.
        max_samples: random samples at the most.
        exhaustive_samples: up to this many combinations are all tried.
        seed: of the random samples.

    Returns:
        The fit.

    Raises:
        NoConsensusError: no candidate agrees with more rows than a minimal sample fits anyway, or than chance
            gives.

    Source: paper sections 6.2, 8 and 9; MSAC: Torr and Zisserman 2000; local optimisation: Chum, Matas and
        Kittler 2003; noise levels: Gilmour, Thompson and Cullis 1995.
    """
    found = _core.estimate(
        rows.points,
        rows.segments_mm,
        rows.codes(),
        rows.frame,
        rows.target,
        rows.sigma_px,
        rows.sigma_mm,
        dimension=rows.dimension,
        model=model,
        weighting=weighting,
        threshold_mm=0.0 if threshold_mm == "auto" else threshold_mm,
        level_px=rows.level_px(sigma_px),
        level_mm=rows.level_mm(sigma_mm),
        confidence=confidence,
        max_samples=max_samples,
        exhaustive_samples=exhaustive_samples,
        seed=seed,
    )
    if not found.found or found.inliers < min(MINIMAL_ROWS + 1, len(rows)):
        raise NoConsensusError(
            f"no calibration brings more than {found.inliers} of {len(rows)} rows within "
            f"{found.threshold_mm:.3g} mm of their lines, and any {MINIMAL_ROWS} rows can be fitted; check that rows "
            "are matched to the right needle poses and that segments are in the probe marker's frame in mm",
            best_count=found.inliers,
        )
    fit = fit_of(found, model, weighting, np.sqrt(found.squares) <= found.threshold_mm)
    if 2 * found.inliers < len(rows):
        _refuse_chance(rows, fit)
    return fit


def _refuse_chance(rows: PointLineRows, fit: Fit) -> None:
    """Raise if as many rows would agree had points and lines nothing to do with each other.

    The share of rows that agree by chance is that of points with other rows' lines; the number of false
    alarms is the binomial tail over all models that minimal samples could have given.

    Source: a-contrario model estimation (Moisan and Stival 2004), with the background measured.
    """
    from scipy.special import bdtrc, gammaln

    count, agreeing = len(rows), int(fit.inlier.sum())
    shifts = np.unique(np.linspace(1, count - 1, CHANCE_SHIFTS).astype(int))
    mapped = fit.transform @ rows.points
    near = [
        np.linalg.norm(away_from_lines(mapped, np.roll(rows.segments_mm, shift, axis=0)), axis=1)
        <= fit.threshold_mm
        for shift in shifts
    ]
    chance = (np.sum(near) + 1.0) / (np.size(near) + 2.0)
    samples = gammaln(count + 1) - gammaln(count - MINIMAL_ROWS + 1) - gammaln(MINIMAL_ROWS + 1) + np.log(4)
    tail = bdtrc(agreeing - MINIMAL_ROWS - 1, count - MINIMAL_ROWS, chance)
    if tail > 0 and samples + np.log(tail) > 0:
        raise NoConsensusError(
            f"the best calibration brings {agreeing} of {count} rows within {fit.threshold_mm:.3g} mm of their lines, "
            f"no more than chance would ({100 * chance:.1f} % of points are that near to lines of other rows); check "
            "that rows are matched to the right needle poses and that segments are in the probe marker's frame in mm",
            best_count=agreeing,
        )


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
        residuals_mm=np.sqrt(found.squares),
        inlier=inlier,
        threshold_mm=found.threshold_mm,
        least_information=found.least_information,
        samples=found.samples,
        converged=found.converged,
    )
