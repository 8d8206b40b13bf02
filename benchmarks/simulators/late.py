"""Scans by a hand that a tracker follows late, as tables and as recordings; nothing here is the estimator's."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.detection import Detections
from sonocal.recording import Poses, Recording
from sonocal.targets import Line

SCALE = 0.2
IMAGE = 500.0
NEEDLE_MM = 300.0
NEEDLE = Line("needle", "Needle", np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -NEEDLE_MM]]))

HANDS = ("fast", "slow", "still")
"""Fast: some 120 mm/s; slow: some 30; still: held for most of a second, then moved on within half a second."""

SWINGS_HZ = {"fast": (0.2, 1.0), "slow": (0.05, 0.25), "usual": (0.05, 0.36)}
"""Of the hands that never rest; usual: some 45 mm/s."""


@dataclasses.dataclass
class Late:
    """One scan.

    Attributes:
        observations: the table, with ``time_s``.
        recording: the same as poses of probe and needle.
        detections: the same as points in its images.
        truth: mm in the probe marker's frame from px.
        speed_mm_s: rms, of the needle in the image.
        velocities: (N, 2, 3), mm/s, of the table's segments, without noise.
    """

    observations: sc.Observations
    recording: Recording
    detections: Detections
    truth: sc.Similarity
    speed_mm_s: float
    velocities: np.ndarray


def hand(rng, count, seconds, hands):
    """Smooth random functions (count) of time, mostly between -1 and 1."""
    if hands == "still":
        starts = np.cumsum(rng.uniform(0.9, 1.5, int(seconds / 0.9) + 6)) - 3.0
        knots = np.sort(np.concatenate([starts, starts + rng.uniform(0.3, 0.5, len(starts))]))
        places = np.repeat(rng.uniform(-1, 1, (len(starts) + 1, count)), 2, axis=0)[1 : len(knots) + 1]
        return PchipInterpolator(knots, places)
    low, high = SWINGS_HZ[hands]
    frequency = rng.uniform(low, high, (5, count)) * 2 * np.pi
    phase = rng.uniform(0, 2 * np.pi, (5, count))
    return lambda time: np.sin(np.asarray(time)[:, None, None] * frequency + phase).mean(axis=1) * 1.6


def tracking_noise(rng, shape, sigma, memory):
    """AR(1) along the first axis: independent where memory is 0, drifting where it is near 1."""
    noise = rng.normal(size=shape)
    for i in range(1, len(noise)):
        noise[i] = memory * noise[i - 1] + np.sqrt(1 - memory**2) * noise[i]
    return sigma * noise


def late_scan(
    seed,
    hands="fast",
    latency_s=0.0,
    *,
    change_s=0.0,
    dimension=2,
    frames=120,
    rate_hz=20.0,
    jitter_s=0.0,
    sigma_px=1.0,
    sigma_mm=0.4,
    memory=0.0,
    outliers=0.03,
):
    """A needle moved through the image of a probe that moves as well.

    Args:
        seed: of everything random.
        hands: one of `HANDS`, or "usual".
        latency_s: how much later the tracker stamps an instant than the images do.
        change_s: how much later that is at the end than at the begin.
        dimension: 2 or 3, of the image.
        frames: images.
        rate_hz: images a second.
        jitter_s: of the stamps, which are true.
        sigma_px: noise of a point along each axis.
        sigma_mm: noise of the needle's ends along each axis.
        memory: of that noise from one frame to the next, 0 to 1.
        outliers: share of the images that show something else.
    """
    rng = np.random.default_rng([seed, frames, dimension, (*HANDS, "usual").index(hands)])
    stamps = np.arange(frames) / rate_hz + rng.uniform(-jitter_s, jitter_s, frames)
    seconds = frames / rate_hz
    place, tilt, depth, probe = (hand(rng, n, seconds, hands) for n in (dimension, 2, 1, 6))
    rotation = Rotation.random(random_state=rng)
    truth = sc.Similarity(rotation.as_matrix(), rng.uniform(-80, 80, 3), SCALE)

    def needle(time):
        """Its ends in the image's axes, mm, and what the image sees of it, px."""
        crossing = np.zeros((len(time), 3))
        crossing[:, :dimension] = (np.clip(place(time), -0.98, 0.98) + 1) / 2 * IMAGE * SCALE
        along = np.column_stack([0.8 * tilt(time), np.ones(len(time))])
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        before = NEEDLE_MM * (0.5 + 0.2 * depth(time))
        ends = np.stack([crossing - before * along, crossing + (NEEDLE_MM - before) * along], axis=1)
        return ends, (
            crossing[:, None] + np.array([0.0, 30.0])[: dimension - 1, None] * along[:, None]
        ) / SCALE

    then = stamps - latency_s - change_s * (stamps / seconds - 0.5)
    ends = truth @ (needle(then)[0] / SCALE)
    velocities = (truth @ (needle(then + 1e-4)[0] / SCALE) - ends) / 1e-4
    ends = ends + tracking_noise(rng, ends.shape, sigma_mm, memory)
    moved = probe(then)
    tracker_from_probe = np.tile(np.eye(4), (frames, 1, 1))
    turn = Rotation.from_rotvec(0.4 * moved[:, :3]) * Rotation.from_rotvec(rng.normal(size=3))
    tracker_from_probe[:, :3, :3] = turn.as_matrix()
    tracker_from_probe[:, :3, 3] = 40 * moved[:, 3:] + rng.uniform(-300, 300, 3)
    tracker_from_needle = tracker_from_probe @ pose_of(ends, rng.uniform(0, 6.3))

    seen = needle(stamps)[1]
    points = seen[..., :dimension] + sigma_px * rng.normal(size=(frames, dimension - 1, dimension))
    wrong = rng.random(frames) < outliers
    points[wrong] = rng.uniform(0, IMAGE, (wrong.sum(), dimension - 1, dimension))
    frame = np.repeat(np.arange(frames), dimension - 1)
    observations = sc.Observations(
        points.reshape(-1, dimension),
        segments_of(tracker_from_probe, tracker_from_needle)[frame],
        frame=frame,
        extra={"time_s": stamps[frame].astype(str)},
        source="scan",
    )
    poses = [
        Poses.of(name, "Tracker", matrices)
        for name, matrices in (("Probe", tracker_from_probe), ("Needle", tracker_from_needle))
    ]
    recording = Recording(times=stamps, poses={one.name: one for one in poses})
    detections = Detections(np.arange(frames), points, source="points")
    speed = np.diff(needle(np.arange(0, seconds, 0.01))[1][:, 0] * SCALE, axis=0) / 0.01
    rms = float(np.sqrt((speed**2).sum(axis=1).mean()))
    return Late(observations, recording, detections, truth, rms, velocities[frame])


def pose_of(ends, roll):
    """(N, 4, 4): the first end at the origin, the needle along -z."""
    z = ends[:, 0] - ends[:, 1]
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    x = np.cross([np.cos(roll), np.sin(roll), 0.1], z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    poses = np.tile(np.eye(4), (len(ends), 1, 1))
    poses[:, :3, :3] = np.stack([x, np.cross(z, x), z], axis=-1)
    poses[:, :3, 3] = ends[:, 0]
    return poses


def segments_of(tracker_from_probe, tracker_from_needle):
    """(N, 2, 3): the needle's ends in the probe marker's frame."""
    carried = np.linalg.inv(tracker_from_probe) @ tracker_from_needle
    return NEEDLE.segment_mm @ np.swapaxes(carried[:, :3, :3], 1, 2) + carried[:, None, :3, 3]
