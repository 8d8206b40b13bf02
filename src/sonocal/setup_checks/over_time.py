"""Did the marker slip during the scan, and do image and tracker belong to the same instant?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration
from sonocal.calibration.diagnostics import NORMAL_95
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, homogeneous_points, segment_directions
from sonocal.observations import Observations, group_codes
from sonocal.registration.noise import residual_vectors, stretch_length
from sonocal.registration.uncertainty import point_jacobian

__all__ = ["check_latency", "check_slip"]

FEWEST_FRAMES = 16
# A slip throws half of the rows out of the fit: they are looked at up to this many times its threshold.
GENEROUS = 4.0
# Moments of the slip that are tried, and orders of the frames that chance is measured by.
SPLITS, ORDERS = 24, 399
LEAST_SLIP_MM = 1.0
# A slip taken away leaves most rows nearer to their lines, which a few outliers cannot feign.
LEAST_SHRINKING = 0.1
DRIFTING_FRAMES = 3
BLOCKS = 12
LATENCY_SIGNIFICANT = 4.0
LEAST_LAG_MM = 0.3


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows that take part, with their residuals across the line and what the calibration's motions do to them."""

    rows: Observations
    frame: NDArray[np.int64]
    residuals: Array
    jacobian: Array
    mapped: Array


def _rows(calibration: Calibration, observations: Observations) -> _Rows | None:
    threshold = float(calibration.provenance.get("options", {}).get("threshold_mm", np.inf))
    points = homogeneous_points(observations.points_px)
    away = residual_vectors(calibration.probe_from_image, points, observations.segments_mm)
    chosen = observations.select(np.linalg.norm(away, axis=1) <= GENEROUS * threshold)
    frame = group_codes(chosen.split, chosen.frame)
    if not len(chosen) or frame.max() + 1 < FEWEST_FRAMES:
        return None
    points = homogeneous_points(chosen.points_px)
    directions = segment_directions(chosen.segments_mm)
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    parameters = 7 + (calibration.model == "anisotropic")
    return _Rows(
        rows=chosen,
        frame=frame,
        residuals=residual_vectors(calibration.probe_from_image, points, chosen.segments_mm),
        jacobian=across @ point_jacobian(calibration.probe_from_image, points, parameters),
        mapped=calibration.probe_from_image @ points,
    )


def check_slip(
    calibration: Calibration, observations: Observations, *, seed: int = 0
) -> Iterator[Diagnostic]:
    """Did the marker move on the probe at some moment of the scan?

    After it, all lines are off by one rigid motion. For each of some moments the squares that such a motion
    explains, after the fit has taken its part, are compared with those of the same frames in random order: this
    allows for outliers, for errors that rows of a frame share, and for the choice of the best moment. What
    follows the needle's speed is taken off first: it is a latency's, and has its own order in time.

    Source: permutation test of a change point (Antoch and Huskova 2001).
    """
    taking_part = _rows(calibration, observations)
    if taking_part is None:
        return
    taking_part = _without_latency(taking_part)
    information, pull = _by_frame(taking_part)
    frames = len(pull)
    splits = np.unique(np.linspace(0.15 * frames, 0.85 * frames, SPLITS).astype(int))
    rng = np.random.default_rng(seed)
    orders = np.array([np.arange(frames), *(rng.permutation(frames) for _ in range(ORDERS))])
    explained = _explained(information, pull, orders, splits)  # (orders, splits)
    best = int(np.argmax(explained[0]))
    if np.any(explained[1:].max(axis=1) >= explained[0, best]):
        return
    moved, share, drifts = _step(calibration, taking_part, int(splits[best]))
    if drifts or moved < LEAST_SLIP_MM or share < LEAST_SHRINKING:
        return
    number = taking_part.rows.frame[taking_part.frame == splits[best]][0]
    yield Diagnostic(
        code="marker-slipped",
        severity="warning",
        message=(
            f"from about frame {number} on, all lines are off by one motion of {moved:.1f} mm, without which "
            f"the middle residual is {100 * share:.0f} % smaller"
        ),
        advice="fix the marker to the probe and scan again, or fit the frames before that one alone",
    )


