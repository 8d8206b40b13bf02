"""How a hand leads a probe over a thread, a cross or a floor, or fails to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.mixes import Array

__all__ = [
    "DEPTH_PX",
    "IMAGE_PX",
    "MOTIONS",
    "SCALE_MM_PER_PX",
    "Hand",
    "Kind",
    "directions",
    "image_home",
    "in_image",
    "scan",
]

Kind = Literal["point", "line", "plane"]
IMAGE_PX = (500, 500)
DEPTH_PX = 300.0  # of a volume
SCALE_MM_PER_PX = 0.2
# A thread is crossed, and not looked along: it is turned about by no more than this share of a yaw.
CROSSED = 70 / 180
MOTIONS = (
    "translation",
    "about u",
    "about v",
    "about n",
    "about one axis",
    "about the target",
    "yaw",
    "pivot",
)
"""That leave something open; beside those whose turns are small."""


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
class Hand:
    """How the probe is led."""

    kind: Kind
    motion: str
    tilt_deg: float
    yaw_deg: float
    dimension: int
    each: int

    def turn(self, home: Array, along: Array, axis: Array, random: np.random.Generator) -> Array:
        """(3, 3): of the image from where nothing turns it."""
        tilts = np.deg2rad(random.uniform(-self.tilt_deg, self.tilt_deg, 2))
        yaw = np.deg2rad(
            random.uniform(-self.yaw_deg, self.yaw_deg) * (CROSSED if self.kind == "line" else 1)
        )
        axes = {"about u": home[:, 0], "about v": home[:, 1], "about n": home[:, 2]}
        axes |= {
            "about one axis": axis,
            "about the target": along,
            "yaw": np.array([0.0, 0, 1]) * yaw / tilts[0],
        }
        if self.motion == "translation":
            return np.eye(3)
        if self.motion in axes:
            return np.asarray(Rotation.from_rotvec(axes[self.motion] * tilts[0]).as_matrix())
        return np.asarray(Rotation.from_euler("zxy", [yaw, *tilts]).as_matrix())

    def pixel(self, random: np.random.Generator) -> Array:
        """(3,): where the target is seen."""
        pixel, margin = np.zeros(3), 0.15 * np.array(IMAGE_PX)
        pixel[:2] = random.uniform(margin, np.array(IMAGE_PX) - margin)
        if self.dimension == 3:
            pixel[2] = random.uniform(30, 270)
        if self.motion == "pivot":
            pixel[:2] = np.array(IMAGE_PX) * [0.5, 0.9]
        return pixel


def scan(
    hand: Hand, truth: Array, target: tuple[Array, Array, Array], frames: int, random: np.random.Generator
) -> tuple[Array, Array]:
    """Pixels (F, each, 3) and tracker poses inverted (F, 4, 4): the image over the target, from above."""
    (middle, along, across), kind, each = target, hand.kind, hand.each
    linear, points, poses = truth[:3, :3] / SCALE_MM_PER_PX, [], []
    home = image_home(along)
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    for _ in range(frames):
        image = hand.turn(home, along, axis, random) @ home  # image axes in the room
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
