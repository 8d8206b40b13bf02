"""Recordings of a thread, a crossing of two or a floor that rests in the room, over which a probe is led."""

from __future__ import annotations

import numpy as np

from benchmarks.simulators.mixes import Array
from benchmarks.simulators.places import Noise, Sweep, sweep
from benchmarks.simulators.places_hand import IMAGE_PX, SCALE_MM_PER_PX, Kind
from benchmarks.simulators.tank_images import Tank, Thread, Wall, tank_image
from benchmarks.simulators.tank_probe import Probe
from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording
from sonocal.recording.model import Provenance

__all__ = ["tank_recording"]

RATE_HZ = 20.0
HALF_MM = 60.0
"""Of a thread."""
STRENGTH = 2.0
"""Of what a thread sends back, as of the wires of `tank_scans`."""
PROBE = Probe(side_px=IMAGE_PX[0], mm_per_px=SCALE_MM_PER_PX, half_angle=0.7, beams=200)


def tank_recording(
    kind: Kind, seed: int, frames: int = 200, *, tank: Tank | None = None, tilt_deg: float = 40.0
) -> tuple[Recording, Sweep]:
    """Images and tracked poses, and the rows that they would show.

    Args:
        kind: "line" is a thread, "point" a crossing of two, "plane" the floor.
        seed: of everything.
        frames: how many.
        tank: what the images look like.
        tilt_deg: the image's largest tilt, of each of two.
    """
    tank, random = tank or Tank(), np.random.default_rng([seed, 11])
    scene = sweep(kind, frames, seed, Noise(px=0.0), tilt_deg=tilt_deg)
    first = np.unique(scene.frame, return_index=True)[1]
    image_from_probe = np.linalg.inv(_in_mm(scene))
    images = []
    for pose in scene.true_poses[first]:
        walls, threads = _in_view(kind, scene.place, image_from_probe @ pose)
        images.append(tank_image(random, PROBE, tank, walls, threads))
    stack = ArrayFrames(np.array(images))
    poses = Poses.of("Probe", "Tracker", np.linalg.inv(scene.poses[first]))
    recording = Recording(
        times=np.arange(frames) / RATE_HZ,
        frames=stack,
        poses={"ProbeToTracker": poses},
        image=ImageGeometry.of(stack),
        provenance=Provenance(name=f"{kind} in a tank, seed {seed}, {RATE_HZ:g} Hz"),
    )
    return recording, scene


def _in_mm(scene: Sweep) -> Array:
    """(4, 4): the probe's marker from the image in mm."""
    rigid = scene.truth.copy()
    rigid[:3, :3] /= SCALE_MM_PER_PX
    return rigid


def _in_view(kind: Kind, place: Array, image_from_room: Array) -> tuple[tuple[Wall, ...], tuple[Thread, ...]]:
    """What spans a target (K, 3), as an image shows it."""
    points = place @ image_from_room[:3, :3].T + image_from_room[:3, 3]
    if kind == "plane":
        normal = np.cross(*(points[1:] - points[0]))
        normal *= np.sign(normal[1]) / np.linalg.norm(normal)
        return (Wall(normal, float(normal @ points[0])),), ()
    if kind == "line":
        ways = (points[1] - points[0])[None]
    else:  # in a level plane of the room
        ways = np.array([[1.0, 0.15, 0.05], [-0.15, 1.0, 0.1]]) @ image_from_room[:3, :3].T
    ways = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return (), tuple(Thread(points[0] + HALF_MM * np.array([-way, way]), STRENGTH) for way in ways)
