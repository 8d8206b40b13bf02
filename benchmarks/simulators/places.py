"""Tank sweeps of a thread, a cross or a floor that nobody measured.

NumPy and SciPy alone: what judges an estimator shares nothing with it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.mixes import Array

__all__ = [
    "IMAGE_PX",
    "SPANS",
    "Kind",
    "Noise",
    "Sweep",
    "directions",
    "image_home",
    "image_points",
    "in_image",
    "shaken",
    "sweep",
]

Kind = Literal["point", "line", "plane"]
IMAGE_PX = (500, 500)
SCALE_MM_PER_PX = 0.2
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
    """(25, 3) or (50, 3), px: evenly over the image, or over the volume's two ends."""
    u, v = np.meshgrid(np.linspace(0, IMAGE_PX[0], 5), np.linspace(0, IMAGE_PX[1], 5))
    flat = np.column_stack([u.ravel(), v.ravel(), np.zeros(u.size)])
    return flat if dimension == 2 else np.vstack([flat, flat + np.array([0, 0, 300.0])])


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
        motion: "free", or a degenerate one: "translation", "one-axis", "yaw", "about-target", "pivot".
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
    hand = _Hand(kind, motion, tilt_deg, yaw_deg, dimension, each)
    points, poses = _scan(hand, truth, (middle, along, across), frames, random)
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
    low, high = np.zeros(3), np.array([*IMAGE_PX, 300.0 if dimension == 3 else 0.0])
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


def directions(kind: Kind, random: np.random.Generator) -> tuple[Array, Array]:
    """Along the target, or in it: a thread lies nearly flat, a floor is level."""
    if kind == "plane":
        tip = Rotation.from_rotvec(random.normal(size=3) * np.deg2rad([3, 3, 0])).as_matrix()
        return tip[:, 0], tip[:, 1]
    angle = random.uniform(0, np.pi)
    along = np.array([np.cos(angle), np.sin(angle), random.normal() * 0.2])
    along /= np.linalg.norm(along)
    return along, np.cross(along, [0, 0, 1.0])


@dataclass(frozen=True)
class _Hand:
    """How the probe is led."""

    kind: Kind
    motion: str
    tilt_deg: float
    yaw_deg: float
    dimension: int
    each: int

    def turn(self, along: Array, axis: Array, random: np.random.Generator) -> Array:
        """(3, 3): of the image from where nothing turns it."""
        tilts = np.deg2rad(random.uniform(-self.tilt_deg, self.tilt_deg, 2))
        share = 0.25 if self.kind == "line" else 1
        yaw = np.deg2rad(random.uniform(-self.yaw_deg, self.yaw_deg) * share)
        turns = {
            "translation": Rotation.identity(),
            "one-axis": Rotation.from_rotvec(axis * tilts[0]),
            "yaw": Rotation.from_euler("z", yaw),
            "about-target": Rotation.from_rotvec(along * tilts[0]),
        }
        return np.asarray(turns.get(self.motion, Rotation.from_euler("zxy", [yaw, *tilts])).as_matrix())

    def pixel(self, random: np.random.Generator) -> Array:
        """(3,): where the target is seen."""
        pixel, margin = np.zeros(3), 0.15 * np.array(IMAGE_PX)
        pixel[:2] = random.uniform(margin, np.array(IMAGE_PX) - margin)
        if self.dimension == 3:
            pixel[2] = random.uniform(30, 270)
        if self.motion == "pivot":
            pixel[:2] = np.array(IMAGE_PX) * [0.5, 0.9]
        return pixel


def _scan(
    hand: _Hand, truth: Array, target: tuple[Array, Array, Array], frames: int, random: np.random.Generator
) -> tuple[Array, Array]:
    """Pixels (F, each, 3) and tracker poses inverted (F, 4, 4): the image over the target, from above."""
    (middle, along, across), kind, each = target, hand.kind, hand.each
    linear, points, poses = truth[:3, :3] / SCALE_MM_PER_PX, [], []
    home = image_home(along)
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    for _ in range(frames):
        image = hand.turn(along, axis, random) @ home  # image axes in the room
        rotation = image @ linear.T  # room from probe
        pixel = hand.pixel(random)
        there = middle + along * random.uniform(-40, 40) * (kind != "point")
        if kind == "plane":
            there = there + across * random.uniform(-40, 40)
        pose = np.eye(4)
        pose[:3, :3] = rotation
        pose[:3, 3] = there - rotation @ (truth[:3, :3] @ pixel + truth[:3, 3])
        shown = [pixel]
        if each > 1:
            step = in_image(kind, image, along, across) * random.uniform(60, 150)
            shown = (
                [pixel - step, pixel + step]
                if each == 2
                else [pixel + step * k for k in np.linspace(-1, 1, each)]
            )
        points.append(shown)
        poses.append(np.linalg.inv(pose))
    return np.array(points), np.array(poses)


def image_home(along: Array) -> Array:
    """(3, 3): the image's axes in the room, v down into the tank, u across the thread, where nothing turns it."""
    wanted = np.column_stack([np.cross(along, [0, 0, -1.0]), [0, 0, -1.0], -along])
    home, _ = np.linalg.qr(wanted)
    home = home * np.sign(np.sum(home * wanted, axis=0))
    if np.linalg.det(home) < 0:
        home[:, 2] *= -1
    return home


def in_image(kind: Kind, image: Array, along: Array, across: Array) -> Array:
    """A direction of the image (unit, px) that lies in the target."""
    if kind == "plane":
        normal = image.T @ np.cross(along, across)
        step = np.array([normal[1], -normal[0], 0.0])
    else:
        step = image.T @ along
    return step / np.linalg.norm(step)


def shaken(poses: Array, noise: Noise, random: np.random.Generator) -> Array:
    """Poses (F, 4, 4) of something in the probe's frame, the probe's marker being mistaken."""
    shake = np.broadcast_to(np.eye(4), poses.shape).copy()
    shake[:, :3, :3] = Rotation.from_rotvec(
        np.deg2rad(noise.deg) * random.normal(size=(len(poses), 3))
    ).as_matrix()
    shake[:, :3, 3] = noise.mm * random.normal(size=(len(poses), 3))
    return shake @ poses
