"""Is the threshold wide enough for the noise, or does it cut off rows of the needle itself?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.mapped import MappedRows
from sonocal.setup_checks.evidence import Evidence
from sonocal.setup_checks.placement import USUAL_MM

__all__ = [
    "ENOUGH_DEVIATIONS",
    "PART_OF_IMAGE",
    "agreeing_further",
    "check_threshold",
    "cut_deviation",
    "noise_of_middle",
    "share_but_for_noise",
    "threshold_too_small",
]

# Of the noise: below so many standard deviations a threshold leaves out more than 4 % of sound rows.
LEAST_DEVIATIONS = 2.5
# As many as "auto" takes.
ENOUGH_DEVIATIONS = 3.3
# Of two normal components 1.1 % are further.
NEARLY_ALL_DEVIATIONS, NEARLY_ALL = 3.0, 0.96
# Fewer sightings say too little of how far their noise reaches.
FEWEST = 20
# Standard deviations of the mean square by which it must be too large.
SURE = 2.0
# Of an image that is not much larger than what rows usually agree within, they may agree within this part.
PART_OF_IMAGE = 0.25


def check_threshold(evidence: Evidence) -> Iterator[Diagnostic]:
    """Does the threshold cut off what is noise?"""
    deviation_mm = cut_deviation(evidence)
    if deviation_mm is None:
        return
    left = int(np.count_nonzero(~evidence.inlier))
    ratio = evidence.threshold_mm / deviation_mm
    yield threshold_too_small(
        f"the threshold of {evidence.threshold_mm:.3g} mm is {ratio:.1f} standard deviations of the rows' noise, which "
        f"is {deviation_mm:.2g} mm per axis: rows of the needle itself are among the {left} of {len(evidence.inlier)} "
        "left out",
        ENOUGH_DEVIATIONS * deviation_mm,
    )


def cut_deviation(evidence: Evidence) -> float | None:
    """The noise per axis, mm, if the threshold is surely below 2.5 standard deviations of it; of lines alone.

        E[d^2 | d <= T] = 2 sigma^2 (1 - x / (e^x - 1)),    x = T^2 / (2 sigma^2)

    d: distance of a point whose two components across the line are normal. Where x is small the rows that agree tell
    little of sigma; then the larger part of it is from how many are beyond, if these are no more than noise leaves.

    Source: moments of a truncated exponential distribution, which d^2 has.
    """
    if not isinstance(evidence.mapped, MappedRows):
        return None
    away = evidence.mapped.distances[evidence.inlier]
    sightings = evidence.table.sightings
    seen = len(away) if sightings is None else len(np.unique(sightings[evidence.inlier]))
    if seen < FEWEST or not evidence.threshold_mm < np.inf:
        return None
    squares = (away / evidence.threshold_mm) ** 2
    mean = float(np.mean(squares)) * 2 * len(away) / (2 * len(away) - evidence.parameters)
    sure = mean - SURE * float(np.std(squares)) / np.sqrt(seen)
    if sure <= _mean_square(LEAST_DEVIATIONS**2 / 2.0):
        return None
    beyond = np.count_nonzero(~evidence.inlier) / len(away)
    of_agreeing, of_all = 1.0 / np.sqrt(2.0 * _cut_at(mean)), np.sqrt((mean + beyond) / 2.0)
    return float(evidence.threshold_mm * min(of_agreeing, of_all))


def _mean_square(x: float) -> float:
    """Of d / T: from 1 / 2, of d^2 that are anywhere up to T^2, down."""
    return 1.0 / x - 1.0 / float(np.expm1(x))


def _cut_at(mean: float) -> float:
    """The x of a mean square of d / T; next to none where the mean is that of no noise."""
    from scipy.optimize import brentq

    least, most = 1e-3, 50.0
    return (
        least if mean >= _mean_square(least) else float(brentq(lambda x: _mean_square(x) - mean, least, most))
    )


def share_but_for_noise(evidence: Evidence) -> float:
    """Share of the rows that agree within what noise may come to: many further than the threshold are no wrong frame.

    Of rows in no common frame some are further than any noise.
    """
    away, deviation_mm = evidence.mapped.distances, cut_deviation(evidence)
    if deviation_mm is not None and deviation_mm <= evidence.threshold_mm:
        share = float(np.mean(away <= NEARLY_ALL_DEVIATIONS * deviation_mm))
        if share >= NEARLY_ALL:
            return share
    return agreeing_further(away, evidence.transform.apply(evidence.table.points), evidence.threshold_mm)


def agreeing_further(distances: Array, mapped: Array, threshold_mm: float) -> float:
    """Share of the rows that agree within what is usual, where the threshold is less: noise is no wrong frame.

    Args:
        distances: (N,), mm, of points to their lines.
        mapped: (N, 3), mm, the points.
        threshold_mm: that was given.
    """
    extent = float(np.ptp(mapped, axis=0).max())
    return float(np.mean(distances <= max(threshold_mm, min(USUAL_MM, PART_OF_IMAGE * extent))))


def noise_of_middle(distance_mm: float) -> float:
    """Standard deviation of each of two normal components, mm, by their median distance."""
    return distance_mm / float(np.sqrt(2.0 * np.log(2.0)))


def threshold_too_small(message: str, enough_mm: float) -> Diagnostic:
    """The finding, with what to do."""
    return Diagnostic(
        code="threshold-below-noise",
        severity="warning",
        message=message,
        advice=(
            f'give --threshold-mm auto, or {enough_mm:.2g} and more (in Python threshold_mm="auto"); if so much noise '
            "is not expected, look at the detections first"
        ),
    )