def _by_frame(taking_part: _Rows) -> tuple[Array, Array]:
    """J'J (F, k, k) and J'r (F, k) of each frame."""
    frames, k = int(taking_part.frame.max()) + 1, taking_part.jacobian.shape[2]
    information, pull = np.zeros((frames, k, k)), np.zeros((frames, k))
    j = taking_part.jacobian
    np.add.at(information, taking_part.frame, np.swapaxes(j, 1, 2) @ j)
    np.add.at(pull, taking_part.frame, np.einsum("nik,ni->nk", j, taking_part.residuals))
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("fkk->k", information), np.finfo(float).tiny))
    return information * scale[:, None] * scale, pull * scale


def _explained(
    information: Array, pull: Array, orders: NDArray[np.int64], splits: NDArray[np.int64]
) -> Array:
    """Squares that a rigid step explains beyond the fit: g' (N - N H N)^-1 g over the frames after the split."""
    total, total_pull = information.sum(axis=0), pull.sum(axis=0)
    taken = np.linalg.pinv(total, rcond=1e-10)
    after_n = total - np.cumsum(information[orders], axis=1)[:, splits - 1]
    after_g = total_pull - np.cumsum(pull[orders], axis=1)[:, splits - 1]
    g = (after_g - after_n @ taken @ total_pull)[..., :6]
    left = (after_n - after_n @ taken @ after_n)[..., :6, :6]
    ridge = 1e-9 * np.trace(left, axis1=-2, axis2=-1)[..., None, None] * np.eye(6)
    return np.asarray(np.sum(g * np.linalg.solve(left + ridge, g[..., None])[..., 0], axis=-1))


def _step(calibration: Calibration, taking_part: _Rows, split: int) -> tuple[float, float, bool]:
    """The best rigid step at a split.

    Returns:
        How far, rms, it moves the places seen; by what share the median residual falls; whether neighbouring
        frames still repeat one another without it, as they do in a drift and not after a slip.
    """
    j, r = taking_part.jacobian, taking_part.residuals
    k = j.shape[2]
    late = (taking_part.frame >= split)[:, None, None]
    columns = np.concatenate([j, np.where(late, j[:, :, :6], 0.0)], axis=2).reshape(-1, k + 6)
    scale = 1.0 / np.linalg.norm(columns, axis=0)

    def solved(count: int) -> tuple[Array, Array]:
        part = columns[:, :count] * scale[:count]
        solution = np.linalg.lstsq(part, r.reshape(-1), rcond=1e-6)[0]
        return solution * scale[:count], (r.reshape(-1) - part @ solution).reshape(-1, 3)

    before, (solution, after) = solved(k)[1], solved(k + 6)
    moved = (
        point_jacobian(calibration.probe_from_image, taking_part.rows.points_px, k)[..., :6] @ solution[k:]
    )
    lengths = [stretch_length(left, taking_part.frame) for left in (before, after)]
    medians = [float(np.median(np.linalg.norm(left, axis=1))) for left in (before, after)]
    return (
        float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))),
        1.0 - medians[1] / max(medians[0], np.finfo(float).tiny),
        lengths[1] > max(DRIFTING_FRAMES, lengths[0] / 2),
    )


def check_latency(calibration: Calibration, observations: Observations) -> Iterator[Diagnostic]:
    """Do residuals follow the needle's speed, as they do when image and tracker are not of one instant?

        r_i = J_i d + latency P_i v_i        v_i: the needle's velocity in the probe's frame where it was seen

    Time is the extra column ``time_s`` where there is one, else the frame's number. The deviation is that of
    the estimate over stretches of the scan left out in turn, because residuals of neighbours go together.
    """
    taking_part = _rows(calibration, observations)
    if taking_part is None:
        return
    time, unit = _time(taking_part.rows)
    velocity, usable = _velocities(taking_part, time)
    if usable.sum() < FEWEST_FRAMES:
        return
    latency, deviation, speed = _latency(taking_part, velocity, usable)
    if not (abs(latency) > LATENCY_SIGNIFICANT * deviation and abs(latency) * speed > LEAST_LAG_MM):
        return
    late, factor, name = (
        ("tracker" if latency > 0 else "image"),
        *((1e3, "ms") if unit == "s" else (1.0, "frames")),
    )
    yield Diagnostic(
        code="latency",
        severity="warning",
        message=(
            f"residuals follow the needle's speed: the {late} is late by {abs(latency) * factor:.3g} {name} "
            f"(+-{NORMAL_95 * deviation * factor:.2g}), which moves the needle by {abs(latency) * speed:.1f} mm at its "
            f"usual speed of {speed:.0f} mm/{unit.removesuffix('s') or 's'}"
        ),
        advice=f"shift the {late}'s stamps by that much, or scan slowly and hold still for each frame",
    )


