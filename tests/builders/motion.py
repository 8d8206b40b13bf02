"""Motions that are known at every instant, and recordings of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording


@dataclass(frozen=True)
class Twist:
    """A steady motion: a turn about one axis at a constant rate, a move along one line at a constant speed."""

    start: np.ndarray
    turn_rad_s: np.ndarray
    speed_mm_s: np.ndarray

    def __call__(self, times):
        """(N, 4, 4): the pose at some times."""
        times = np.asarray(times, dtype=float)
        poses = np.tile(np.eye(4), (len(times), 1, 1))
        turns = Rotation.from_rotvec(times[:, None] * self.turn_rad_s).as_matrix()
        poses[:, :3, :3] = self.start[:3, :3] @ turns
        poses[:, :3, 3] = self.start[:3, 3] + times[:, None] * self.speed_mm_s
        return poses


def random_twist(seed):
    rng = np.random.default_rng(seed)
    start = np.eye(4)
    start[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    start[:3, 3] = rng.uniform(-300, 300, 3)
    return Twist(start, rng.normal(size=3), rng.normal(size=3) * 30)


def random_wave(seed):
    """A smooth signal of time that never repeats: sines of unrelated frequencies."""
    phases = np.random.default_rng(seed).uniform(0, 2 * np.pi, 4)
    return lambda t: sum(np.sin(w * t + p) for w, p in zip((1.1, 2.3, 3.7, 5.1), phases, strict=True))


def random_pose(seed):
    return random_twist(seed)([0.0])[0]


def recording_of(tools, times, *, images=True):
    """A recording of tools, each a function of time that gives its pose in the tracker's frame.

    Its images are small and all different: the first pixel counts them.
    """
    times = np.asarray(times, dtype=float)
    poses = [Poses.of(name, "Tracker", motion(times)) for name, motion in tools.items()]
    pixels = np.random.default_rng(len(times)).integers(0, 255, (len(times), 5, 6), dtype=np.uint8)
    pixels[:, 0, 0] = np.arange(len(times)) % 256
    frames = ArrayFrames(pixels)
    seen = {"frames": frames, "image": ImageGeometry.of(frames)} if images else {}
    return Recording(times=times, poses={one.name: one for one in poses}, **seen)
