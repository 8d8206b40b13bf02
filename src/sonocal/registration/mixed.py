"""Points, lines and planes in any mix: weighed by the noise that each carries, or all distances alike."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import Array, Similarity
from sonocal.registration.certificate import Certificate, certificate_of_mix, certificate_of_spanned
from sonocal.registration.constraints import Rows
from sonocal.registration.mix_covariance import Covariance, covariance_of_mix
from sonocal.registration.options import Options
from sonocal.registration.rows import to_core
from sonocal.registration.spanned import SpannedRows
from sonocal.registration.told import Told

__all__ = ["MixedFit", "least_squares", "maximise"]

# Of a correlation matrix's eigenvalues.
ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class MixedFit:
    """A similarity fitted to correspondences that agree.

    Attributes:
        transform: mm from px.
        covariance: of its tangent, with the noise in it; None where a motion is free or no row is left to tell it.
        residuals_mm: (C,): root mean square distance of each correspondence's points from their target.
        inlier: (C,): those that agree.
        converged: whether it came to rest.
        certificate: looks whether it is the best of all.
        sigma_px, sigma_mm: noise levels behind the likelihood's weights; None: all distances counted alike.
    """

    transform: Similarity
    covariance: Covariance | None
    residuals_mm: Array
    inlier: NDArray[np.bool_]
    converged: bool
    certificate: Callable[[], Certificate]
    sigma_px: float | None = None
    sigma_mm: float | None = None


def least_squares(
    rows: Rows, start: Similarity, found: _core.Estimate, options: Options, told: Told
) -> MixedFit:
    """What least squares made of the correspondences, with the covariance of errors that each one's rows share."""
    inlier: NDArray[np.bool_] = found.residuals_mm <= found.threshold
    agreeing, weights = rows.select(inlier), told.of_rows(rows, inlier)
    about = agreeing.points, agreeing.planes, agreeing.first, start, weights
    covariance = covariance_of_mix(*about, scale_known=options.model == "rigid")
    certificate = partial(certificate_of_mix, rows, inlier, start, options, told)
    return MixedFit(start, covariance, found.residuals_mm, inlier, found.converged, certificate)


def maximise(rows: SpannedRows, start: Similarity, options: Options, told: Told) -> MixedFit | None:
    """The maximum of the likelihood near a start, over the sightings that agree with it.

    A point of the image is off by a level along each of its axes, and a spanning point along each of space; what the
    latter makes of a place on the target follows from how the place is made up of them, and points of one sighting
    share it. Both levels are those of restricted maximum likelihood where they are not given.

    Args:
        rows: the sightings.
        start: near the answer.
        options: with the threshold, and the levels and the scale where they are known.
        told: what multiplies the noise of each.

    Returns:
        None where it runs away from the start, or too few agree to tell the levels.

    Source: paper section 8 with the noise of section 9 in it; Kenward and Roger 1997 for the covariance.
    """
    weighed = rows if told.weights is None else _weighed(rows, told.weights)
    known, given = options.model == "rigid", (options.sigma_px or 0.0, options.sigma_mm or 0.0)
    found = _core.maximise(weighed.core, to_core(start), options.to_core(*given))
    if not (found.found and found.sound):
        return None
    assert options.threshold_mm != "auto"
    inlier: NDArray[np.bool_] = found.residuals_mm <= options.threshold_mm
    if not all(given) and weighed.select(inlier).residuals <= 7 - known:
        return None
    similarity = Similarity(found.rotation, found.translation, options.scale_mm_per_px or found.scales[0])
    levels = options.to_core(found.level_px, found.level_mm)
    return MixedFit(
        similarity,
        _covariance(found, scale_known=known),
        found.residuals_mm,
        inlier,
        found.converged,
        partial(certificate_of_spanned, weighed, inlier, similarity, levels),
        found.level_px,
        found.level_mm,
    )


def _weighed(rows: SpannedRows, weights: Array) -> SpannedRows:
    """Deviations of distances are of all that moves a point from its target."""
    sigma = 1.0 / weights
    of_points = np.repeat(sigma, np.diff(rows.first))
    return replace(
        rows,
        sigma_mm=sigma if rows.sigma_mm is None else sigma * rows.sigma_mm,
        sigma_px=of_points if rows.sigma_px is None else of_points * rows.sigma_px,
    )


def _covariance(found: _core.Estimate, *, scale_known: bool) -> Covariance | None:
    """None where a motion is free, or as good as: of numbers so large rounding leaves no covariance."""
    matrix = found.covariance
    if not np.isfinite(matrix).all() or not matrix.diagonal().min() > 0:
        return None
    size = np.sqrt(matrix.diagonal())
    if not np.linalg.eigvalsh(matrix / np.outer(size, size))[0] > -ROUNDING:
        return None
    return Covariance(np.pad(matrix, (0, 1)) if scale_known else matrix, found.freedom)
