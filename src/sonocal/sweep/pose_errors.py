"""What only poses can show: an offset in the tracker's frame, and errors that neighbours in pose share."""

from __future__ import annotations

import numpy as np

from sonocal.calibration import Calibration, point_line_rows
from sonocal.calibration.groupings import groupings_of
from sonocal.calibration.widened import widened
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, area_places
from sonocal.observations import Observations
from sonocal.recording import Recording
from sonocal.registration.mapped import MappedRows
from sonocal.registration.noise import Noise
from sonocal.registration.smooth_error import SmoothError, smooth_error
from sonocal.registration.uncertainty import point_jacobian
from sonocal.sweep.tabulate import Posing
from sonocal.sweep.tracker_offset import probe_from_tracker, with_tracker_offset

__all__ = ["with_pose_errors"]

# Twice the logarithm of how much likelier a smooth error must make the residuals to be counted (of sound recordings 3
# in a hundred reach it, and widen by a few per cent), and to be told (1 in 2350).
LEAST_GAIN, SURE_GAIN = 5.0, 12.0
# A predicted error that grows by more than this is explained, however unsure the smooth error is.
GROWN = 2.0
# Errors of rows below this are none, and a drift is never infinitely many times as large.
TINY_MM = 1e-6


def with_pose_errors(
    calibration: Calibration, rows: Observations, recording: Recording, posing: Posing
) -> Calibration:
    """The calibration, wider and with findings where poses show errors that a table alone cannot.

    An electromagnetic field bent by metal, a needle that bends, a marker that is seen askew: what is wrong is alike
    where things are alike, whenever that was. Of this and one offset in the tracker's frame (`with_tracker_offset`) the
    one that does more counts, for either may be the other's doing.

    Args:
        calibration: of the rows.
        rows: as it was fitted to them.
        recording: whose items are the rows' frames.
        posing: which tool the probe's marker is, and what is fixed beside the recording's poses.
    """
    offset = with_tracker_offset(calibration, rows, recording, posing)
    found = _smooth(calibration, rows, recording, posing)
    if found is None or found.gain < LEAST_GAIN:
        return offset
    assert calibration.covariance is not None and offset.covariance is not None
    wider = calibration.covariance + found.covariance
    grown = _most_mm(calibration, wider) / _most_mm(calibration, calibration.covariance)
    told = [_finding(calibration, found)] if found.gain > SURE_GAIN or grown > GROWN else []
    if _most_mm(calibration, wider) < _most_mm(calibration, offset.covariance):
        return offset.with_findings(told)
    return widened(offset, wider, rows, told)


def _smooth(
    calibration: Calibration, rows: Observations, recording: Recording, posing: Posing
) -> SmoothError | None:
    """What the residuals say of a smooth error, beside a drift that the calibration knows of."""
    poses = probe_from_tracker(recording, posing)
    if poses is None or calibration.covariance is None:
        return None
    each = poses[rows.frame]
    known = calibration.inlier & np.isfinite(each).all(axis=(1, 2))
    table = point_line_rows(rows)
    return smooth_error(
        MappedRows(calibration.probe_from_image, table),
        known,
        _places(each, rows.segments_mm),
        each[:, :3, :3],
        len(calibration.covariance),
        drift=_drift(calibration.noise, groupings_of(table, rows).time),
    )


def _drift(noise: Noise, time: Array) -> tuple[Array, float, float] | None:
    """The drift that the calibration knows of: when rows (N,) were, its memory, its size beside the rows' own."""
    if noise.drift is None:
        return None
    return time, noise.drift.memory_frames, noise.shared_mm["stretch"] / max(noise.row_mm, TINY_MM)


def _places(probe_from_tracker: Array, segments_mm: Array) -> Array:
    """(N, 9), mm: where the line's ends and the probe's marker are in the tracker's frame."""
    turned, moved = probe_from_tracker[:, :3, :3], probe_from_tracker[:, None, :3, 3]
    corners = np.concatenate([segments_mm, np.zeros_like(segments_mm[:, :1])], axis=1)
    return np.asarray(((corners - moved) @ turned).reshape(len(corners), -1))


def _most_mm(calibration: Calibration, covariance: Array) -> float:
    """Standard deviation of a place of the image, where it is the largest."""
    jacobian = point_jacobian(calibration.probe_from_image, area_places(calibration.area_px), len(covariance))
    return float(np.sqrt(np.einsum("nij,jk,nik->n", jacobian, covariance, jacobian).max()))


def _finding(calibration: Calibration, found: SmoothError) -> Diagnostic:
    moved, sure = 1.96 * _most_mm(calibration, found.covariance), found.gain > SURE_GAIN
    share = "share" if sure else "may share"
    return Diagnostic(
        code="error-follows-pose",
        severity="warning" if sure else "info",
        message=(
            f"images near in pose {share} an error of {found.sigma_mm:.2f} mm beside the {found.own_mm:.2f} mm of "
            f"single rows, whenever they were taken; it may move the calibration by up to {moved:.2f} mm (95 %) in the "
            "image, which the predicted error counts"
        ),
        advice=(
            "look for metal near an electromagnetic tracker, a needle that bends, or a marker seen askew; scan in the "
            "middle of the tracker's volume, and hold probe and needle in more ways"
        ),
    )
