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
from sonocal.validation.point_table import PointSightings
from sonocal.validation.quantity import Quantity

__all__ = ["comparison_findings", "point_findings"]

# Of a point's noise along three axes, where the fit's residuals show two of them.
ALL_AXES = math.sqrt(1.5)
# Points that agree on nothing leave an interval that excludes nothing: so much of the error measured is believed at
# the least, and of a single point's.
BELIEVED = 1.0 / 3.0


def point_findings(
    calibration: Calibration, sightings: PointSightings, measured: Quantity
) -> Iterator[Diagnostic]:
    """Points that are further off than the fit and its uncertainty explain, or one of them that is.

    Args:
        calibration: the calibration.
        sightings: where the points were seen, and where they are known to be.
        measured: the root mean square of their errors.
    """
    if calibration.covariance is None:
        return
    expected = _explained(calibration, sightings.points_px)
    low = max(BELIEVED * measured.value_mm, measured.low_mm if measured.low_mm > 0 else 0.0)
    row, furthest = _furthest(calibration, sightings)
    if not max(low, BELIEVED * furthest) > expected:
        return
    known = low == measured.low_mm
    least = f"at least {low:.2f}" if known else f"of {measured.count} errors that hardly agree"
    yield Diagnostic(
        code="points-far-off" if low > expected and is_far_off(calibration, low) else "points-off",
        severity="warning",
        message=(
            f"{measured.title}: points are off by {measured.value_mm:.2f} mm rms ({least}), where the fit and its "
            f"uncertainty explain {expected:.2f} mm{row}"
        ),
        advice=(
            "believe the points if their places are sure: calibrate again; else check the frame and the unit of their "
            "places, and the calibration of the tool that touched them"
        ),
    )


def _explained(calibration: Calibration, points_px: Array) -> float:
    """How far a point may be off, mm, where all is well."""
    assert calibration.covariance is not None
    covariances = point_covariance(calibration.probe_from_image, calibration.covariance, points_px)
    predicted = float(radius_95(covariances, calibration.noise.freedom).max())
    return math.hypot(predicted, ALL_AXES * calibration.fit.rms_mm)


def _furthest(calibration: Calibration, sightings: PointSightings) -> tuple[str, float]:
    """The point that is furthest from where it is known to be, in words, and by how many mm."""
    if sightings.points_mm is None or len(sightings) < 2:
        return "", 0.0
    errors = np.linalg.norm(
        calibration.probe_from_image @ sightings.points_px - sightings.points_probe_mm, axis=1
    )
    row = int(np.argmax(errors))
    return f"; the furthest, point {row + 1} of {len(errors)}, is off by {errors[row]:.2f} mm", float(
        errors[row]
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
