"""A number in millimetres with its definition, its spread and its confidence interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array

__all__ = ["Quantity", "log_interval", "rms_quantity", "trimmed_mean_quantity"]

# The coefficient of variation of few squared errors comes out too small, the more so the more skewed they
# are; widening by (n + 6) / n brings the measured coverage to 94-97 % from 12 units on.
SMALL_SAMPLE_UNITS = 6
FEWEST_UNITS = 3


@dataclass(frozen=True)
class Quantity:
    """One number of a validation.

    Attributes:
        code: short name, for programs.
        title: what it is called.
        definition: what it measures, in one sentence.
        value_mm: the number.
        low_mm, high_mm: its 95 % confidence interval: where the number would be with endless data of
            the same kind. NaN where there are fewer than three independent units.
        spread_mm: standard deviation of the single errors it summarises.
        count: single errors.
        units: how many of them are independent of one another.
        unit: what is counted by `units`.
    """

    code: str
    title: str
    definition: str
    value_mm: float
    low_mm: float
    high_mm: float
    spread_mm: float
    count: int
    units: int
    unit: str = "frames"


def rms_quantity(
    code: str,
    title: str,
    definition: str,
    errors_mm: Array,
    groups: NDArray[np.int64],
    *,
    unit: str = "frames",
) -> Quantity:
    """Root mean square of errors (N,) whose groups (N,), counted from 0, are independent of one another."""
    squares = errors_mm**2
    mean = float(squares.mean())
    low, high = log_interval(mean, squares - mean, groups)
    return Quantity(
        code=code,
        title=title,
        definition=definition,
        value_mm=float(np.sqrt(mean)),
        low_mm=float(np.sqrt(low)),
        high_mm=float(np.sqrt(high)),
        spread_mm=float(errors_mm.std()),
        count=len(errors_mm),
        units=len(np.unique(groups)),
        unit=unit,
    )


def trimmed_mean_quantity(
    code: str, title: str, definition: str, errors_mm: Array, groups: NDArray[np.int64], *, share: float
) -> Quantity:
    """Mean of the smallest share of the errors; the interval from its influence function.

        T = mean of the smallest share p        influence of e: (min(e, q_p) - E min(e, q_p)) / p

    Source: Wilcox, Introduction to Robust Estimation and Hypothesis Testing, section 3.3.
    """
    if not 0 < share <= 1:
        raise InputError(f"share must be above 0 and at most 1; got {share}")
    ordered = np.sort(errors_mm)
    kept = ordered[: max(1, round(share * len(ordered)))]
    winsorised = np.minimum(errors_mm, kept[-1])
    # Lengths, their tail cut off, are not as skewed as squares: nothing to widen for.
    influences = (winsorised - winsorised.mean()) / share
    low, high = log_interval(float(kept.mean()), influences, groups, widening_units=0)
    return Quantity(
        code=code,
        title=title,
        definition=definition,
        value_mm=float(kept.mean()),
        low_mm=low,
        high_mm=high,
        spread_mm=float(kept.std()),
        count=len(kept),
        units=len(np.unique(groups)),
    )


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
