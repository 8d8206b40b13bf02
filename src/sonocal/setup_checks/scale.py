"""Are the mm/px what the scanner or the recording says?"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sonocal.errors import InputError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.uncertainty import NORMAL_95, SIGNIFICANT
from sonocal.setup_checks.evidence import Evidence

__all__ = ["check_scale", "scale_deviation", "scale_doubt"]

# A scale off by less moves the far corner of a 100 mm image by less than 1 mm.
LEAST_SCALE_ERROR = 0.01
# Sound in cold water is slower than scanners take it to be by less, and in nothing that is scanned faster by more.
MOST_BY_SOUND = 0.06
UNITS = "check that needle lengths are in mm"


def check_scale(
    evidence: Evidence, scanner_mm_per_px: float | Sequence[float], said_by: str = "the scanner"
) -> Iterator[Diagnostic]:
    """The calibration's mm/px against what the scanner says, one number or one along u and one along v.

    Raises:
        InputError: a number is not positive.
    """
    deviation = scale_deviation(evidence.covariance)
    yield from scale_doubt(
        evidence.transform.scales, deviation, scanner_mm_per_px, "the calibration", said_by
    )


def scale_doubt(
    scales: Array, deviation: Array, scanner_mm_per_px: float | Sequence[float], name: str, said_by: str
) -> Iterator[Diagnostic]:
    """The finding, where mm/px are not what was said.

    Args:
        scales: (3,), mm/px.
        deviation: (2,): standard deviations of their logarithms.
        scanner_mm_per_px: what is said, one number or one along u and one along v.
        name: what the message calls the calibration.
        said_by: who says so.

    Raises:
        InputError: a number is not positive.
    """
    said = np.broadcast_to(np.asarray(scanner_mm_per_px, dtype=float).reshape(-1)[:2], (2,))
    if not np.all(np.isfinite(said) & (said > 0)):
        raise InputError(f"scanner_mm_per_px must be positive; got {scanner_mm_per_px}")
    off = np.log(scales[:2] / said)
    worst = int(np.argmax(np.abs(off)))
    if not abs(off[worst]) > max(SIGNIFICANT * deviation[worst], LEAST_SCALE_ERROR):
        return
    sure = f" (+-{100 * NORMAL_95 * deviation[worst]:.1f} %)" if deviation[worst] > 0 else ""
    yield Diagnostic(
        code="scale-differs-from-scanner",
        severity="warning",
        message=(
            f"{name} has {scales[worst]:.5f} mm/px along {'uv'[worst]} and {said_by} says "
            f"{said[worst]:.5f}: {100 * np.expm1(off[worst]):+.1f} %{sure}"
        ),
        advice=_cause(off),
    )


def scale_deviation(covariance: Array | None) -> Array:
    """(2,): standard deviations of the scales' logarithms, of a tangent; without end where unknown, 0 where told."""
    if covariance is None:
        return np.full(2, np.inf)
    return np.asarray(np.sqrt(np.resize(np.diag(covariance)[6:], 2)))


def _cause(off: Array) -> str:
    """What makes both axes differ alike, or one of them."""
    if abs(off[0] - off[1]) <= LEAST_SCALE_ERROR:
        return (
            "both axes differ alike: check that frames are not resampled between scanner and recording, and that the "
            f"depth setting is the scan's; {UNITS}"
        )
    if abs(off[0]) <= LEAST_SCALE_ERROR and abs(off[1]) <= MOST_BY_SOUND:
        return (
            "it is depth alone: sound of another speed than the scanner assumes, as in cold water, does that; scan in "
            "a bath with the speed of sound of tissue"
        )
    return (
        "the axes differ unlike one another: check that frames are not resampled or cropped to another shape between "
        f"scanner and recording; {UNITS}"
    )
