"""A number in millimetres with its definition, its spread and its confidence interval."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.statistics import log_interval, rms_interval
from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["Quantity", "rms_quantity", "trimmed_mean_quantity"]


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

    __repr__ = brief
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
    low, high = rms_interval(errors_mm, groups)
    return Quantity(
        code=code,
        title=title,
        definition=definition,
        value_mm=float(np.sqrt(np.mean(errors_mm**2))),
        low_mm=low,
        high_mm=high,
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
