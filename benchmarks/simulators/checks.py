"""A calibration's scan, and a short sweep on a later day with the same probe, whose marker may have been knocked.

NumPy and SciPy alone: what judges an estimator shares nothing with it.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.trust_faults import correlated, shaken
from benchmarks.simulators.trust_scans import (
    FRAMES_PER_S,
    NEEDLE_MM,
    Array,
    Scan,
    a_motion,
    corners_of,
    mapped,
    noisy,
    recorded,
    rigid,
)

KINDS = ("needle", "thread", "phantom")
SIGMA_PX, SIGMA_MM = 1.0, 0.4
# Of the tracker and the hand: an error that neighbouring frames share, forgotten within so many frames.
SHARED_MM, MEMORY_FRAMES = 0.2, 5.0


def first_day(seed: int, frames: int = 300) -> Scan:
    """The scan of a needle that the calibration was made of."""
    motion = a_motion(np.random.default_rng([seed, 11]), 2)
    scan = recorded(motion, np.arange(frames) / FRAMES_PER_S)
    return _with_noise(scan, np.random.default_rng([seed, 12]))


def later(
    seed: int, truth: Array, kind: str = "needle", seconds: float = 10.0, *, still_probe: bool = False
) -> Scan:
    """A sweep on a later day.

    Args:
        seed: of everything random.
        truth: (4, 4): the map of that day.
        kind: one of `KINDS`: a tracked needle, or one thread or six wires fixed in the room.
        seconds: of the sweep.
        still_probe: the probe is moved along itself only, and not turned: a sweep that tells little.
    """
    rng = np.random.default_rng([seed, 13])
    time = np.arange(round(seconds * FRAMES_PER_S)) / FRAMES_PER_S
    if kind == "needle":
        tilt = 0.02 if still_probe else 0.7
        motion = dataclasses.replace(a_motion(rng, 2, tilt=tilt), truth=truth)
        return _with_noise(recorded(motion, time), rng)
    return _with_noise(_fixed(rng, truth, time, 1 if kind == "thread" else 6, turns=not still_probe), rng)


def knock(rng: np.random.Generator, shift_mm: float = 0.0, turn_deg: float = 0.0) -> Array:
    """(4, 4): a marker that was pushed and turned, whichever way."""
    ways = rng.normal(size=(2, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    return rigid(np.radians(turn_deg) * ways[:1], shift_mm * ways[1:])[0]


def _fixed(rng: np.random.Generator, truth: Array, time: Array, count: int, *, turns: bool) -> Scan:
    """Lines fixed in the tracker's frame; a row for each that an image shows."""
    scale = float(np.linalg.norm(truth[:3, 0]))
    place = np.column_stack([rng.uniform(150, 350, (count, 2)), np.zeros(count)])
    along = np.column_stack([rng.uniform(-0.5, 0.5, (count, 2)), np.ones(count)])
    path = a_motion(rng, 2).probe  # six smooth functions of time
    poses = path(time)
    turn = Rotation.from_matrix(poses[:, :3, :3]) * Rotation.from_matrix(poses[0, :3, :3]).inv()
    vectors = turn.as_rotvec() if turns else np.zeros((len(time), 3))
    turn_of = Rotation.from_rotvec(vectors).as_matrix()
    shift = (poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0)) / scale
    centre = np.array([250.0, 250.0, 0.0])
    start = np.einsum("fij,wj->fwi", turn_of, place - centre) + shift[:, None] + centre
    step = np.einsum("fij,wj->fwi", turn_of, along)
    seen = start - step * (start[..., 2] / step[..., 2])[..., None]
    frame, wire = np.nonzero(np.all((seen[..., :2] > 0) & (seen[..., :2] < 499), axis=-1))
    half = NEEDLE_MM / 2 / scale
    ends = np.stack([place - half * along, place + half * along], axis=1)
    # The tracker's frame is the middle image's marker's.
    image = np.tile(np.eye(4), (len(time), 1, 1))
    image[:, :3, :3] = turn_of
    image[:, :3, 3] = shift + centre - turn_of @ centre
    probe = truth @ np.linalg.inv(image) @ np.linalg.inv(truth)
    return Scan(
        time_s=time[frame],
        points_px=seen[frame, wire][:, None, :2],
        ends_mm=mapped(truth, ends)[wire],
        tracker_from_probe=probe[frame],
        truth=truth,
        corners_px=corners_of(2),
        frame=frame,
        target=np.array([f"wire {i}" for i in range(count)])[wire],
    )


def _with_noise(scan: Scan, rng: np.random.Generator) -> Scan:
    """White noise on points and ends, and what neighbouring frames share."""
    frames = np.arange(len(scan.time_s)) if scan.frame is None else scan.frame
    shift = SHARED_MM * correlated(rng, int(frames.max()) + 1, MEMORY_FRAMES, 3)[frames]
    return noisy(shaken(scan, np.zeros_like(shift), shift), rng, SIGMA_PX, SIGMA_MM)
