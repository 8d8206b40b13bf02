"""From a table of sightings to a calibration that says how far to trust it: the main path."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.diagnostics import (
    anisotropy_findings,
    diagnose_fit,
    diagnose_noise,
    diagnose_rival,
    image_plane_findings,
    weakness_findings,
)
from sonocal.calibration.options import check_options
from sonocal.calibration.result import Calibration
from sonocal.calibration.rows import check_rows, point_line_rows, split_rows
from sonocal.calibration.statistics import ErrorStatistics
from sonocal.errors import InputError
from sonocal.geometry import Array, area_places, homogeneous_points
from sonocal.observations import Observations, group_codes
from sonocal.registration.ambiguity import better_of_mirrored, rival_of
from sonocal.registration.degeneracy import (
    SUSPICIOUS_INFORMATION,
    refuse_degenerate_lines,
    refuse_free_motion,
)
from sonocal.registration.fit import Fit, Model, Weighting
from sonocal.registration.noise import estimate_noise, residual_vectors, stretch_length
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import PointLineRows

__all__ = ["calibrate"]


def calibrate(
    observations: Observations,
    *,
    model: Model = "similarity",
    weighting: Weighting = "likelihood",
    threshold_mm: float | Literal["auto"] = 5.0,
    sigma_px: float | None = None,
    sigma_mm: float | None = None,
    fit_split: str | None = None,
    test_split: str | None = None,
    image_size_px: tuple[int, ...] | None = None,
    tolerance_mm: float = 2.0,
    max_samples: int = 10_000,
    seed: int = 0,
) -> Calibration:
    """Calibrate a probe from sightings of a needle or of wires.

    Args:
        observations: one point of the image against one line in the probe marker's frame a row.
        model: "similarity", or "anisotropic" for a 2D probe whose pixels are not square in mm.
        weighting: "likelihood" weighs every residual by the noise that it carries; "geometric" takes all
            distances alike, as the paper does (section 8).
        threshold_mm: rows further than this from their line are outliers (paper section 9); "auto": 3.3
            standard deviations of the noise, found while more than half of the rows are sound.
        sigma_px: noise of an image point along every axis, px, where known; it multiplies the table's own
            column. Default: estimated from the residuals.
        sigma_mm: noise of a segment's end point along every axis, mm; likewise.
        fit_split: fit the rows of this split only; default: all but those of `test_split`.
        test_split: report the error of this split's rows, which are not fitted.
        image_size_px: (width, height[, depth]); predicted errors are quoted at this image's corners.
            Default: the corners of the box that holds the points seen.
        tolerance_mm: the predicted error (95 %) at a corner above which the answer comes with a warning.
        max_samples: random minimal samples at the most.
        seed: of the random samples; the same seed gives the same answer.

    Returns:
        The calibration.

    Raises:
        InputError: an option or a split is wrong, or rows are too few.
        DegenerateGeometryError: the sightings leave a motion free.
        NoConsensusError: no calibration agrees with enough rows.
        UnsupportedError: the anisotropic model of a 3D probe.

    Source: paper sections 5 to 9.
    """
    check_options(
        model=model,
        weighting=weighting,
        threshold_mm=threshold_mm,
        tolerance_mm=tolerance_mm,
        max_samples=max_samples,
        sigma_px=sigma_px,
        sigma_mm=sigma_mm,
    )
    rows, held_out = split_rows(observations, fit_split, test_split)
    check_rows(rows, model)
    area = _area(rows, image_size_px)
    table = point_line_rows(rows)

    # A sighting geometry that leaves a motion free has no answer: refuse before fitting, and again once
    # the outliers, which can hide it, are known.
    refuse_degenerate_lines(table.points, table.segments_mm, table.dimension)
    fit = fit_point_lines(
        table,
        model=model,
        weighting=weighting,
        threshold_mm=threshold_mm,
        sigma_px=sigma_px,
        sigma_mm=sigma_mm,
        max_samples=max_samples,
        seed=seed,
    )
    fit, mirrored = better_of_mirrored(table, fit, sigma_px=sigma_px, sigma_mm=sigma_mm)
    if fit.least_information < SUSPICIOUS_INFORMATION:
        refuse_degenerate_lines(table.points[fit.inlier], table.segments_mm[fit.inlier], table.dimension)
    refuse_free_motion(fit.least_information)

    known = {
        "known_px": bool(sigma_px) or rows.sigma_px is not None,
        "known_mm": bool(sigma_mm) or rows.sigma_mm is not None,
    }
    groupings, stretch = _groupings(table, rows.split, fit)
    noise = estimate_noise(table, fit, groupings, **known)
    rival = None if mirrored is None else rival_of(fit, mirrored, noise.covariance, area_places(area))
    if rival is not None:
        noise = replace(noise, covariance=noise.covariance + rival.covariance)
    diagnostics = [
        *diagnose_fit(fit),
        *diagnose_rival(rival),
        *weakness_findings(table, fit, noise, area, tolerance_mm),
        *image_plane_findings(table, fit),
        *diagnose_noise(noise, stretch),
        *anisotropy_findings(table, fit, groupings),
    ]
    diagnostics.sort(key=lambda finding: finding.severity != "warning")
    return Calibration(
        probe_from_image=fit.transform,
        model=model,
        covariance=noise.covariance if np.all(np.isfinite(noise.covariance)) else None,
        noise=noise,
        area_px=area,
        fit=ErrorStatistics.of(fit.residuals_mm[fit.inlier], len(rows), int(fit.inlier.sum())),
        test=None if held_out is None else _test(held_out, fit),
        residuals_mm=fit.residuals_mm,
        inlier=fit.inlier,
        diagnostics=tuple(diagnostics),
        provenance={
            "input": rows.source,
            "sha256": rows.sha256,
            "options": {
                "model": model,
                "weighting": weighting,
                "threshold_mm": threshold_mm,
                "sigma_px": sigma_px,
                "sigma_mm": sigma_mm,
                "fit_split": fit_split,
                "test_split": test_split,
                "image_size_px": list(image_size_px) if image_size_px else None,
                "tolerance_mm": tolerance_mm,
                "max_samples": max_samples,
                "seed": seed,
            },
        },
    )


def _groupings(
    table: PointLineRows, split: NDArray[np.str_], fit: Fit
) -> tuple[dict[str, NDArray[Any]], int]:
    """What rows may share an error by: frame, needle or wire, stretch of frames; and a stretch's length."""
    assert table.frame is not None
    assert table.target is not None
    residuals = residual_vectors(fit.transform, table.points[fit.inlier], table.segments_mm[fit.inlier])
    stretch = stretch_length(residuals, group_codes(table.frame[fit.inlier]))
    groupings: dict[str, NDArray[Any]] = {"frame": table.frame, "target": table.target}
    if stretch > 1:
        groupings["stretch"] = group_codes(split, table.frame // stretch)
    return groupings, stretch


def _test(held_out: Observations, fit: Fit) -> ErrorStatistics:
    vectors = residual_vectors(fit.transform, homogeneous_points(held_out.points_px), held_out.segments_mm)
    distances = np.linalg.norm(vectors, axis=1)
    return ErrorStatistics.of(distances, len(held_out), int(np.sum(distances <= fit.threshold_mm)))


def _area(rows: Observations, image_size_px: tuple[int, ...] | None) -> Array:
    if image_size_px is None:
        return np.array([rows.points_px.min(axis=0), rows.points_px.max(axis=0)])
    size = np.asarray(image_size_px, dtype=float)
    if size.shape != (rows.dimension,) or not np.all(size >= 1):
        raise InputError(
            f"image_size_px must be {rows.dimension} positive numbers for a {rows.dimension}D probe; "
            f"got {image_size_px}"
        )
    return np.array([np.zeros(rows.dimension), size - 1])
