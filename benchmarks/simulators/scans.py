"""A continuous scan with known truth that can be made wrong in one way at a time."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial.transform import Rotation

import sonocal as sc

SCALE = 0.24
IMAGE = 500.0
NEEDLE_MM = 250.0
FRAMES_PER_S = 10.0


class Path:
    """Smooth random functions of time between -1 and 1."""

    def __init__(self, rng, count, seconds):
        self.frequency = rng.uniform(0.5, 3.0, (4, count)) * 2 * np.pi / seconds
        self.phase = rng.uniform(0, 2 * np.pi, (4, count))

    def __call__(self, time):
        return np.sin(time[:, None, None] * self.frequency + self.phase).mean(axis=1) * 1.6


@dataclasses.dataclass
class Scan:
    """The rows (N), the transform they were made with, and the probe's pose (N, 4, 4), mm, at each."""

    observations: sc.Observations
    truth: sc.Similarity
    tracker_from_probe: np.ndarray


def scan(
    seed,
    *,
    dimension=2,
    frames=100,
    latency_s=0.0,
    slip=None,
    slip_at=0.5,
    outliers=0.03,
    sigma_px=1.0,
    sigma_mm=0.5,
):
    """A needle moved slowly through the image of a probe that moves, too.

    Args:
        seed: of everything random.
        dimension: 2 or 3, of the image.
        frames: images, ten a second.
        latency_s: the tracker reports where things were this long ago.
        slip: (rotation vector in rad, translation in mm) of the marker on the probe, from `slip_at` on.
        slip_at: share of the frames before the slip.
        outliers: share of the frames that see anything anywhere.
        sigma_px: noise of a point along each axis.
        sigma_mm: noise of a segment's end along each axis.
    """
    rng = np.random.default_rng(seed)
    seconds = frames / FRAMES_PER_S
    # The marker is on the handle: above the image, some 80 mm away.
    rotation = Rotation.from_rotvec(rng.normal(scale=0.3, size=3)) * Rotation.random(random_state=rng)
    handle = np.array([rng.uniform(100, 400), rng.uniform(-450, -200), rng.uniform(-100, 100)]) * SCALE
    truth = sc.Similarity(rotation.as_matrix(), -rotation.apply(handle), SCALE)
    place, tilt, depth, probe = (Path(rng, n, seconds) for n in (dimension, 2, 1, 6))

    def needle(time):
        """Ends of the needle in the image frame, mm, and what the image sees of it, px."""
        crossing = np.zeros((len(time), 3))
        crossing[:, :dimension] = np.clip((place(time) + 1) / 2, 0.02, 0.98) * IMAGE * SCALE
        along = np.column_stack([0.9 * tilt(time), np.ones(len(time))])
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        before = NEEDLE_MM * (0.5 + 0.25 * depth(time))
        ends = np.stack([crossing - before * along, crossing + (NEEDLE_MM - before) * along], axis=1)
        seen = crossing[:, None] + np.array([0.0, 30.0])[: dimension - 1, None] * along[:, None]
        return ends, seen / SCALE

    stamps = np.arange(frames) / FRAMES_PER_S
    seen = needle(stamps)[1]
    segments = truth @ (needle(stamps - latency_s)[0] / SCALE)
    pose = probe(stamps - latency_s)
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, :3, :3] = Rotation.from_rotvec(0.5 * pose[:, :3] + rng.normal(size=3)).as_matrix()
    poses[:, :3, 3] = 40 * pose[:, 3:] + rng.uniform(-300, 300, 3)
    if slip is not None:
        turn, shift = Rotation.from_rotvec(slip[0]).as_matrix(), np.asarray(slip[1])
        late = np.arange(frames) >= slip_at * frames
        segments[late] = segments[late] @ turn.T + shift

    segments = segments + sigma_mm * rng.normal(size=segments.shape)
    per_frame = dimension - 1
    points = seen[..., :dimension] + sigma_px * rng.normal(size=(frames, per_frame, dimension))
    wrong = rng.random(frames) < outliers
    points[wrong] = rng.uniform(0, IMAGE, (wrong.sum(), per_frame, dimension))
    frame = np.repeat(np.arange(frames), per_frame)
    observations = sc.Observations(
        points.reshape(-1, dimension),
        segments[frame],
        frame=frame,
        extra={"time_s": stamps[frame].astype(str)},
        source="scan",
    )
    return Scan(observations, truth, poses[frame])
