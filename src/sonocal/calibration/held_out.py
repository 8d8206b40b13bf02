"""Rows that were not fitted: how far off they are, and whether that is a surprise."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.mixed import target_distances, target_vectors
from sonocal.calibration.result import Calibration
from sonocal.calibration.statistics import ErrorStatistics, rms_interval
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, AxisScaled
from sonocal.observations import Observations, group_codes
from sonocal.registration.noise import stretch_length

__all__ = ["FAR", "held_out_errors", "held_out_findings", "independent_units", "is_far_off"]

# Beyond this many times what the user accepts, care does not help.
FAR = 3.0
# Of gross errors among the held-out rows: both sides of the test.
LIKELY = 0.95


def held_out_errors(
    probe_from_image: AxisScaled, held_out: Observations | None, threshold_mm: float
) -> ErrorStatistics | None:
    """The errors of all rows held out, however far off; None where none were."""
    if held_out is None:
        return None
    distances = target_distances(probe_from_image, held_out)
    return ErrorStatistics.of(distances, len(held_out), int(np.sum(distances <= threshold_mm)))


def held_out_findings(calibration: Calibration, held_out: Observations | None) -> Iterator[Diagnostic]:
    """Held-out rows that are further off than the fit and its uncertainty explain.

    Gross errors are no surprise where the fit left out as many: then rows within the threshold count alone.
    """
    if held_out is None or calibration.covariance is None:
        return
    errors = target_distances(calibration.probe_from_image, held_out)
    within = errors <= calibration.threshold_mm
    usual = within.any() and not _more_outliers(calibration, within)
    counted = within if usual else np.ones(len(errors), dtype=bool)
    units = independent_units(calibration.probe_from_image, held_out)
    measured, low = _rms(errors[counted]), rms_interval(errors[counted], units[counted])[0]
    expected = float(np.hypot(_own_rms(calibration), calibration.predicted_errors()[1].max()))
    # Two sizes of errors are compared, each as unsure as its own rows leave it: log-normal to either side.
    surprise = np.log(measured / low) if low > 0 else np.inf
    if not measured > expected * np.exp(np.hypot(surprise, _unsureness(calibration.noise.freedom))):
        return
    far, which = is_far_off(calibration, low), "" if counted.all() else " within the threshold"
    yield Diagnostic(
        code="held-out-rows-far-off" if far else "held-out-rows-off",
        severity="warning",
        message=(
            f"held-out rows{which} are off by {measured:.2f} mm rms (at least {low:.2f}), where the "
            f"fit and its uncertainty explain {expected:.2f} mm"
        ),
        advice=(
            "look for what differs between the two parts: a marker or a needle that moved, other targets, another "
            "depth setting"
        ),
    )


def is_far_off(calibration: Calibration, error_mm: float) -> bool:
    """Whether an error, measured or predicted, is so far above what is accepted that care does not help."""
    return not error_mm <= FAR * calibration.options.tolerance_mm


def _more_outliers(calibration: Calibration, within: NDArray[np.bool_]) -> bool:
    """Whether held-out rows have more gross errors than the fitted ones lead one to expect."""
    from scipy.special import bdtrc, betaincinv

    rows, gross = calibration.fit.observations, int((~within).sum())
    fitted_gross = rows - calibration.fit.inliers
    if gross == 0 or fitted_gross == rows:
        return False
    # The share that the fitted rows allow, at its greatest (Clopper and Pearson 1934).
    share = betaincinv(fitted_gross + 1, rows - fitted_gross, LIKELY)
    return bool(bdtrc(gross - 1, len(within), share) < 1.0 - LIKELY)


def independent_units(probe_from_image: AxisScaled, rows: Observations) -> NDArray[np.int64]:
    """The unit (N,) of each row: its frame, or a stretch of frames where neighbours repeat one another."""
    frame = group_codes(rows.split, rows.frame)
    length = stretch_length(target_vectors(probe_from_image, rows), frame)
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
