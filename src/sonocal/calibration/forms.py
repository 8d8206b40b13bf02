"""What tests of single forms of error have in common: when there is something to test, and when it matters."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array
from sonocal.registration.fit import Fit
from sonocal.registration.noise import Noise
from sonocal.registration.robust import MINIMAL_ROWS
from sonocal.registration.uncertainty import point_covariance, point_jacobian, radius_95

__all__ = ["beyond_predicted", "can_be_tested", "moved_by"]

# An answer that moves by less is no matter in practice, however little is predicted.
LEAST_MM = 0.1


def can_be_tested(fit: Fit, noise: Noise) -> bool:
    """Whether rows are left to test with, and an error is predicted to compare with."""
    return bool(fit.inlier.sum() > MINIMAL_ROWS and np.all(np.isfinite(noise.covariance)))


def moved_by(fit: Fit, tangent: Array, corners: Array) -> Array:
    """(C, 3), mm: how far a small motion (k,) of the transform moves corners (C, d), px."""
    return np.asarray(point_jacobian(fit.transform, corners, len(fit.covariance)) @ tangent)


def beyond_predicted(moved_mm: Array, fit: Fit, noise: Noise, corners: Array) -> tuple[float, float] | None:
    """How far the answer moves at most, and the greatest error (95 %) that is predicted, mm.

    None where no corner moves by more than is predicted there.

    Args:
        moved_mm: (C,), at each corner.
        fit: the transform.
        noise: of the rows.
        corners: (C, d), px.
    """
    bounds = radius_95(point_covariance(fit.transform, noise.covariance, corners), noise.freedom)
    if not np.any(moved_mm > np.maximum(bounds, LEAST_MM)):
        return None
    return float(moved_mm.max()), float(bounds.max())
