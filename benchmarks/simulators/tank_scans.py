"""Recordings of what is fixed in a tank, or of a needle that is moved about in it, with known truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.simulators.tank_images import Tank, Thread, Wall, tank_image
from benchmarks.simulators.tank_probe import Probe
from sonocal.geometry import Similarity
from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording
from sonocal.recording.model import Provenance
from sonocal.targets import Line, Plane, Point, Target

__all__ = ["SCENES", "Scan", "tank_scan"]

Array = NDArray[np.float64]
NEEDLE_MM, THREAD_MM, DEEP_MM = 200.0, 120.0, 100.0
MARKER_MM, MARKER_RAD = 0.2, 0.0015
"""Noise of every tracked marker, along and about each axis."""
TILT_RAD, LEAN_RAD, TURN_RAD = 0.22, 0.12, 0.4
"""How far a wall is held from across the beams, in the image and out of it; how far a thread from across the slice."""
OFF_SLICE_MM = 0.4
"""How far out of the slice a hand leaves a crossing at its brightest."""
SCENES = ("needle", "wires", "cross-wire", "cross-wires", "wall", "walls")
THREADS = np.array([[1.0, 0.15, 0.05], [-0.15, 1.0, 0.1]])
"""Ways of the two threads of a crossing, in the room."""


@dataclass(frozen=True, eq=False)
class Scan:
    """A recording, what was scanned, and the truth: of the probe, and of the target's frame in each image (F, 4, 4)."""

    recording: Recording
    targets: tuple[Target, ...]
    truth: Similarity
    image_from_target: Array


def tank_scan(
    seed: int,
    scene: str = "wall",
    frames: int = 30,
    *,
    hidden: float = 0.1,
    probe: Probe | None = None,
    tank: Tank | None = None,
    part: tuple[float, float] = (0.0, 1.0),
    other_mm: float | None = None,
    needle_in_front: bool = False,
    tilt: float = TILT_RAD,
) -> Scan:
    """A scan of one scene.

    Args:
        seed: of everything random.
        scene: one of `SCENES`.
        frames: images.
        hidden: share of images that show none of it.
        probe: what takes the images.
        tank: what they look like.
        part: of the image's width in which a wall is seen.
        other_mm: another wall, parallel, so far above the one that the file of targets names; None: there is none.
        needle_in_front: a thread that nothing names crosses the slice before the wall, and shades it.
        tilt: how far a wall is held from across the beams.
    """
    probe, tank, rng = probe or Probe(), tank or Tank(), np.random.default_rng([seed, 5])
    targets = _targets(scene)
    truth = Similarity(
        Rotation.random(random_state=rng).as_matrix(), rng.uniform(-80, 80, 3), probe.mm_per_px
    )
    images, held = [], []
    for i in range(frames):
        target = targets[i * len(targets) // frames]
        image_from_target = _held(target, probe, tilt, rng)
        shown = rng.random() >= hidden
        walls, threads = _in_view(targets, target, image_from_target, scene) if shown else ((), ())
        walls = tuple(wall._replace(part=part) for wall in walls)
        if other_mm is not None:
            walls += tuple(wall._replace(offset=wall.offset - other_mm, strength=0.8) for wall in walls)
        if needle_in_front and walls:
            threads += (_before(walls[0], probe, rng),)
        images.append(tank_image(rng, probe, tank, walls, threads))
        held.append(image_from_target)
    poses = _poses(np.array(held), truth, targets[0].frame, rng)
    stack = np.array(images)
    recording = Recording(
        times=np.arange(frames) / 5.0,
        frames=ArrayFrames(stack),
        poses=poses,
        image=ImageGeometry.of(ArrayFrames(stack)),
        provenance=Provenance(name=f"{scene}, seed {seed}"),
    )
    return Scan(recording, targets, truth, np.array(held))


def _targets(scene: str) -> tuple[Target, ...]:
    if scene == "needle":
        return (Line("needle", "Needle", np.array([[0.0, 0, 0], [0, 0, -NEEDLE_MM]])),)
    if scene == "wires":
        return tuple(_wire(layer, place) for layer in range(3) for place in range(3))
    if scene in ("cross-wire", "cross-wires"):
        places = np.array([[0.0, 0, 0], [45, 5, -10], [-30, 25, 12], [10, -40, -6]])
        count = 1 if scene == "cross-wire" else 4
        return tuple(Point(f"cross {i}", "Tracker", place) for i, place in enumerate(places[:count]))
    sides = (("floor", -2), ("left", -1), ("right", 1))[: 1 if scene == "wall" else 3]
    return tuple(_side(name, axis) for name, axis in (*sides, *((("back", 3),) if scene == "walls" else ())))


def _side(name: str, which: int) -> Plane:
    """A side of the tank: -2 the floor, others upright."""
    out = {-2: [0.0, 0, -1], -1: [-1.0, 0.1, 0], 1: [1.0, 0.1, 0.05], 3: [0.0, 1.0, 0]}[which]
    normal = np.array(out) / np.linalg.norm(out)
    along = np.linalg.svd(normal[None])[2][1:]
    corners = np.array([[-50.0, -40], [50, -40], [0, 60]])
    return Plane(name, "Tracker", DEEP_MM * normal + corners @ along)


def _wire(layer: int, place: int) -> Line:
    angle = np.pi / 3 * layer
    along = np.array([np.cos(angle), np.sin(angle), 0.15])
    middle = 16.0 * (place - 1) * np.array([-np.sin(angle), np.cos(angle), 0]) + [0, 0, 10.0 * (layer - 1)]
    return Line(f"wire {3 * layer + place}", "Tracker", middle + THREAD_MM / 2 * np.array([-along, along]))


def _held(target: Target, probe: Probe, tilt: float, rng: np.random.Generator) -> Array:
    """(4, 4), mm: the image from the target's frame, so that the image shows it."""
    reach = (0.3 if probe.radius_mm else 0.4) if target.frame == "Needle" else 0.2
    at = np.array([(0.5 + reach * rng.uniform(-1, 1)), rng.uniform(0.3, 0.85), 0.0]) * probe.side_mm
    if isinstance(target, Plane):
        middle = target.points_mm.mean(axis=0)
        out = middle / np.linalg.norm(middle)
        normal = np.cross(*(target.points_mm[1:] - target.points_mm[0]))
        normal *= np.sign(normal @ out) / np.linalg.norm(normal)
        down, place = normal, rng.dirichlet(np.ones(3)) @ target.points_mm
        leaning = Rotation.from_euler("zx", [tilt * rng.normal(), LEAN_RAD * rng.normal()])
        at[0] = 0.5 * probe.side_mm
    else:
        ends = target.spanning_mm
        down, place = _across(ends, rng), ends[0] + rng.uniform(0.2, 0.8) * (ends[-1] - ends[0])
        leaning = Rotation.from_rotvec(TURN_RAD * rng.normal(size=3))
        at[2] = OFF_SLICE_MM * rng.normal() if isinstance(target, Point) else 0.0
    turn = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi) * np.array([0.0, 1.0, 0.0]))
    rotation = leaning.as_matrix() @ (
        _facing(target, down) if isinstance(target, Line) else turn.as_matrix() @ _upright(down)
    )
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, at - rotation @ place
    return pose


