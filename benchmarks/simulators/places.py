"""Tank sweeps of a thread, a cross or a floor that nobody measured.

NumPy and SciPy alone: what judges an estimator shares nothing with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.mixes import Array
from benchmarks.simulators.places_hand import (
    DEPTH_PX,
    IMAGE_PX,
    SCALE_MM_PER_PX,
    Hand,
    Kind,
    directions,
    scan,
)

__all__ = ["SPANS", "Noise", "Sweep", "image_corners", "image_points", "shaken", "sweep"]

SPANS = {"point": 1, "line": 2, "plane": 3}


@dataclass(frozen=True)
class Noise:
    """Standard deviations along or about each axis: of a pixel, of a tracked pose."""

    px: float = 1.0
    mm: float = 0.3
    deg: float = 0.2


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a probe saw of one target, and the truth.

    Attributes:
        points_px: (N, 3).
        poses: (N, 4, 4): the target's frame in the probe's, as tracked; rows of a frame have the same.
        frame: (N,).
        truth: (4, 4): probe from image.
        true_poses: (N, 4, 4).
        body_poses: (N, 4, 4): tracker from the target's frame, true.
        place: (K, 3), mm: what spans the target.
        tracked: whether the target's frame is tracked too.
        wrong: (N,): which are outliers.
        dimension: 2 or 3.
    """

    points_px: Array
    poses: Array
    frame: Array
    truth: Array
    true_poses: Array
    place: Array
    tracked: bool
    wrong: Array
    dimension: int


def image_points(dimension: int = 2) -> Array:
    """(100, 3) or (500, 3), px: evenly over the image, or the volume; middles of equal parts of it."""
    u, v = ((np.arange(10) + 0.5) / 10 * size for size in IMAGE_PX)
    w = np.zeros(1) if dimension == 2 else (np.arange(5) + 0.5) / 5 * DEPTH_PX
    return np.stack(np.meshgrid(u, v, w), axis=-1).reshape(-1, 3)


def image_corners() -> Array:
    """(4, 3), px."""
    u, v = np.meshgrid([0.0, IMAGE_PX[0]], [0.0, IMAGE_PX[1]])
    return np.column_stack([u.ravel(), v.ravel(), np.zeros(4)])


def sweep(
    kind: Kind,
    frames: int,
    seed: int,
    noise: Noise | None = None,
    *,
    wrong: float = 0.0,
    tilt_deg: float = 40.0,
    yaw_deg: float = 180.0,
    tracked: bool = False,
    dimension: int = 2,
    motion: str = "free",
    points_each: int | None = None,
) -> Sweep:
    """Simulate it; a floor shows two points a frame, a thread one in an image and two in a volume.

    Args:
        kind: of target.
        frames: how many.
        seed: of everything.
        noise: none: exact.
        wrong: the share of outliers, which lie anywhere in the image.
        tilt_deg: the image's largest tilt, of each of two.
        yaw_deg: the largest turn about the vertical.
        tracked: the target is held in a tracked tool's frame that moves.
        dimension: of the image.
        motion: "free", or one of `places_hand.MOTIONS`, which leave something open.
        points_each: of a frame.
    """
    random = np.random.default_rng([seed, frames, SPANS[kind], dimension])
    truth = np.eye(4)
    truth[:3, :3] = SCALE_MM_PER_PX * Rotation.random(random_state=random.integers(2**31)).as_matrix()
    truth[:3, 3] = random.normal(size=3) * 15 - truth[:3, :3] @ np.array([*IMAGE_PX, 0]) * 0.5
    truth[:3, 3] += truth[:3, 1] / SCALE_MM_PER_PX * 80
    along, across = directions(kind, random)
    middle = random.normal(size=3) * 200 + [0, 0, -1200]
    place = np.array([middle, middle + 50 * along, middle + 50 * across])[: SPANS[kind]]
    each = points_each or (2 if kind == "plane" or (kind == "line" and dimension == 3) else 1)
    hand = Hand(kind, motion, tilt_deg, yaw_deg, dimension, each)
    points, poses = scan(hand, truth, (middle, along, across), frames, random)
    local = np.eye(4)
    if tracked:  # a tool's marker with the target fixed to it; the poses of the scan are seen from the tool
        local[:3, :3], local[:3, 3] = (
            Rotation.random(random_state=random.integers(2**31)).as_matrix(),
            random.normal(size=3) * 60,
        )
        local[:3, 3] += middle
    probe_from_target = poses @ local
    place = (place - local[:3, 3]) @ local[:3, :3]
    is_wrong = random.random(frames) < wrong
    if noise is not None:
        measured = shaken(probe_from_target, noise, random)
        if tracked:
            measured = np.linalg.inv(shaken(np.linalg.inv(measured), noise, random))
        points = points + random.normal(size=points.shape) * noise.px * np.r_[1, 1, dimension == 3]
    else:
        measured = probe_from_target
    low, high = np.zeros(3), np.array([*IMAGE_PX, DEPTH_PX if dimension == 3 else 0.0])
    anywhere = random.uniform(low, np.where(high > 0, high, 1), size=points.shape) * (high > 0)
    points = np.where(is_wrong[:, None, None], anywhere, points)
    repeat = np.repeat(np.arange(frames), each)
    return Sweep(
        points.reshape(-1, 3),
        measured[repeat],
        repeat,
        truth,
        probe_from_target[repeat],
        place,
        tracked,
        is_wrong[repeat],
        dimension,
    )


def shaken(poses: Array, noise: Noise, random: np.random.Generator) -> Array:
    """Poses (F, 4, 4) of something in the probe's frame, the probe's marker being mistaken."""
    shake = np.broadcast_to(np.eye(4), poses.shape).copy()
    shake[:, :3, :3] = Rotation.from_rotvec(
        np.deg2rad(noise.deg) * random.normal(size=(len(poses), 3))
    ).as_matrix()
    shake[:, :3, 3] = noise.mm * random.normal(size=(len(poses), 3))
    return shake @ poses
