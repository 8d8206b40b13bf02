"""Rows that were not fitted: how far off they are, and whether that is a surprise."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.result import Calibration
from sonocal.calibration.rows import line_distances
from sonocal.calibration.statistics import ErrorStatistics, rms_interval
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, AxisScaled, homogeneous_points
from sonocal.observations import Observations, group_codes
from sonocal.registration.noise import residual_vectors, stretch_length

__all__ = ["held_out_errors", "held_out_findings", "independent_units"]


def held_out_errors(
    probe_from_image: AxisScaled, held_out: Observations | None, threshold_mm: float
) -> ErrorStatistics | None:
    """The errors of all rows held out, however far off; None where none were."""
    if held_out is None:
        return None
    distances = line_distances(probe_from_image, held_out)
    return ErrorStatistics.of(distances, len(held_out), int(np.sum(distances <= threshold_mm)))


def held_out_findings(calibration: Calibration, held_out: Observations | None) -> Iterator[Diagnostic]:
    """Held-out rows that are further off than the fit and its uncertainty explain."""
    if held_out is None or calibration.covariance is None:
        return
    errors = line_distances(calibration.probe_from_image, held_out)
    units = independent_units(calibration.probe_from_image, held_out)
    low = rms_interval(errors, units)[0]
    expected = float(np.hypot(_own_rms(calibration), calibration.predicted_errors()[1].max()))
    # Two sizes of errors are compared, each as unsure as its own rows leave it: log-normal to either side.
    surprise = np.log(_rms(errors) / low) if low > 0 else np.inf
    if not _rms(errors) > expected * np.exp(np.hypot(surprise, _unsureness(calibration.noise.freedom))):
        return
    yield Diagnostic(
        code="held-out-rows-off",
        severity="warning",
        message=(
            f"held-out rows are off by {_rms(errors):.2f} mm rms (at least {low:.2f}), where the fit and its "
            f"uncertainty explain {expected:.2f} mm"
        ),
        advice=(
            "look for what differs between the two parts: a marker or a needle that moved, other targets, another "
            "depth setting"
        ),
    )


def independent_units(probe_from_image: AxisScaled, rows: Observations) -> NDArray[np.int64]:
    """The unit (N,) of each row: its frame, or a stretch of frames where neighbours repeat one another."""
    frame = group_codes(rows.split, rows.frame)
    points = homogeneous_points(rows.points_px)
    length = stretch_length(residual_vectors(probe_from_image, points, rows.segments_mm), frame)
    return group_codes(rows.split, frame // length)


def _unsureness(freedom: int) -> float:
    """How far, as a logarithm, 97.5 % of noises lie at the most above what so many residuals make of them."""
    from scipy.special import chdtri

    return 0.5 * float(np.log(max(freedom, 1) / chdtri(max(freedom, 1), 0.975)))


def _own_rms(calibration: Calibration) -> float:
    """Of fitted rows, mm, as if the fit had taken no part of their errors, which of few is much."""
    assert calibration.covariance is not None
    equations = 2 * calibration.fit.inliers
    return calibration.fit.rms_mm * float(
        np.sqrt(equations / max(equations - len(calibration.covariance), 1))
    )


def _rms(errors: Array) -> float:
    return float(np.sqrt(np.mean(errors**2)))