def _across(ends: Array, rng: np.random.Generator) -> Array:
    """A direction for the beams: down in the room, about; of a line, across it."""
    if len(ends) == 1:
        return np.array([0.0, 0.0, -1.0])
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    down = np.array([0.0, 0.0, -1.0]) if abs(along[2]) < 0.9 else rng.normal(size=3)
    down = down - (down @ along) * along
    return np.asarray(down / np.linalg.norm(down))


def _upright(down: Array) -> Array:
    """A rotation that brings a direction to the image's depth."""
    side = np.linalg.svd(down[None])[2][1]
    return np.stack([side, down, np.cross(side, down)])


def _facing(line: Line, down: Array) -> Array:
    """A rotation that brings a direction to the depth, and a line across it to the slice's normal."""
    along = (line.segment_mm[1] - line.segment_mm[0]) / np.linalg.norm(
        line.segment_mm[1] - line.segment_mm[0]
    )
    return np.stack([np.cross(down, along), down, along])


def _in_view(
    targets: tuple[Target, ...], target: Target, pose: Array, scene: str
) -> tuple[tuple[Wall, ...], tuple[Thread, ...]]:
    """What an image shows: the target that it is held to; of wires all."""
    if isinstance(target, Plane):
        points = target.points_mm @ pose[:3, :3].T + pose[:3, 3]
        normal = np.cross(*(points[1:] - points[0]))
        normal *= np.sign(normal[1]) / np.linalg.norm(normal)
        return (Wall(normal, float(normal @ points[0])),), ()
    if isinstance(target, Point):
        place = pose[:3, :3] @ target.place_mm + pose[:3, 3]
        ways = THREADS @ pose[:3, :3].T
        return (), tuple(Thread(place + 40.0 * np.array([-way, way])) for way in ways)
    seen = [one for one in targets if isinstance(one, Line)]
    tail = 0.6 if scene == "needle" else 0.0
    return (), tuple(Thread(one.segment_mm @ pose[:3, :3].T + pose[:3, 3], 2.0, tail) for one in seen)


def _before(wall: Wall, probe: Probe, rng: np.random.Generator) -> Thread:
    """A thread across the slice, between the probe and a wall."""
    middle = 0.5 * probe.side_mm
    depth = (wall.offset - wall.normal[0] * middle) / wall.normal[1]
    place = np.array([middle + rng.uniform(-10, 10), rng.uniform(0.4, 0.8) * depth, 0.0])
    way = np.array([0.3 * rng.normal(), 0.2 * rng.normal(), 1.0])
    return Thread(place + 40.0 * np.array([-way, way]), 3.0, 0.6)


def _poses(
    image_from_target: Array, truth: Similarity, frame: str, rng: np.random.Generator
) -> dict[str, Poses]:
    """What the tracker says of the probe, and of the needle where that is what moves."""
    probe_from_image = np.eye(4)
    probe_from_image[:3, :3], probe_from_image[:3, 3] = truth.rotation, truth.translation
    probe_from_target = probe_from_image @ image_from_target
    if frame == "Tracker":
        probes = [_noisy(pose, rng) for pose in np.linalg.inv(probe_from_target)]
        return {"ProbeToTracker": Poses.of("Probe", "Tracker", np.array(probes))}
    tracker_from_probe = [_anywhere(rng) for _ in probe_from_target]
    needles = [_noisy(p @ q, rng) for p, q in zip(tracker_from_probe, probe_from_target, strict=True)]
    probes = [_noisy(pose, rng) for pose in tracker_from_probe]
    return {
        "ProbeToTracker": Poses.of("Probe", "Tracker", np.array(probes)),
        "NeedleToTracker": Poses.of("Needle", "Tracker", np.array(needles)),
    }


def _anywhere(rng: np.random.Generator) -> Array:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-50, 50, 3)
    return pose


def _noisy(pose: Array, rng: np.random.Generator) -> Array:
    """A marker's pose as the tracker says it: off along and about its own axes."""
    off = np.eye(4)
    off[:3, :3] = Rotation.from_rotvec(MARKER_RAD * rng.normal(size=3)).as_matrix()
    off[:3, 3] = MARKER_MM * rng.normal(size=3)
    return np.asarray(pose @ off)
