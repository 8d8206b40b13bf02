"""What a covariance of the tangent means in the image: errors of mapped points, the weakest motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sonocal.geometry import Array, AxisScaled, homogeneous_points

__all__ = [
    "NORMAL_95",
    "SIGNIFICANT",
    "WeakMotion",
    "point_covariance",
    "point_jacobian",
    "quantile_95",
    "radius_95",
    "scale_95",
    "weakest_motion",
]

# Two-sided 95 % of a normal distribution, in standard deviations; and what is no chance, in the same.
NORMAL_95 = 1.96
SIGNIFICANT = 3.0


def point_jacobian(transform: AxisScaled, points: ArrayLike, parameters: int = 7) -> Array:
    """Derivative of mapped points by the tangent.

        d(A x) = w x (S x) + v + l S x        for the tangent (w, v, l)

    Args:
        transform: mm from px.
        points: (N, 2) or (N, 3), px.
        parameters: 7; 6 where the scale is known; 8 or 9 for a log scale along u, v and, in a volume, w.

    Returns:
        (N, 3, parameters): mm per rad, mm per mm, mm per unit of log scale.
    """
    x = homogeneous_points(points)
    columns = transform.rotation * transform.scales
    turned = x @ columns.T
    jacobian = np.zeros((len(x), 3, parameters))
    jacobian[:, 0, 1], jacobian[:, 0, 2] = turned[:, 2], -turned[:, 1]
    jacobian[:, 1, 0], jacobian[:, 1, 2] = -turned[:, 2], turned[:, 0]
    jacobian[:, 2, 0], jacobian[:, 2, 1] = turned[:, 1], -turned[:, 0]
    jacobian[:, :, 3:6] = np.eye(3)
    if parameters == 7:
        jacobian[:, :, 6] = turned
    else:
        jacobian[:, :, 6:] = x[:, None, : parameters - 6] * columns[:, : parameters - 6]
    return jacobian


def point_covariance(transform: AxisScaled, covariance: Array, points: ArrayLike) -> Array:
    """Covariance (N, 3, 3) in mm^2 of mapped points (N, 2) or (N, 3) px, to first order."""
    jacobian = point_jacobian(transform, points, len(covariance))
    return np.asarray(jacobian @ covariance @ np.swapaxes(jacobian, 1, 2))


def radius_95(covariances: Array, freedom: float = np.inf, *, at_once: int = 1) -> Array:
    """The error (...) in mm that 95 % stay below, for normal errors of covariance (..., 3, 3) in mm^2.

    The squared error is a sum of three scaled chi-squared variables; one of the same mean and variance
    stands in for it (Satterthwaite 1946), within 2 % of the exact quantile.

    Args:
        covariances: (..., 3, 3), mm^2.
        freedom: residuals to spare that the covariance's own scale rests on: few make the error larger.
        at_once: errors that stay below together in 95 % of cases, or more where they depend (Sidak 1967).
    """
    from scipy.special import fdtri, gammaincinv

    level = 0.95 ** (1.0 / at_once)
    mean = np.trace(covariances, axis1=-2, axis2=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = covariances / mean[..., None, None]
        terms = 1.0 / np.sum(shares**2, axis=(-2, -1))  # 1: along one line; 3: alike all round
        ratio = (
            2.0 * gammaincinv(terms / 2, level) / terms if np.isinf(freedom) else fdtri(terms, freedom, level)
        )
        squared = np.where(mean > 0, mean * ratio, 0.0)
    return np.asarray(np.sqrt(squared))


def quantile_95(freedom: float = np.inf) -> float:
    """Standard deviations on either side of a number that hold its true value in 95 of 100 cases (Student's t).

    Args:
        freedom: residuals to spare that the standard deviation rests on: few make it larger.
    """
    from scipy.special import stdtrit

    return NORMAL_95 if np.isinf(freedom) else float(stdtrit(max(freedom, 1), 0.975))


def scale_95(covariance: Array, freedom: float = np.inf) -> float:
    """The 95 % uncertainty of the scale along u, as a share of it; 0 where it was told.

    Args:
        covariance: (k, k), of the tangent.
        freedom: as of `quantile_95`.
    """
    return quantile_95(freedom) * float(np.sqrt(covariance[6, 6])) if len(covariance) > 6 else 0.0


@dataclass(frozen=True, eq=False)
class WeakMotion:
    """The motion of the image that the data hold least, at one standard deviation.

    The motion is one of many that the covariance allows. How well its turn's angle, its shift or its scale are known is
    another question, which all of them answer together: the deviations.

    Attributes:
        tangent: (k,), the motion.
        rms_mm: how far it moves the given points, root mean square.
        share: its part of the points' total variance, 0 to 1.
        turn_rad: (3,), its rotation about the image's own axes u, v and w.
        shift_mm: (3,), how it moves the points' centre, along u, v and w.
        growth: (3,), its relative change of scale along u, v and w.
        turn_rms_mm, shift_rms_mm, growth_rms_mm: what each of the three moves the points by.
        turn_deviation_rad: of the rotation about the axis of ``turn_rad``, under the whole covariance.
        shift_deviation_mm: of the points' centre along ``shift_mm``, likewise.
        growth_deviation: of the log scale that the motion changes most, likewise.
    """

    tangent: Array
    rms_mm: float
    share: float
    turn_rad: Array
    shift_mm: Array
    growth: Array
    turn_rms_mm: float
    shift_rms_mm: float
    growth_rms_mm: float
    turn_deviation_rad: float
    shift_deviation_mm: float
    growth_deviation: float


def weakest_motion(transform: AxisScaled, covariance: Array, points: ArrayLike) -> WeakMotion:
    """The principal motion of the covariance, measured by how far it moves points of the image.

    Degrees and millimetres cannot be compared; displacements of the image can. The motion maximises
    the mean squared displacement of the points over all motions equally likely under the covariance.

    Args:
        transform: mm from px.
        covariance: (k, k), of the tangent.
        points: (N, 2) or (N, 3), px: the places that matter, such as the image's corners.
    """
    x = homogeneous_points(points)
    jacobian = point_jacobian(transform, x, len(covariance))
    metric = np.einsum("nik,nil->kl", jacobian, jacobian) / len(x)
    root = _square_root(covariance)
    values, vectors = np.linalg.eigh(root.T @ metric @ root)
    tangent = root @ vectors[:, -1]

    # Seen from the points' centre, so that a turn about a far origin does not pass for a shift.
    centre = x.mean(axis=0)
    at_centre = point_jacobian(transform, centre[None], len(covariance))[0]
    shift = at_centre @ tangent
    from_centre = (x - centre) * transform.scales
    turn = transform.rotation.T @ tangent[:3]
    growths = tangent[6:]  # none, where the scale is known
    growth = np.resize(growths, 3) if len(growths) else np.zeros(3)
    grown_most = 6 + int(np.argmax(np.abs(growths))) if len(growths) else None
    return WeakMotion(
        tangent=tangent,
        rms_mm=float(np.sqrt(max(values[-1], 0.0))),
        share=float(values[-1] / values.sum()) if values.sum() > 0 else 1.0,
        turn_rad=turn,
        shift_mm=transform.rotation.T @ shift,
        growth=growth,
        turn_rms_mm=_rms(np.cross(turn, from_centre)),
        shift_rms_mm=float(np.linalg.norm(shift)),
        growth_rms_mm=_rms(from_centre * growth),
        turn_deviation_rad=_deviation(covariance[:3, :3], tangent[:3]),
        shift_deviation_mm=_deviation(at_centre @ covariance @ at_centre.T, shift),
        growth_deviation=0.0 if grown_most is None else float(np.sqrt(covariance[grown_most, grown_most])),
    )


def _deviation(covariance: Array, direction: Array) -> float:
    """Standard deviation along a direction of any length; 0 where it has none."""
    length = float(np.linalg.norm(direction))
    unit = direction / length if length > 0 else direction
    return float(np.sqrt(max(float(unit @ covariance @ unit), 0.0)))


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors**2, axis=-1))))


def _square_root(covariance: Array) -> Array:
    """L with L L' = covariance, also where it is only positive semidefinite to rounding."""
    scale = np.sqrt(np.maximum(np.diag(covariance), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(covariance / scale[:, None] / scale)
    return np.asarray(scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))
