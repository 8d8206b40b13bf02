"""What no scan of a needle can show, said once with the figure to compare with."""

from __future__ import annotations

import numpy as np

from sonocal.calibration import Calibration
from sonocal.errors import require
from sonocal.geometry import area_places

__all__ = ["CANNOT_SHOW", "cannot_show"]

CANNOT_SHOW = "What these numbers cannot show"


def cannot_show(calibration: Calibration) -> tuple[str, ...]:
    """What fits as well as the truth, each a sentence with what to compare: true of every calibration, no warning."""
    require("calibration", calibration, Calibration)
    return (_orientation(calibration), _shared_offset(), _size(calibration), _speed_of_sound(calibration))


def _orientation(calibration: Calibration) -> str:
    what = "A mirrored or turned image" if calibration.dimension == 2 else "A turned volume"
    options = calibration.options
    told = (
        "the expected orientation that was given"
        if options.expected_rotation is not None
        else "the side that was given"
        if options.marker_above_image
        else ""
    )
    compare = (
        f"it was compared with {told}; compare with the probe, too"
        if told
        else "compare with the probe, or let --marker-above or --expected compare"
    )
    return f"{what} fits as well. By these numbers the marker lies {_marker(calibration)}: {compare}."


def _marker(calibration: Calibration) -> str:
    """Where the marker's origin lies as one sees it with the probe in the hand, from the image."""
    transform = calibration.probe_from_image
    marker = -transform.translation @ transform.rotation  # mm along u, v and their normal
    scales = transform.scales[: calibration.dimension]
    (left, top, *_), (right, bottom, *_) = calibration.area_px * scales
    name = "image" if calibration.area_is_image else "area seen"
    if marker[1] < top:
        height = f"{top - marker[1]:.0f} mm above the top edge of the {name}"
    elif marker[1] > bottom:
        height = f"{marker[1] - bottom:.0f} mm below the bottom edge of the {name}"
    else:
        height = f"beside the {name}, {marker[1] - top:.0f} mm below its top edge"
    aside = marker[0] - (left + right) / 2
    depth = marker[2] - (area_places(calibration.area_px)[-1] * scales)[2] if len(scales) == 3 else marker[2]
    normal = "w" if len(scales) == 3 else "its normal (u x v)"
    return (
        f"{height}, {abs(aside):.0f} mm to the {'right' if aside >= 0 else 'left'} of its middle and "
        f"{abs(depth):.0f} mm {'along' if depth >= 0 else 'against'} {normal}"
    )


def _shared_offset() -> str:
    return (
        "An error that all rows share (where the needle is in its marker, how the probe's marker is defined) leaves no "
        "trace in residuals: compare with a point whose place is known otherwise, with validate --crosswire."
    )


def _speed_of_sound(calibration: Calibration) -> str:
    # Water: Del Grosso and Mader 1972. What is left in a curved probe's residuals: docs/trust.md.
    if (sound := calibration.sound) is not None:
        who = "by the rows" if sound.estimated else "as given"
        return (
            f"Places were corrected for sound of {sound.speed_m_s:.0f} m/s {who}: compare with the bath's temperature "
            f"(water of 20 degrees C: 1482). The calibration is for images in which it runs at {sound.assumed_m_s:.0f}."
        )
    return (
        "Scanners take sound for 1540 m/s fast; in water of 20 degrees C it is 1482, and depths are shown 3.9 % too "
        "large. A curved probe's fit takes most of that up as a shift and a scale: mind the bath's temperature, or say "
        "the probe's radius and the speed with --probe-radius-mm and --sound-speed."
    )


def _size(calibration: Calibration) -> str:
    scales = calibration.probe_from_image.scales[: calibration.dimension]
    sides = (np.ptp(calibration.area_px, axis=0) + 1) * scales
    own = calibration.scales_mm_per_px
    along = [f"{scale:.4f} ({axis})" for scale, axis in zip(own, "uvw", strict=False)]
    per_px = f"{own[0]:.4f}" if len(own) == 1 else " and ".join(along)
    return (
        f"Lengths are as right as the tracker's and the needle's: {per_px} mm/px make the {calibration.area_name} "
        f"{' x '.join(f'{side:.0f}' for side in sides)} mm; compare with the depth and the ruler on the scanner."
    )
