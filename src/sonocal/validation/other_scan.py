"""Another scan than the one that was fitted: by itself it may be sound, and differ in what a depth setting changes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.calibration import Calibration, calibrate
from sonocal.calibration.models import scale_known
from sonocal.errors import SonocalError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.validation.turns import turned_deg

__all__ = ["other_scale", "sound_alone"]

# Of a scan's rows: so many agree on a calibration of it alone where its lines are in one frame with its images.
AGREE = 0.6
# Of mm/px, as a share: less is no other setting of the depth. Turned by more, it is not the scale alone.
UNEQUAL, TURNED_DEG = 0.01, 5.0


def sound_alone(calibration: Calibration, rows: Observations) -> Calibration | None:
    """The calibration of another scan by itself, where most of its rows agree on one; else None."""
    try:
        own = calibrate(rows, model="anisotropic" if calibration.model == "anisotropic" else "similarity")
    except SonocalError:
        return None
    return own if own.fit.inliers >= AGREE * own.fit.observations else None


def other_scale(calibration: Calibration, own: Calibration) -> Iterator[Diagnostic]:
    """Another scan whose mm/px differ, and whose axes do not."""
    first, second = calibration.probe_from_image, own.probe_from_image
    d = calibration.dimension
    scales, share = _of_its_rows(calibration)
    ratios = second.scales[:d] / scales - 1.0
    ratio = float(ratios[np.argmax(np.abs(ratios))])
    known = np.hypot(share, scale_known(own))
    if not abs(ratio) > max(UNEQUAL, known) or not turned_deg(first.rotation, second.rotation) < TURNED_DEG:
        return
    yield Diagnostic(
        code="other-depth-setting",
        severity="warning",
        message=(
            f"this scan is of another depth setting: by itself it has {second.scales[0]:.5f} mm/px and the calibration "
            f"{scales[0]:.5f}, they differ by {100 * ratio:+.1f} %, and {own.fit.inliers} of "
            f"{own.fit.observations} rows agree on that"
        ),
        advice="calibrate for each depth setting, or set the scanner back; images may have been resampled, too",
    )


def _of_its_rows(calibration: Calibration) -> tuple[Array, float]:
    """(d,): mm/px of the rows that were fitted, and to what share they are known (95 %).

    Of a known scale that they contradict it is their own: another scan at the same depth has that one, too.
    """
    for test in calibration.models:
        if test.narrower == "rigid" and test.contradicts:
            return np.full(calibration.dimension, test.wider_mm_per_px[0]), test.apart_95
    return calibration.probe_from_image.scales[: calibration.dimension], scale_known(calibration)
