"""Poses at the times of images, and the lag between the two clocks.

``latency_s > 0``: the tracker's stamps are later than the image's for the same instant, so the pose of an
image taken at ``t`` is the one the tracker stamped ``t + latency_s``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sonocal.errors import DegenerateGeometryError, InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.recording.poses import OnInvalid, Poses

__all__ = [
    "Lag",
    "estimate_latency",
    "interpolate_poses",
    "motion_signal",
]

MAX_GAP_S = 0.2
"""Longest stretch between two poses that is bridged, s: a hand turns a probe by degrees in less."""

GRID_S = 0.001
LEAST_CORRELATION = 0.7
LEAST_OVERLAP = 16


def interpolate_poses(
    poses: Poses,
    times: ArrayLike,
    at: ArrayLike,
    *,
    max_gap_s: float = MAX_GAP_S,
    source: str = "recording",
    on_invalid: OnInvalid = "raise",
) -> Poses:
    """Poses at other times: turns along the shortest arc, moves along the straight line.

    A pose is never made up across an invalid one, a gap longer than `max_gap_s`, or beyond the ends;
    such times get an invalid one. At the recorded times the recorded poses come back to the bit, with their
    statuses where all times are recorded ones.

    Args:
        poses: N of them.
        times: (N,) s, increasing.
        at: (M,) s.
        max_gap_s: longest stretch to bridge.
        source: the recording's name, for messages.
        on_invalid: what to do with poses marked valid that are not rigid.

    Returns:
        M poses.

    Raises:
        InputError: the times do not increase, or a pose is not rigid.
    """
    stamps, wanted = np.asarray(times, dtype=float), np.asarray(at, dtype=float)
    _check_increasing(stamps, source)
    usable = poses.usable(source, on_invalid)
    after = np.clip(np.searchsorted(stamps, wanted, side="left"), 0, len(stamps) - 1)
    if (stamps[after] == wanted).all():  # nothing is between two poses: they keep their statuses, too
        return usable.select(after)
    exact = (stamps[after] == wanted) & usable.valid[after]
    before = np.maximum(after - 1, 0)
    bridged = (
        (stamps[before] < wanted) & (wanted < stamps[after]) & (stamps[after] - stamps[before] <= max_gap_s)
    )
    bridged &= usable.valid[before] & usable.valid[after]
    matrices = np.full((len(wanted), 4, 4), np.nan)
    matrices[exact] = usable.matrices[after[exact]]
    if bridged.any():
        first, second = before[bridged], after[bridged]
        part = (wanted[bridged] - stamps[first]) / (stamps[second] - stamps[first])
        matrices[bridged] = _between(usable.matrices[first], usable.matrices[second], part)
    return Poses(poses.source, poses.target, matrices, exact | bridged)


@dataclass(frozen=True)
class Lag:
    """How much later the tracker stamps an instant than the images do.

    Attributes:
        latency_s: positive where the tracker's stamps are later. PLUS's ``TrackerLagSec`` has the same
            sign; it is negative where a frame grabber delays the images, as most do.
        deviation_s: its standard deviation, from how well the two signals agree.
        correlation: of the aligned signals, 0 to 1.
        samples: image times that took part.
    """

    latency_s: float
    deviation_s: float
    correlation: float
    samples: int

    __repr__ = brief


def estimate_latency(
    image_times: ArrayLike,
    image_signal: ArrayLike,
    tracker_times: ArrayLike,
    tracker_signal: ArrayLike,
    max_lag_s: float = 0.5,
) -> Lag:
    """The lag that aligns two signals of one motion, such as a line's place in the image and the probe's height.

        image(t) = a + b tracker(t + latency)

    The signals may differ in scale, offset and sign.

    Args:
        image_times: (N,) s.
        image_signal: (N,), any unit; NaN where it was not seen.
        tracker_times: (M,) s.
        tracker_signal: (M,), any unit; NaN where it was not seen.
        max_lag_s: largest lag to look for, either way.

    Raises:
        InputError: the recordings hardly overlap.
        DegenerateGeometryError: a signal does not move, or no lag within the range aligns them.
    """
    seen_t, seen = _seen(image_times, image_signal)
    track_t, track = _seen(tracker_times, tracker_signal)
    if len(seen) < LEAST_OVERLAP or len(track) < LEAST_OVERLAP:
        raise InputError(
            f"a lag needs {LEAST_OVERLAP} samples of each signal; got {len(seen)} and {len(track)}"
        )
    # One set of image samples for every lag, or the correlation would jump as samples enter and leave.
    inside = (seen_t - max_lag_s >= track_t[0]) & (seen_t + max_lag_s <= track_t[-1])
    if inside.sum() < LEAST_OVERLAP:
        raise InputError(
            f"images ({seen_t[0]:.3f} to {seen_t[-1]:.3f} s) and poses ({track_t[0]:.3f} to {track_t[-1]:.3f} s) share "
            f"{inside.sum()} samples within +-{max_lag_s:g} s; a lag needs {LEAST_OVERLAP}"
        )
    at, wanted = seen_t[inside], seen[inside]
    if np.std(wanted) == 0 or np.std(track) == 0:
        raise DegenerateGeometryError(
            "a lag needs motion, and one of the two signals is constant", "static-signal"
        )
    steps = round(max_lag_s / GRID_S)
    lags = np.arange(-steps, steps + 1, dtype=np.float64) * np.float64(GRID_S)
    scores = np.array([_correlation(wanted, np.interp(at + lag, track_t, track)) for lag in lags])
    best = int(np.argmax(np.abs(scores)))
    peak = float(abs(scores[best]))
    if peak < LEAST_CORRELATION or best in (0, len(lags) - 1):
        raise DegenerateGeometryError(
            f"no lag within +-{max_lag_s:g} s aligns the two signals (best correlation {peak:.2f}); "
            "move the probe up and down for ten seconds and record again",
            "no-alignment",
        )
    return _refined(lags, scores, best, wanted, np.interp(at + lags[best], track_t, track))


def motion_signal(poses: Poses) -> Array:
    """(N,) mm: the place of a tool along the direction it moves most; NaN where invalid."""
    places = np.where(poses.valid[:, None], poses.matrices[:, :3, 3], np.nan)
    seen = places[poses.valid]
    if len(seen) < 2:
        raise InputError(f"{poses.plus_name}: has {len(seen)} valid poses; a motion needs two or more")
    direction = np.linalg.svd(seen - seen.mean(axis=0), full_matrices=False)[2][0]
    return np.asarray((places - seen.mean(axis=0)) @ direction)


def _between(first: Array, second: Array, part: Array) -> Array:
    from scipy.spatial.transform import Rotation

    start = Rotation.from_matrix(first[:, :3, :3])
    turn = (start.inv() * Rotation.from_matrix(second[:, :3, :3])).as_rotvec()
    matrices = np.tile(np.eye(4), (len(part), 1, 1))
    matrices[:, :3, :3] = (start * Rotation.from_rotvec(part[:, None] * turn)).as_matrix()
    matrices[:, :3, 3] = (1 - part)[:, None] * first[:, :3, 3] + part[:, None] * second[:, :3, 3]
    return matrices


def _check_increasing(times: Array, source: str) -> None:
    if len(times) == 0:
        raise InputError(f"{source}: has no poses to interpolate")
    if np.isnan(times).any():
        raise InputError(f"{source}: has no times, so poses cannot be interpolated; add stamps")
    backwards = np.flatnonzero(np.diff(times) <= 0)
    if len(backwards):
        i = int(backwards[0]) + 1
        raise InputError(
            f"{source}, frame {i}: its stamp {times[i]:.6f} s is not later than the {times[i - 1]:.6f} s before it; "
            "delete or sort such frames"
        )


def _seen(times: ArrayLike, signal: ArrayLike) -> tuple[Array, Array]:
    t, y = np.asarray(times, dtype=float), np.asarray(signal, dtype=float)
    if t.shape != y.shape or t.ndim != 1:
        raise InputError(f"a signal needs one time a sample; got {y.shape} samples and {t.shape} times")
    finite = np.isfinite(t) & np.isfinite(y)
    order = np.argsort(t[finite], kind="stable")
    return t[finite][order], y[finite][order]


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / norm if norm > 0 else 0.0


def _refined(lags: Array, scores: Array, best: int, wanted: Array, aligned: Array) -> Lag:
    """The top of the parabola through the best lag and its neighbours."""
    sign = np.sign(scores[best])
    before, top, after = sign * scores[best - 1 : best + 2]
    curvature = before - 2 * top + after
    shift = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
    # 1 - r^2 is the share of variance that the lag does not explain; its curvature gives the deviation.
    slack = max(1 - top**2, np.finfo(float).eps)
    information = -2 * top * curvature / GRID_S**2 * len(wanted) / (2 * slack)
    deviation = 1 / np.sqrt(information) if information > 0 else float("inf")
    return Lag(float(lags[best] + shift * GRID_S), float(deviation), float(top), len(aligned))
