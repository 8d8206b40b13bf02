"""Consensus over minimal samples, then refinement on the rows that agree: one call into the core."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sonocal import _core
from sonocal.errors import NoConsensusError
from sonocal.geometry import Similarity
from sonocal.registration.constraints import planes_of_lines
from sonocal.registration.fit import Fit, away_from_lines, fit_of
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.rows import PointLineRows

__all__ = ["MINIMAL_ROWS", "fit_point_lines"]

# Four points in 2D, two points of each of two lines in 3D: 8 equations for 7 parameters.
MINIMAL_ROWS = 4
# Lines in one plane that determine the calibration of a 3D probe: any two of them meet.
COPLANAR_LINES = 3
# Information of an answer that has shrunk the image to a point, as pairs of meeting lines can.
COLLAPSED = 1e-12
# How many other rows' lines how many points are compared with to see what agrees by chance.
CHANCE_SHIFTS = 12
CHANCE_ROWS = 5000


def fit_point_lines(rows: PointLineRows, options: Options) -> Fit:
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
        options: how to fit; rows within `Options.threshold_mm` agree (paper section 9: 5 mm); "auto": 3.3
            standard deviations of the noise, itself from the median distance, while more than half of the rows are
            sound.

    Returns:
        The fit.

    Raises:
        NoConsensusError: no candidate agrees with more rows than a minimal sample fits anyway, or than chance
            gives.

    Source: paper sections 6.2, 8 and 9; MSAC: Torr and Zisserman 2000; local optimisation: Chum, Matas and
        Kittler 2003; noise levels: Gilmour, Thompson and Cullis 1995.
    """
    found = _core.estimate(rows.core, rows.core_options(options))
    missed = not found.found or found.inliers < min(MINIMAL_ROWS + 1, len(rows))
    meeting = rows.dimension == 3 and (missed or not found.least_information > COLLAPSED)
    if meeting and options.threshold_mm != "auto" and (coplanar := _fit_coplanar(rows, options)) is not None:
        return coplanar
    if missed:
        raise NoConsensusError(
            f"no calibration brings more than {found.inliers} of {len(rows)} rows within "
            f"{found.threshold:.3g} mm of their lines, and any {MINIMAL_ROWS} rows can be fitted; check that rows "
            "are matched to the right needle poses and that segments are in the probe marker's frame in mm",
            best_count=found.inliers,
        )
    fit = fit_of(found, options, found.residuals_mm <= found.threshold)
    if 2 * found.inliers < len(rows) and not fit.plain:
        _refuse_chance(rows, fit)
    return fit


def _fit_coplanar(rows: PointLineRows, options: Options) -> Fit | None:
    """The fit of a 3D probe's lines of which any two meet: samples of point-plane rows determine it still."""
    assert rows.sightings is not None
    assert options.threshold_mm != "auto"
    order = np.argsort(rows.sightings, kind="stable")
    first = np.concatenate([[0], 2 * np.cumsum(np.bincount(rows.sightings))]).astype(np.int32)
    planes = planes_of_lines(rows.segments_mm[order]).reshape(-1, 4)
    found = _core.estimate_correspondences(
        _core.Table.of_planes(np.repeat(rows.points[order], 2, axis=0), planes, first),
        rows.core_options(options),
    )
    shrunk = not (np.all(np.isfinite(found.translation)) and found.scales[0] > 0)
    if not found.found or found.inliers < COPLANAR_LINES or shrunk:
        return None
    start = Similarity(found.rotation, found.translation, found.scales[0])
    away = np.linalg.norm(away_from_lines(start @ rows.points, rows.segments_mm), axis=1)
    if not np.any(away <= options.threshold_mm):
        return None
    fit = refine_point_lines(start, rows, away <= options.threshold_mm, options)
    return replace(
        fit,
        threshold_mm=options.threshold_mm,
        samples=found.samples,
        inlier=fit.residuals_mm <= options.threshold_mm,
    )


def _refuse_chance(rows: PointLineRows, fit: Fit) -> None:
    """Raise if as many rows would agree had points and lines nothing to do with each other.

    The share of rows that agree by chance is that of points with other rows' lines; the number of false
    alarms is the binomial tail over all models that minimal samples could have given.

    Source: a-contrario model estimation (Moisan and Stival 2004), with the background measured.
    """
    from scipy.special import bdtrc, gammaln

    count, agreeing = len(rows), int(fit.inlier.sum())
    shifts = np.unique(np.linspace(1, count - 1, CHANCE_SHIFTS).astype(int))
    sampled = np.arange(0, count, 1 + count // CHANCE_ROWS)
    others = ((sampled + shifts[:, None]) % count).ravel()
    mapped = np.tile(fit.transform @ rows.points[sampled], (len(shifts), 1))
    distance = np.linalg.norm(away_from_lines(mapped, rows.segments_mm[others]), axis=1)
    near = np.count_nonzero(distance <= fit.threshold_mm)
    chance = (near + 1.0) / (len(distance) + 2.0)
    samples = gammaln(count + 1) - gammaln(count - MINIMAL_ROWS + 1) - gammaln(MINIMAL_ROWS + 1) + np.log(4)
    tail = bdtrc(agreeing - MINIMAL_ROWS - 1, count - MINIMAL_ROWS, chance)
    if tail > 0 and samples + np.log(tail) > 0:
        raise NoConsensusError(
            f"the best calibration brings {agreeing} of {count} rows within {fit.threshold_mm:.3g} mm of their lines, "
            f"no more than chance would ({100 * chance:.1f} % of points are that near to lines of other rows); check "
            "that rows are matched to the right needle poses and that segments are in the probe marker's frame in mm",
            best_count=agreeing,
        )
