"""How a probe is held to see what is fixed in the room, and what a tracker says of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sonocal.geometry import Array, Similarity
from sonocal.recording import Poses
from sonocal.simulation.target_scenes import ROOM
from sonocal.simulation.ultrasound_probe import ProbeGeometry
from sonocal.targets import Line, Plane, Point, Target

if TYPE_CHECKING:
    from scipy.spatial.transform import Rotation

__all__ = ["held", "tracked"]

ACROSS, TILT, OUT = 0.25, 0.12, 0.5
"""Standard deviations, rad: of a wall against the beam in the image, and out of it; of a thread's lean."""
OFF_SLICE_MM = 0.3
"""How far out of the slice a hand that looks for the brightest image leaves a crossing (standard deviation)."""


def held(target: Target, geometry: ProbeGeometry, rng: np.random.Generator) -> Array:
    """(4, 4): of the image's axes from the room: how the probe is held to see a target."""
    sweep = rng.uniform(-0.4, 0.4) if geometry.dimension == 3 else 0.0
    at = geometry.point_at(np.array(rng.uniform(0.25, 0.85)), np.array(rng.uniform(-0.6, 0.6)), sweep)
    if isinstance(target, Plane):
        rotation, place = _at_wall(target, rng)
    else:
        rotation, place = _at_thread(target, rng)
        if not isinstance(target, Line) and geometry.dimension == 2:
            at = at + OFF_SLICE_MM * rng.normal() * np.eye(3)[2]
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, at - rotation @ place
    return pose


def _at_wall(wall: Plane, rng: np.random.Generator) -> tuple[Array, Array]:
    """A rotation that has the beams meet a wall from within the tank, and a place on it."""
    from scipy.spatial.transform import Rotation

    normal = np.cross(*(wall.points_mm[1:] - wall.points_mm[0]))
    normal = normal * np.sign(normal @ wall.points_mm.mean(axis=0))
    place = rng.dirichlet(np.ones(3)) @ wall.points_mm
    turned = Rotation.from_euler("zx", [rng.normal(scale=ACROSS), rng.normal(scale=TILT)])
    return (turned * _spun(rng)).as_matrix() @ _upright(normal / np.linalg.norm(normal)), place


def _at_thread(target: Line | Point, rng: np.random.Generator) -> tuple[Array, Array]:
    """Likewise of a crossing, from above; or of a thread that the slice is across."""
    from scipy.spatial.transform import Rotation

    place = target.spanning_mm.mean(axis=0)
    leaning = _spun(rng) * Rotation.from_rotvec(OUT * rng.normal(size=3))
    rotation = leaning.as_matrix() @ _upright(np.array([0.0, 0.0, -1.0]))
    if isinstance(target, Line):
        along = target.segment_mm[1] - target.segment_mm[0]
        place = place + rng.uniform(-0.3, 0.3) * along
        crossing = np.array([*(OUT * rng.normal(size=2)), 1.0])
        rotation = _brought(rotation @ along, crossing) @ rotation
    return rotation, place


def _spun(rng: np.random.Generator) -> Rotation:
    """About the depth."""
    from scipy.spatial.transform import Rotation

    return Rotation.from_rotvec(rng.uniform(-np.pi, np.pi) * np.array([0.0, 1.0, 0.0]))


def _upright(down: Array) -> Array:
    """A rotation that brings a direction of the room to the image's depth."""
    other = np.linalg.svd(down[None])[2][1:]
    rotation = np.stack([other[0], down, np.cross(other[0], down)])
    return np.asarray(rotation)


def _brought(one: Array, other: Array) -> Array:
    """The least rotation that brings one direction to another, or to its opposite."""
    from scipy.spatial.transform import Rotation

    a, b = one / np.linalg.norm(one), other / np.linalg.norm(other)
    b = b if a @ b >= 0 else -b
    axis = np.cross(a, b)
    size = np.linalg.norm(axis)
    turn = axis / max(size, 1e-12) * np.arctan2(size, a @ b)
    return np.asarray(Rotation.from_rotvec(turn).as_matrix())


def tracked(
    truth: Similarity,
    image_from_room: Array,
    geometry: ProbeGeometry,
    sigma_mm: float,
    rng: np.random.Generator,
) -> Poses:
    """Of the probe's marker, off by the tracker's noise: at the image's middle by `sigma_mm`, along each axis."""
    from scipy.spatial.transform import Rotation

    probe_from_image_mm = np.eye(4)
    probe_from_image_mm[:3, :3], probe_from_image_mm[:3, 3] = truth.rotation, truth.translation
    room_from_probe = np.linalg.inv(probe_from_image_mm @ image_from_room)
    size = np.array([*geometry.size_px, 1][:3]) * geometry.scale_mm_per_px
    middle = truth.rotation @ (0.5 * size) + truth.translation
    poses = []
    for pose in room_from_probe:
        turned, about = np.eye(4), pose[:3, :3] @ middle + pose[:3, 3]
        turned[:3, :3] = Rotation.from_rotvec(sigma_mm / 100.0 * rng.normal(size=3)).as_matrix()
        turned[:3, 3] = about - turned[:3, :3] @ about + sigma_mm * rng.normal(size=3)
        poses.append(turned @ pose)
    return Poses.of("Probe", ROOM, np.array(poses))
