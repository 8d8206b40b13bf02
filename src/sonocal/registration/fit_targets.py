"""Points on whatever targets, fitted: the estimate of any mix in the form that fits of points on lines have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import AxisScaled
from sonocal.registration.fit import Fit, transform_of
from sonocal.registration.mapped import MappedTargets
from sonocal.registration.options import Options
from sonocal.registration.register import register
from sonocal.registration.rows import to_core
from sonocal.registration.target_rows import TargetRows

__all__ = ["fit_targets", "refine_targets"]

PARAMETERS = 7


def fit_targets(rows: TargetRows, options: Options) -> Fit:
    """The similarity that most of the rows agree with, refined on those that do.

    Args:
        rows: points and their targets.
        options: how to fit.

    Raises:
        InputError, DegenerateGeometryError, NoConsensusError: as `register`.
    """
    found = register(
        rows.constraints,
        weighting=options.weighting,
        threshold_mm=options.threshold_mm,
        sigma_px=rows.level_px(options.sigma_px) or None,
        sigma_mm=rows.level_mm(options.sigma_mm) or None,
        confidence=options.confidence,
        max_samples=options.max_samples,
        seed=options.seed,
    )
    away = MappedTargets(found.target_from_source, rows).distances
    inlier = found.inlier[rows.sightings]
    weighted = found.sigma_px is not None
    return Fit(
        transform=found.target_from_source,
        options=options if weighted else replace(options, weighting="geometric"),
        covariance=np.full((PARAMETERS, PARAMETERS), np.nan)
        if found.covariance is None
        else found.covariance,
        sigma_px=found.sigma_px or 0.0,
        sigma_mm=found.sigma_mm or 0.0,
        residuals_mm=away,
        inlier=inlier,
        squares_mm2=float(away[inlier] @ away[inlier]),
        threshold_mm=found.threshold_mm,
        least_information=1.0,  # what leaves a motion free was refused
        samples=found.samples,
        converged=found.converged,
    )


def refine_targets(start: AxisScaled, rows: TargetRows, chosen: NDArray[np.bool_], options: Options) -> Fit:
    """The best transform near a start on chosen rows (N,), all of a sighting alike; as it was, if it runs away."""
    some, unlimited = rows.select(chosen), Options(model=options.model, threshold_mm=np.inf)
    levels = rows.level_px(options.sigma_px), rows.level_mm(options.sigma_mm)
    found = _core.maximise(some.core, to_core(start), unlimited.to_core(*levels))
    there, k = found.found and found.sound, PARAMETERS + (options.model == "anisotropic")
    transform = transform_of(found, options.model) if there else start
    away = MappedTargets(transform, rows).distances
    return Fit(
        transform=transform,
        options=options,
        covariance=found.covariance if there else np.full((k, k), np.nan),
        sigma_px=found.level_px,
        sigma_mm=found.level_mm,
        residuals_mm=away,
        inlier=chosen,
        squares_mm2=float(away[chosen] @ away[chosen]),
        threshold_mm=np.inf,
        least_information=1.0,
        samples=0,
        converged=there and found.converged,
    )
