"""Measured errors that are a surprise: of points whose place is known, and of another calibration."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from sonocal.calibration import Calibration
from sonocal.calibration.held_out import is_far_off
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.uncertainty import point_covariance, radius_95
from sonocal.validation.comparison import Comparison
from sonocal.validation.quantity import Quantity

__all__ = ["comparison_findings", "point_findings"]

# Of a point's noise along three axes, where the fit's residuals show two of them.
ALL_AXES = math.sqrt(1.5)
# What the error of few points is at the least: an interval needs three independent ones.
FEW_POINTS = 1.0 / 3.0


def point_findings(calibration: Calibration, points_px: Array, measured: Quantity) -> Iterator[Diagnostic]:
    """Points that are further off than the fit and its uncertainty explain.

    Args:
        calibration: the calibration.
        points_px: (N, 2) or (N, 3): where the points were seen.
        measured: the root mean square of their errors.
    """
    if calibration.covariance is None:
        return
    covariances = point_covariance(calibration.probe_from_image, calibration.covariance, points_px)
    predicted = float(radius_95(covariances, calibration.noise.freedom).max())
    expected = math.hypot(predicted, ALL_AXES * calibration.fit.rms_mm)
    known = not math.isnan(measured.low_mm)
    low = measured.low_mm if known else FEW_POINTS * measured.value_mm
    if not low > expected:
        return
    least = f"at least {low:.2f}" if known else f"of {measured.count} errors only"
    yield Diagnostic(
        code="points-far-off" if is_far_off(calibration, low) else "points-off",
        severity="warning",
        message=(
            f"{measured.title}: points are off by {measured.value_mm:.2f} mm rms ({least}), where the fit and its "
            f"uncertainty explain {expected:.2f} mm"
        ),
        advice=(
            "believe the points if their places are sure: calibrate again; else check the frame and the unit of their "
            "places, and the calibration of the tool that touched them"
        ),
    )


def comparison_findings(calibration: Calibration, comparison: Comparison) -> Iterator[Diagnostic]:
    """Another calibration that differs by more than both allow, and by more than is accepted."""
    worst = float(np.max(comparison.distance_mm))
    if not comparison.differ or not worst > calibration.options.tolerance_mm:
        return
    yield Diagnostic(
        code="calibrations-differ",
        severity="warning",
        message=(
            f"the other calibration puts the image up to {worst:.1f} mm elsewhere, which is more than their "
            "uncertainty explains"
        ),
        advice="one of the two is wrong, or the marker was moved between them: scan again, and compare with that",
    )