def _without_latency(taking_part: _Rows) -> _Rows:
    """The rows with what a latency explains of their residuals taken off."""
    velocity, usable = _velocities(taking_part, _time(taking_part.rows)[0])
    if usable.sum() < FEWEST_FRAMES:
        return taking_part
    latency = _latency(taking_part, velocity, usable)[0]
    return replace(taking_part, residuals=taking_part.residuals - latency * velocity)


def _time(rows: Observations) -> tuple[Array, str]:
    if "time_s" in rows.extra:
        try:
            time = np.array([float(cell) for cell in rows.extra["time_s"]])
        except ValueError:
            time = np.full(len(rows), np.nan)
        if np.all(np.isfinite(time)):
            return time, "s"
    return rows.frame.astype(float), "frames"


def _velocities(taking_part: _Rows, time: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Velocity (N, 3) across the line of the needle's point that was seen, from the sightings before and after."""
    rows = taking_part.rows
    directions = segment_directions(rows.segments_mm)
    lengths = np.linalg.norm(rows.segments_mm[:, 1] - rows.segments_mm[:, 0], axis=1)
    share = np.sum((taking_part.mapped - rows.segments_mm[:, 0]) * directions, axis=1) / lengths
    velocity, usable = np.zeros((len(rows), 3)), np.zeros(len(rows), dtype=bool)
    tracks = group_codes(rows.split, rows.target)
    for track in range(int(tracks.max()) + 1):
        index = np.flatnonzero(tracks == track)
        index = index[np.argsort(time[index], kind="stable")]
        index = index[np.concatenate([[True], np.diff(time[index]) > 0])]
        before, here, after = index[:-2], index[1:-1], index[2:]
        change = (rows.segments_mm[after] - rows.segments_mm[before]) / (time[after] - time[before])[
            :, None, None
        ]
        moved = change[:, 0] + share[here, None] * (change[:, 1] - change[:, 0])
        along = np.sum(moved * directions[here], axis=1, keepdims=True)
        velocity[here], usable[here] = moved - along * directions[here], True
    return velocity, usable


def _latency(taking_part: _Rows, velocity: Array, usable: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Latency, its deviation and the rms speed."""
    k = taking_part.jacobian.shape[2]
    j, r, v = (a[usable] for a in (taking_part.jacobian, taking_part.residuals, velocity))
    blocks = taking_part.frame[usable] * BLOCKS // (int(taking_part.frame.max()) + 1)
    columns = np.concatenate([j, v[:, :, None]], axis=2)
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("nik,nik->k", columns, columns), np.finfo(float).tiny))
    columns = columns * scale
    information = np.array(
        [np.einsum("nik,nil->kl", c, c) for c in (columns[blocks == b] for b in range(BLOCKS))]
    )
    pull = np.array([np.einsum("nik,ni->k", columns[blocks == b], r[blocks == b]) for b in range(BLOCKS)])

    def solved(left_out: int | None) -> float:
        keep = np.arange(BLOCKS) != left_out
        solution = np.linalg.lstsq(information[keep].sum(axis=0), pull[keep].sum(axis=0), rcond=1e-10)[0]
        return float(solution[k] * scale[k])

    folds = np.array([solved(b) for b in range(BLOCKS)])
    deviation = float(np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((folds - folds.mean()) ** 2)))
    return solved(None), deviation, float(np.sqrt(np.mean(np.sum(v**2, axis=1))))
