"""Points on whatever targets, fitted: the estimate of any mix in the form that fits of points on lines have."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import AxisScaled
from sonocal.registration.fit import Fit, transform_of
from sonocal.registration.mapped import MappedTargets
from sonocal.registration.options import Options, unknowns
from sonocal.registration.register import Registration, register
from sonocal.registration.rows import to_core
from sonocal.registration.target_rows import TargetRows

__all__ = ["fit_targets", "refine_targets"]

# Which rows agree changes little after the first.
ROUNDS = 3


def fit_targets(rows: TargetRows, options: Options) -> Fit:
    """The transform that most of the rows agree with, refined on those that do.

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
        scale=options.scale_mm_per_px,
    )
    fit = _of_one_scale(found, rows, options)
    return _of_several(fit, rows, options) if options.model == "anisotropic" else fit


def _of_one_scale(found: Registration, rows: TargetRows, options: Options) -> Fit:
    k = unknowns(options.model if options.model == "rigid" else "similarity", rows.dimension)
    away = MappedTargets(found.target_from_source, rows).distances
    inlier = found.inlier[rows.sightings]
    weighted = found.sigma_px is not None
    return Fit(
        transform=found.target_from_source,
        options=options if weighted else replace(options, weighting="geometric"),
        covariance=np.full((k, k), np.nan) if found.covariance is None else found.covariance[:k, :k],
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


def _of_several(fit: Fit, rows: TargetRows, options: Options) -> Fit:
    """A scale along every axis, from the answer of one scale, on the rows that agree with it."""
    found, chosen = fit, fit.inlier
    for _ in range(ROUNDS):
        found = refine_targets(found.transform, rows, chosen, replace(options, weighting=fit.weighting))
        agreeing = rows.within(found.residuals_mm, fit.threshold_mm)
        if np.array_equal(agreeing, chosen) or not agreeing.any():
            break
        chosen = agreeing
    return replace(found, threshold_mm=fit.threshold_mm, samples=fit.samples)


def refine_targets(start: AxisScaled, rows: TargetRows, chosen: NDArray[np.bool_], options: Options) -> Fit:
    """The best transform near a start on chosen rows (N,), all of a sighting alike; as it was, if it runs away."""
    some = rows.select(chosen)
    unlimited = Options(model=options.model, threshold_mm=np.inf, scale_mm_per_px=options.scale_mm_per_px)
    levels = rows.level_px(options.sigma_px), rows.level_mm(options.sigma_mm)
    found = _core.maximise(some.core, to_core(start), unlimited.to_core(*levels))
    there, k = found.found and found.sound, unknowns(options.model, rows.dimension)
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
