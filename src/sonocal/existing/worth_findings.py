"""What rows and scanners say against a matrix of other software: findings, and their words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from sonocal.errors import SonocalError
from sonocal.existing.difference import Difference
from sonocal.existing.matrix import Existing
from sonocal.existing.meaning import UNEQUAL, meaning_of
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.setup_checks.scale import scale_doubt
from sonocal.validation import Quantity

__all__ = ["Said", "against_scanner", "not_calibrated", "ratios_to", "with_interval", "worse_than_ours"]


class Said(NamedTuple):
    """What is said of the mm/px.

    Attributes:
        mm_per_px: one number, or one along u and one along v.
        by: who says so, for messages.
    """

    mm_per_px: tuple[float, ...]
    by: str


def worse_than_ours(
    existing: Existing, theirs: Sequence[Quantity], ours: Sequence[Quantity], apart: Difference | None
) -> Iterator[Diagnostic]:
    """Where the matrix leaves more error than ours, and is further from it than ours leaves open."""
    if not theirs or not ours or apart is None or apart.beyond is None:
        return
    # Few wires hold ours loosely while it fits their neighbours in time: then the matrix may be the better one.
    if not theirs[0].low_mm > ours[0].high_mm or not apart.beyond.any():
        return
    yield Diagnostic(
        code="worse-than-ours",
        severity="warning",
        message=(
            f"{existing.said} is off by {with_interval(theirs[0])} where our own calibration, on the same rows, is off "
            f"by {with_interval(ours[0])}"
        ),
        advice=_why(apart) + "; if nothing did, take ours: sonocal calibrate",
    )


def against_scanner(existing: Existing, said: Said | None) -> Iterator[Diagnostic]:
    """The matrix's mm/px, which are given without an uncertainty, against what is said."""
    if said is not None:
        scales = meaning_of(existing.matrix).scales_mm_per_px
        yield from scale_doubt(scales, np.zeros(2), said.mm_per_px, existing.said, said.by)


def not_calibrated(error: SonocalError) -> Diagnostic:
    """That there is no calibration of ours beside it."""
    return Diagnostic(
        code="not-computed",
        severity="warning",
        message=f"there is no calibration of our own to compare with: {error}",
        advice="compare on rows that allow one",
    )


def ratios_to(scales: Array, said: Said) -> str:
    """How far mm/px are from what is said, in words."""
    ratios = scales[:2] / np.broadcast_to(said.mm_per_px[:2], (2,)) - 1.0
    return f"{100 * ratios[0]:+z.1f} % along u and {100 * ratios[1]:+z.1f} % along v"


def with_interval(quantity: Quantity) -> str:
    """A number with its interval, where it has one."""
    value = f"{quantity.value_mm:.2f} mm"
    if np.isnan(quantity.low_mm):
        return value
    return f"{value} ({quantity.low_mm:.2f} to {quantity.high_mm:.2f})"


def _why(apart: Difference) -> str:
    """What differs most, and what does that."""
    ratio = apart.scale_ratios
    if np.abs(ratio).max() > UNEQUAL:
        return (
            f"its mm/px differ by {100 * ratio[np.argmax(np.abs(ratio))]:+.1f} %: look for another depth setting, or "
            "images that were resampled or cropped since"
        )
    return (
        f"its mm/px agree, it is turned by {apart.rotation_deg:.2f} deg and {apart.distance_mm[-1]:.2f} mm off in the "
        "middle: look for a marker that was moved on the probe, or a needle or phantom that was measured otherwise"
    )
