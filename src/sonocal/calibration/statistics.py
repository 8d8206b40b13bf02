"""Distances of mapped points to their lines, in five numbers; and how sure a mean of errors is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["ErrorStatistics", "log_interval", "rms_interval"]

# The coefficient of variation of few squared errors comes out too small, the more so the more skewed they
# are; widening by (n + 6) / n brings the measured coverage to 94-97 % from 12 units on.
SMALL_SAMPLE_UNITS = 6
FEWEST_UNITS = 3


@dataclass(frozen=True)
class ErrorStatistics:
    """Distances of mapped points to their lines, mm.

    Of the rows that were fitted, only those that agree count; of held-out rows, all.

    Attributes:
        observations: rows given.
        inliers: rows within the threshold.
        rms_mm, median_mm, p95_mm, max_mm: over the rows that count.
    """

    observations: int
    inliers: int
    rms_mm: float
    median_mm: float
    p95_mm: float
    max_mm: float

    __repr__ = brief

    @classmethod
    def of(cls, counted_mm: Array, observations: int, inliers: int) -> ErrorStatistics:
        """The statistics of some distances (M,) in mm."""
        median, p95 = _quantiles(counted_mm, (0.5, 0.95))
        return cls(
            observations=observations,
            inliers=inliers,
            rms_mm=float(np.sqrt(counted_mm @ counted_mm / len(counted_mm))),
            median_mm=median,
            p95_mm=p95,
            max_mm=float(counted_mm.max()),
        )


def _quantiles(values: Array, shares: tuple[float, ...]) -> list[float]:
    """Quantiles by linear interpolation: NumPy's own take a tenth of a whole calibration's time."""
    ordered, last = np.sort(values), len(values) - 1
    places = [share * last for share in shares]
    return [
        float(ordered[int(at)] + (at - int(at)) * (ordered[min(int(at) + 1, last)] - ordered[int(at)]))
        for at in places
    ]


def rms_interval(errors_mm: Array, groups: NDArray[np.int64]) -> tuple[float, float]:
    """95 % confidence interval of the root mean square of errors (N,), NaN for fewer than three groups.

    Args:
        errors_mm: (N,).
        groups: (N,): errors of different groups are independent.
    """
    squares = errors_mm**2
    mean = float(squares.mean())
    low, high = log_interval(mean, squares - mean, groups)
    return float(np.sqrt(low)), float(np.sqrt(high))


def log_interval(
    value: float, influences: Array, groups: NDArray[np.int64], *, widening_units: int = SMALL_SAMPLE_UNITS
) -> tuple[float, float]:
    """95 % confidence interval of a positive mean, symmetric in its logarithm.

    Sizes of errors are skewed: on the logarithmic scale the estimate is nearly normal. The variance is that
    of the groups' sums, so that rows of one frame may err together.

    Args:
        value: the estimate.
        influences: (N,): how far each error moves it, times N; they sum to zero.
        groups: (N,): errors of different groups are independent.
        widening_units: for few units n the variance is (n + this) / n times larger.

    Source: Student's t on the delta method's variance of the logarithm, clusters as in Cameron and Miller
    2015, section II.
    """
    from scipy.special import stdtrit

    sums = np.bincount(np.unique(groups, return_inverse=True)[1].reshape(-1), influences)
    n = len(sums)
    if n < FEWEST_UNITS:
        return np.nan, np.nan
    if value <= 0:
        return 0.0, 0.0
    variance = n / (n - 1) * float(np.sum(sums**2)) / len(influences) ** 2
    widened = variance * (n + widening_units) / n
    half = float(stdtrit(n - 1, 0.975)) * np.sqrt(widened) / value
    # Beyond this factor the interval says only "unknown", and the exponential would overflow.
    half = min(half, 50.0)
    return float(value * np.exp(-half)), float(value * np.exp(half))
