"""What only poses can show: a needle that is off by one offset in the tracker's frame, whatever the probe does."""

from __future__ import annotations

import numpy as np

from sonocal.calibration import Calibration, point_line_rows
from sonocal.calibration.widened import widened
from sonocal.errors import InputError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, area_places
from sonocal.observations import Observations
from sonocal.recording import Recording
from sonocal.registration.fixed_offset import FixedOffset, fixed_offset
from sonocal.registration.mapped import MappedRows
from sonocal.registration.uncertainty import point_jacobian
from sonocal.sweep.tabulate import Posing

__all__ = ["probe_from_tracker", "with_tracker_offset"]

TRACKER = "Tracker"
# Once in two thousand sound recordings; and what is no matter in practice.
SURE, LEAST_MM = 5e-4, 0.1


def with_tracker_offset(
    calibration: Calibration,
    rows: Observations,
    recording: Recording,
    posing: Posing,
) -> Calibration:
    """The calibration, wider and with a finding where the needle is off by one offset in the tracker's frame.

    A needle that hangs through, or a tracker whose volume is off between its two markers, errs by what stays where it
    is while the probe turns. A table of lines in the probe's frame does not know where that is; a recording does.

    Args:
        calibration: of the rows.
        rows: as it was fitted to them.
        recording: whose items are the rows' frames.
        posing: which tool the probe's marker is, and what is fixed beside the recording's poses.
    """
    poses = probe_from_tracker(recording, posing)
    if poses is None or calibration.covariance is None:
        return calibration
    each = poses[rows.frame, :3, :3]
    known = calibration.inlier & np.isfinite(each).all(axis=(1, 2))
    mapped = MappedRows(calibration.probe_from_image, point_line_rows(rows))
    found = fixed_offset(mapped, known, each, len(calibration.covariance))
    if found is None or found.p_value > SURE or np.linalg.norm(found.offset_mm) < LEAST_MM:
        return calibration
    wider = calibration.covariance + np.outer(found.moved, found.moved)
    return widened(calibration, wider, rows, [_finding(calibration, found)])


def probe_from_tracker(recording: Recording, posing: Posing) -> Array | None:
    """(N, 4, 4), NaN without a pose; None where the recording has no pose of the probe in another frame."""
    own = (poses.target for poses in recording.poses.values() if poses.source.lower() == posing.probe.lower())
    for frame in (TRACKER, *own):
        try:
            poses = recording.between(posing.probe, frame, posing.fixed, posing.on_invalid)
        except InputError:
            continue
        return poses.matrices
    return None


def _finding(calibration: Calibration, found: FixedOffset) -> Diagnostic:
    places = area_places(calibration.area_px)
    jacobian = point_jacobian(calibration.probe_from_image, places, len(found.moved))
    moved = float(np.linalg.norm(jacobian @ found.moved, axis=1).max())
    x, y, z = found.offset_mm
    return Diagnostic(
        code="offset-in-tracker",
        severity="warning",
        message=(
            f"the residuals show one offset of {np.linalg.norm(found.offset_mm):.2f} mm (+-{found.deviation_mm:.2f}) "
            f"that stays in the tracker's frame, ({x:.2f}, {y:.2f}, {z:.2f}) mm: with it the calibration moves by up "
            f"to {moved:.2f} mm in the image, which the predicted error counts"
        ),
        advice=(
            "look for a needle that bends under its weight, and calibrate its tip anew in the middle of the tracker's "
            "volume; hold the probe in more directions, so that the offset averages out"
        ),
    )
