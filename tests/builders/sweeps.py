"""Recordings of a tracked needle whose calibration is known, and what a detector would find in their images."""

from dataclasses import dataclass, replace

import numpy as np

from sonocal.detection import Detections
from sonocal.geometry import Similarity
from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording
from sonocal.recording.frames import Frames
from sonocal.simulation.scene import IMAGE_PX, simulate_observations
from sonocal.targets import Line
from tests.builders.recordings import random_poses

NEEDLE_MM = 400.0
NEEDLE = Line("needle", "Needle", np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -NEEDLE_MM]]))
SHAPE = (100, 120)


@dataclass(frozen=True, eq=False)
class Scan:
    """A recording, the needle in it, what was found in its images, which of that is right, and the truth."""

    recording: Recording
    lines: tuple[Line, ...]
    detections: Detections
    right: np.ndarray
    probe_from_image: Similarity


class ClosedFrames(Frames):
    """Images that must not be decoded."""

    def __init__(self, count, size_px):
        self._count, self.shape, self.dtype = count, tuple(size_px)[::-1], np.dtype(np.uint8)

    def __len__(self):
        return self._count

    def read(self, index):
        raise AssertionError(f"image {index} was decoded")


def scan_of(dimension=2, count=40, seed=0, *, decoys=0, hidden=0.0, sigma_px=0.5, sigma_mm=0.3, frames=True):
    """A needle at random poses before a probe that moves, its images closed; decoys stand at random ranks."""
    rng = np.random.default_rng([seed, 1])
    scene = simulate_observations(dimension, count, sigma_px=sigma_px, sigma_mm=sigma_mm, seed=seed)
    each, rows = dimension - 1, scene.observations
    tracker_from_probe = random_poses(rng, count)
    tracker_from_needle = tracker_from_probe @ needle_poses(rng, rows.segments_mm[::each])
    poses = [
        Poses.of("Probe", "Tracker", tracker_from_probe),
        Poses.of("Needle", "Tracker", tracker_from_needle),
    ]
    size = (IMAGE_PX,) * dimension
    recording = Recording(
        times=np.arange(count) / 8,
        poses={one.name: one for one in poses},
        frames=ClosedFrames(count, size),
        image=ImageGeometry(size, 1, "uint8", "MF", np.eye(4)),
    )
    if not frames:
        recording = Recording(times=recording.times, poses=recording.poses)
    detections, right = with_decoys(rng, rows.points_px.reshape(count, each, dimension), decoys, hidden)
    return Scan(recording, (NEEDLE,), detections, right, scene.probe_from_image)


def needle_poses(rng, segments_mm):
    """(N, 4, 4): a needle that lies along the segments (N, 2, 3), its tip at their first ends."""
    count = len(segments_mm)
    back = segments_mm[:, 0] - segments_mm[:, 1]
    back /= np.linalg.norm(back, axis=1, keepdims=True)
    side = np.cross(back, rng.normal(size=(count, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = np.stack([side, np.cross(back, side), back], axis=-1)
    matrices[:, :3, 3] = segments_mm[:, 0]
    return matrices


def with_decoys(rng, points_px, decoys, hidden):
    """Detections (N, P, D) among wrong ones, and which are right; of a hidden share there are wrong ones only."""
    count = len(points_px)
    places = rng.uniform(0, IMAGE_PX, (count, decoys + 1, *points_px.shape[1:]))
    rank = rng.integers(0, decoys + 1, count)
    right = np.zeros((count, decoys + 1), dtype=bool)
    shown = np.flatnonzero(rng.random(count) >= hidden)
    places[shown, rank[shown]] = points_px[shown]
    right[shown, rank[shown]] = True
    if decoys == 0:  # nothing is found where the needle is hidden
        places, right = places[right][:, None], right[right][:, None]
        frame = shown
    else:
        frame = np.repeat(np.arange(count), decoys + 1)
    places = places.reshape(-1, *points_px.shape[1:])
    variance = np.full((len(frame), places.shape[1], 1, 1), 0.25) * np.eye(places.shape[2])
    return Detections(frame, places, variance, images=count, source="recording"), right.reshape(-1)


def with_tracker_moved(recording, other):
    """The recording as a tracker elsewhere would have made it; other is (4, 4)."""
    poses = {
        name: Poses.of(one.source, one.target, other @ one.matrices) for name, one in recording.poses.items()
    }
    return replace(recording, poses=poses)


def with_marker_moved(recording, tool, tool_from_marker):
    """The recording with a tool's marker put elsewhere on it."""
    name = f"tracker_from_{tool.lower()}"
    one = recording.poses[name]
    moved = Poses(one.source, one.target, one.matrices @ tool_from_marker, one.valid)
    return replace(recording, poses={**recording.poses, name: moved})


def spots(places, *, sigma=2.5, noise=6.0, seed=0, shape=SHAPE):
    """(len(places), *shape) uint8: an image a list of places (u, v), bright there, in speckle."""
    v, u = np.mgrid[: shape[0], : shape[1]]
    rng = np.random.default_rng(seed)
    images = 60 + rng.normal(scale=noise, size=(len(places), *shape))
    for i, here in enumerate(places):
        for height, (x, y) in zip(np.linspace(150, 100, len(here)), here, strict=True):
            images[i] += height * np.exp(-0.5 * ((u - x) ** 2 + (v - y) ** 2) / sigma**2)
    return images.clip(0, 255).astype(np.uint8)


def tubes(segments, *, noise=3.0, side=40, seed=0):
    """(len(segments), side, side, side) uint8: a volume a segment (2, 3), bright along it, indexed [w, v, u]."""
    w, v, u = np.mgrid[:side, :side, :side]
    rng = np.random.default_rng(seed)
    volumes = 60 + rng.normal(scale=noise, size=(len(segments), side, side, side))
    for i, (first, second) in enumerate(np.asarray(segments, dtype=float)):
        points, along = np.stack([u, v, w], axis=-1) - first, second - first
        t = np.clip(points @ along / (along @ along), 0, 1)
        volumes[i] += 150 * np.exp(-0.5 * ((points - t[..., None] * along) ** 2).sum(-1) / 1.5**2)
    return volumes.clip(0, 255).astype(np.uint8)


def recording_of_images(images, dimension=2):
    """A recording of images (N, rows, columns) or volumes, without poses."""
    frames = ArrayFrames(np.asarray(images))
    return Recording(
        times=np.arange(len(images)) / 20, frames=frames, image=ImageGeometry.of(frames, dimension, "MF")
    )
