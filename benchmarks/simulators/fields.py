"""Sweeps of a field whose grey level is known everywhere: waves in three directions, and nothing of the estimator."""

from __future__ import annotations

import numpy as np

from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording

MM_PER_PX = 0.25
WAVES_MM = np.array([[0.11, 0.0, 0.02], [0.0, 0.13, 0.05], [0.04, 0.03, 0.17]])


def grey_at(points_mm):
    """(...): grey levels of points (..., 3)."""
    phases = 2 * np.pi * 0.5 * np.asarray(points_mm) @ WAVES_MM.T
    return 128 + 40 * np.sin(phases).sum(axis=-1)


def probe_from_image():
    """(4, 4): mm from px: an image that hangs 60 mm off its marker, turned."""
    c, s = np.cos(0.4), np.sin(0.4)
    matrix = np.eye(4)
    matrix[:3, :3] = MM_PER_PX * np.array([[c, 0, s], [s, 0, -c], [0, 1, 0]])
    matrix[:3, 3] = [-10.0, 20.0, 60.0]
    return matrix


def path(count, step_mm=0.6, back=False):
    """(count, 4, 4): a probe that moves across its image's plane and turns on its way; there and back where asked."""
    along = np.arange(count, dtype=float)
    if back:
        along = np.minimum(along, count - 1 - along)
    poses = np.tile(np.eye(4), (count, 1, 1))
    turn = 0.004 * along
    poses[:, 0, 0] = poses[:, 1, 1] = np.cos(turn)
    poses[:, 0, 1], poses[:, 1, 0] = -np.sin(turn), np.sin(turn)
    normal = np.array([np.sin(0.4), -np.cos(0.4), 0.0])
    poses[:, :3, 3] = step_mm * along[:, None] * normal
    return poses


def turned(rng, sigma_rad, count):
    """(count, 3, 3): small turns about random axes."""
    angles = rng.normal(0, sigma_rad, (count, 3))
    turns = np.tile(np.eye(3), (count, 1, 1))
    turns[:, 0, 1], turns[:, 1, 0] = -angles[:, 2], angles[:, 2]
    turns[:, 0, 2], turns[:, 2, 0] = angles[:, 1], -angles[:, 1]
    turns[:, 1, 2], turns[:, 2, 1] = -angles[:, 0], angles[:, 0]
    u, _, v = np.linalg.svd(turns)
    return u @ v


def recorded(poses, shape=(80, 100), *, jitter=(0.0, 0.0), seed=0, dtype=np.uint8, matrix=None):
    """A sweep of the field: images as they were, poses as a tracker with a jitter of (mm, deg) saw them."""
    rng, count = np.random.default_rng(seed), len(poses)
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    pixels = np.stack([u, v, 0 * u, 1 + 0 * u], axis=-1)
    matrix = probe_from_image() if matrix is None else matrix
    scale = np.iinfo(dtype).max / 255
    images = np.stack([np.rint(scale * grey_at((pixels @ (pose @ matrix).T)[..., :3])) for pose in poses])
    seen = poses.copy()
    seen[:, :3, :3] = poses[:, :3, :3] @ turned(rng, np.radians(jitter[1]), count)
    seen[:, :3, 3] += rng.normal(0, jitter[0], (count, 3))
    frames = ArrayFrames(images.astype(dtype))
    one = Poses.of("Probe", "Tracker", seen)
    return Recording(np.arange(count) / 20, frames, {one.name: one}, ImageGeometry.of(frames, 2, "MF"))
