"""What area predicted errors are quoted for, in words: the image where its size is known, else what was seen of it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.calibration.result import Calibration
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.observations.outside import outside_findings

__all__ = ["area_findings", "corner_of", "expected_errors", "in_mm"]

# Of the image's side, or of the longest side seen: ten points anywhere in an image span four fifths of it and more.
BAND = 0.1
# No error is told to be less.
LEAST_MM = 1e-4


def expected_errors(calibration: Calibration, below: Array) -> str:
    """What error to expect and where, in a sentence or two.

    Args:
        calibration: with a covariance.
        below: its `predicted_errors` that 95 % stay below, mm.
    """
    worst, centre = float(below[:-1].max()), float(below[-1])
    up_to = f"Expect errors of the calibration up to {in_mm(worst)} mm"
    if calibration.area_is_image:
        return f"{up_to} at the image's corners and {in_mm(centre)} mm at its centre (95 %)."
    growth = 100 * calibration.error_growth_mm_per_px()
    return (
        f"{up_to} at the corners of the area seen, {_size(calibration.area_px)} px, and {in_mm(centre)} mm at its "
        f"centre (95 %). The image's size is not known: outside of that area errors grow by up to {growth:.2g} mm a "
        "100 px."
    )


def in_mm(error: float) -> str:
    """A predicted error in words' digits: two that count below 1 and from 100 mm on; never 0, which no error is."""
    if error >= 100:
        return f"{float(f'{error:.2g}'):.0f}"
    return f"{error:.1f}" if error >= 0.995 else f"{max(error, LEAST_MM):.2g}"


def corner_of(area_name: str) -> str:
    """One of the corners, for messages; of an image whose size is not known nothing is said."""
    return "an image corner" if area_name == "image" else f"a corner of the {area_name}"


def area_findings(calibration: Calibration, points_px: Array) -> Iterator[Diagnostic]:
    """Points outside of the image; and an area seen that is a band: what the image is beyond it is a guess.

    Args:
        calibration: of which the image is asked.
        points_px: (N, d), of the rows that agree.
    """
    yield from outside_findings(points_px, calibration.image_size_px)
    seen = calibration.seen_px
    if seen is None:
        return
    sides = np.ptp(seen, axis=0)
    whole = (
        np.ptp(calibration.area_px, axis=0) if calibration.area_is_image else np.full(len(sides), sides.max())
    )
    if not np.any(sides < BAND * whole):
        return
    of = f" of the image's {_size(calibration.area_px)}" if calibration.area_is_image else ""
    yield Diagnostic(
        code="narrow-area",
        severity="warning",
        message=(
            f"the area seen is a band of {_size(seen)}{of} px, and nothing beyond it was seen: errors there are a guess"
        ),
        advice="add sightings all over the image, above all near its corners"
        + ("" if calibration.area_is_image else ", and give its size with --image-size"),
    )


def _size(area_px: Array) -> str:
    return " x ".join(f"{side:.0f}" for side in np.ptp(area_px, axis=0) + 1)
