"""A second answer that fits as well: what nearly parallel lines leave to a 2D image."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sonocal import _core
from sonocal.geometry import Array, AxisScaled, Similarity, area_places
from sonocal.registration.fit import Fit
from sonocal.registration.noise import Noise
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.rows import PointLineRows
from sonocal.registration.uncertainty import point_jacobian

__all__ = ["Rival", "beside_rival", "better_of_mirrored", "mirrored_answer", "rival_of"]

# Lines further apart than this tell an image from its mirror in any noise worth calibrating with.
WIDEST_CONE_DEG = 40.0
# Frobenius norm: refinement that comes this near has come back.
SAME_ROTATION = 1e-3
# A rival less likely than this is none.
LEAST_PROBABILITY = 1e-3


@dataclass(frozen=True, eq=False)
class Rival:
    """A second answer that the residuals do not exclude.

    Attributes:
        probability: of being the right one of the two.
        rms_mm, own_rms_mm: residuals of the same rows, its own and the answer's.
        apart_mm: how far the two are apart at most, in the image.
        covariance: (k, k), what it adds to the tangent's covariance: probability times the outer product of
            the way from the answer to it.
    """

    probability: float
    rms_mm: float
    own_rms_mm: float
    apart_mm: float
    covariance: Array


def better_of_mirrored(rows: PointLineRows, fit: Fit) -> tuple[Fit, Fit | None]:
    """The fit and its mirrored answer, the better first; None where there is no other.

    Args:
        rows: points and lines.
        fit: the answer.
    """
    other = mirrored_answer(rows, fit)
    if other is None or not _truncated(other, fit.threshold_mm) < _truncated(fit, fit.threshold_mm):
        return fit, other
    inlier = other.residuals_mm <= fit.threshold_mm
    better = refine_point_lines(other.transform, rows, inlier, fit.options)
    return replace(better, inlier=inlier, threshold_mm=fit.threshold_mm, samples=fit.samples), fit


def beside_rival(noise: Noise, fit: Fit, mirrored: Fit | None, area_px: Array) -> tuple[Noise, Rival | None]:
    """The noise, with what a second answer adds to its covariance, and that answer; None: there is no such one.

    Args:
        noise: of the answer.
        fit: the answer.
        mirrored: the mirrored answer, if there is one.
        area_px: (2, d), the box in which the two are compared.
    """
    rival = None if mirrored is None else rival_of(fit, mirrored, noise.covariance, area_places(area_px))
    if rival is None:
        return noise, None
    return replace(noise, covariance=noise.covariance + rival.covariance), rival


def rival_of(fit: Fit, other: Fit, covariance: Array, places: Array) -> Rival | None:
    """The other answer as a rival, unless the residuals exclude it.

    Args:
        fit: the answer.
        other: the mirrored answer.
        covariance: (k, k), of the answer's tangent: errors that rows share make differences of the residuals
            count for less.
        places: (M, 2), px, where the two are compared.
    """
    count = 2 * int(fit.inlier.sum())
    variance = _squares(fit, fit) / max(count - len(covariance), 1)
    if not (variance > 0 and np.all(np.isfinite(covariance))):
        return None
    # What rows share makes their residuals' differences count for less, as it does for the covariance.
    independent = fit.covariance if fit.weighting == "likelihood" else variance * fit.covariance
    shared = max(float(np.median(np.diag(covariance) / np.diag(independent))), 1.0)
    worse = (_squares(other, fit) - _squares(fit, fit)) / (variance * shared)
    probability = float(1.0 / (1.0 + np.exp(min(0.5 * max(worse, 0.0), 700.0))))
    if probability < LEAST_PROBABILITY:
        return None
    away = other.transform @ places - fit.transform @ places
    jacobian = point_jacobian(fit.transform, places, len(covariance)).reshape(-1, len(covariance))
    way = np.linalg.lstsq(jacobian, away.reshape(-1), rcond=None)[0]
    return Rival(
        probability=probability,
        rms_mm=float(np.sqrt(2.0 * _squares(other, fit) / count)),
        own_rms_mm=float(np.sqrt(2.0 * _squares(fit, fit) / count)),
        apart_mm=float(np.linalg.norm(away, axis=1).max()),
        covariance=probability * np.outer(way, way),
    )


def _truncated(fit: Fit, threshold_mm: float) -> float:
    """What the consensus minimises, over all rows: whose residuals are small must not depend on who chose them."""
    return float(np.sum(np.minimum(fit.residuals_mm, threshold_mm) ** 2))


def _squares(of: Fit, rows_of: Fit) -> float:
    return float(np.sum(of.residuals_mm[rows_of.inlier] ** 2))


def mirrored_answer(rows: PointLineRows, fit: Fit) -> Fit | None:
    """The fit of the image mirrored in the plane across the lines' common direction, refined; None if it is no other.

    Parallel lines only see the image's projection along them, which an image tilted forwards and one tilted
    backwards share: c1 and c2 lose nothing by a change of sign of their parts along the lines. Lines that are
    nearly parallel decide between the two by little, and noise can decide otherwise.

    Args:
        rows: points of a 2D image and their lines.
        fit: the answer, whose agreeing rows are fitted again.

    Returns:
        The other answer, or None where the lines differ in direction, the image is that of a 3D probe, or
        refinement leads back to the answer.
    """
    if rows.dimension == 3:
        return None
    extent = _core.extent(rows.core, fit.inlier)
    if np.degrees(extent.direction_spread) > WIDEST_CONE_DEG:
        return None
    start = _mirrored(fit.transform, extent.common, rows.points[fit.inlier].mean(axis=0))
    other = refine_point_lines(start, rows, fit.inlier, fit.levelled)
    turned = np.linalg.norm(other.transform.rotation - fit.transform.rotation)
    return other if turned > SAME_ROTATION else None


def _mirrored(transform: AxisScaled, axis: Array, centre: Array) -> AxisScaled:
    """The image mirrored in the plane across an axis through where the centre (3,) px is mapped to."""
    mirror = np.eye(3) - 2.0 * np.outer(axis, axis)
    first, second = (mirror @ transform.rotation[:, :2]).T
    rotation = np.column_stack([first, second, np.cross(first, second)])
    translation = transform.apply(centre) - rotation @ (transform.scales * centre)
    if isinstance(transform, Similarity):
        return Similarity(rotation, translation, transform.scale)
    return AxisScaled(rotation, translation, transform.scales)
