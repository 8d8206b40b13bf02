"""What is said of a lag between image and tracker."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry import Array, AxisScaled, area_places
from sonocal.setup_checks.evidence import Evidence
from sonocal.setup_checks.lag_search import LEAST_AGREEING, Lag, find_lag
from sonocal.setup_checks.latency import (
    LEAST_LAG_MM,
    beyond_tolerance,
    gain_of,
    in_words,
    latency_finding,
    latency_findings,
)
from sonocal.setup_checks.motion import Motion
from sonocal.setup_checks.rows_in_time import RowsInTime

__all__ = ["lag_finding", "lags_of", "looks_late", "spoiling_lag"]

# Signs of trouble that a search is worth its time for: rows left out, residuals that are no noise's (share of the
# threshold), or a latency that they hint at, by three deviations were they independent.
SUSPICIOUS_OUTLIERS, SUSPICIOUS_RMS, HINT = 0.1, 0.25, 9.0


def lags_of(evidence: Evidence, motion: Motion | None, latency: float) -> Iterator[Diagnostic]:
    """Looks for a lag where the rows give reason to, and says what it does.

    Args:
        evidence: the rows and their calibration.
        motion: those that the checks over time look at; None: too few agree.
        latency: what their residuals hint at, 0 where nothing does.
    """
    if looks_late(evidence, motion):
        rows = RowsInTime.of(evidence.observations, evidence.table)
        lag = find_lag(rows, evidence.threshold_mm, evidence.model)
        if lag is not None and lag.moved_mm > LEAST_LAG_MM:
            yield lag_finding(lag)
            area = evidence.area_px, evidence.tolerance_mm, evidence.area_name
            yield from spoiling_lag(lag, evidence.transform, area)
            return
    # Few rows that agree by chance follow the needle's speed as well.
    if motion is not None and np.mean(evidence.inlier) >= LEAST_AGREEING:
        yield from latency_findings(motion, latency, evidence.tolerance_mm)


def looks_late(evidence: Evidence, motion: Motion | None) -> bool:
    """Whether a search is worth its time."""
    if motion is None or np.mean(evidence.inlier) < 1.0 - SUSPICIOUS_OUTLIERS:
        return True
    if evidence.rms_mm > SUSPICIOUS_RMS * evidence.threshold_mm:
        return True
    return gain_of(motion, evidence.inlier[motion.rows]) > HINT


def lag_finding(lag: Lag, known_s: float = 0.0) -> Diagnostic:
    """The finding of a lag, with its value; of what was undone before (`known_s`) and it, the whole is asked for."""
    rows = f"{lag.agreeing} of {lag.compared} rows agree when their lines are taken from then"
    words = in_words(lag.value, lag.deviation, lag.unit, lag.speed)
    return latency_finding(f"{words}; {rows}", lag.value, lag.unit, known_s)


def spoiling_lag(lag: Lag, transform: AxisScaled, accepted: tuple[Array, float, str]) -> Iterator[Diagnostic]:
    """The finding that an answer is not to be used: without the lag it is another one.

    Args:
        lag: what was found.
        transform: the answer.
        accepted: the area (2, d), the error that is accepted at its corners, mm, and what messages call the area.
    """
    area_px, tolerance_mm, area_name = accepted
    corners = area_places(area_px)[:-1]
    apart = np.linalg.norm(lag.fit.transform @ corners - transform @ corners, axis=-1).max()
    if apart > tolerance_mm:
        yield beyond_tolerance(
            f"with the lag undone the corners of the {area_name} lie up to {apart:.1f} mm elsewhere",
            tolerance_mm,
        )
