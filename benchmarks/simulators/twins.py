"""A swept needle with a second one beside it: an echo below it in the image, or another needle in the same holder."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from sonocal.detection import Detections
from sonocal.geometry import Similarity
from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording
from sonocal.targets import Line

SCALE, IMAGE = 0.24, 500.0
NEEDLE_MM = 200.0
KINDS = ("echo", "second needle")


@dataclass(frozen=True, eq=False)
class TwinScan:
    """A recording, its needle, what was found in its images, and the truth."""

    recording: Recording
    lines: tuple[Line, ...]
    detections: Detections
    truth: Similarity


def twin_scan(
    seed: int,
    *,
    kind: str | None = None,
    apart_mm: float = 6.0,
    brighter: bool = True,
    dimension: int = 2,
    frames: int = 100,
    seen: float = 0.85,
    decoys: int = 2,
    sigma_px: float = 1.0,
    sigma_mm: float = 0.5,
) -> TwinScan:
    """A scan with a twin of the needle, or with none.

    Args:
        seed: of everything random.
        kind: "echo", straight below the needle in every image; "second needle", parallel to it in its own frame; None.
        apart_mm: how far the twin is from the needle.
        brighter: whether the twin stands before the needle where both are seen.
        dimension: 2 or 3, of the image.
        frames: images.
        seen: share of the images that show the needle, and independently the twin.
        decoys: bright spots anywhere, an image, at any rank.
        sigma_px: noise of a found point.
        sigma_mm: noise of the needle's ends.
    """
    rng = np.random.default_rng([seed, 77])
    truth = Similarity(Rotation.random(random_state=seed).as_matrix(), rng.uniform(-80, 80, 3), SCALE)
    crossing = np.zeros((frames, 3))
    crossing[:, :dimension] = rng.uniform(0.1, 0.9, (frames, dimension)) * IMAGE * SCALE
    # Held across the image, tilted by up to some 40 degrees, and rolled in the hand by some 20.
    base = Rotation.random(random_state=seed + 1) if dimension == 3 else Rotation.identity()
    held = Rotation.from_rotvec(rng.normal(scale=0.4, size=(frames, 3)) * [1, 1, 0]) * base
    held = held * Rotation.from_rotvec(rng.normal(scale=0.35, size=(frames, 1)) * [0, 0, 1])
    along, before = held.apply([0.0, 0.0, 1.0]), rng.uniform(60, 140, (frames, 1))
    angle = rng.uniform(0, 2 * np.pi)
    beside = held.apply(apart_mm * np.array([np.cos(angle), np.sin(angle), 0.0]))
    if kind == "echo":
        beside = np.tile([0.0, apart_mm, 0.0], (frames, 1))

    places = [(crossing, along, seen)]
    if kind is not None:
        places.append((crossing + beside, along, seen))
    found = _found(rng, places, dimension, brighter=brighter, decoys=decoys, sigma_px=sigma_px)
    return TwinScan(
        _recording(rng, truth, crossing - before * along, held, dimension=dimension, sigma_mm=sigma_mm),
        (Line("needle", "Needle", np.array([[0.0, 0.0, 0.0], [0.0, 0.0, NEEDLE_MM]])),),
        found,
        truth,
    )


def _found(rng, places, dimension, *, brighter, decoys, sigma_px):
    """Candidates of every image, the brightest first."""
    frame, points = [], []
    for image in range(len(places[0][0])):
        own = [
            _shown(middle[image], along[image], dimension) / SCALE
            for middle, along, seen in places
            if rng.random() < seen
        ]
        own = own[::-1] if brighter else own
        spots = list(rng.uniform(0, IMAGE, (decoys, dimension - 1, dimension)))
        for spot in spots:
            own.insert(int(rng.integers(0, len(own) + 1)), spot)
        frame += [image] * len(own)
        points += own
    each = np.array(points) + sigma_px * rng.normal(size=np.shape(points))
    return Detections(np.array(frame), each, images=len(places[0][0]), source="twins")


def _shown(middle, along, dimension):
    """(P, D) mm: where the image sees a line through a point."""
    if dimension == 3:
        return middle + np.array([[-25.0], [25.0]]) * along
    return (middle - middle[2] / along[2] * along)[None, :2]


def _recording(rng, truth, tips, held, *, dimension, sigma_mm):
    """Poses of needle and probe, with the tracker's noise on both ends of the needle."""
    count = len(tips)
    ends = np.stack([tips, tips + NEEDLE_MM * held.apply([0.0, 0.0, 1.0])], axis=1)
    ends = ends + sigma_mm * rng.normal(size=ends.shape)
    axis = ends[:, 1] - ends[:, 0]
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    side = held.apply([1.0, 0.0, 0.0])
    side = side - np.sum(side * axis, axis=1, keepdims=True) * axis
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    probe_from_needle = np.tile(np.eye(4), (count, 1, 1))
    probe_from_needle[:, :3, :3] = truth.rotation @ np.stack([side, np.cross(axis, side), axis], axis=-1)
    probe_from_needle[:, :3, 3] = ends[:, 0] @ truth.rotation.T + truth.translation
    tracker_from_probe = np.tile(np.eye(4), (count, 1, 1))
    tracker_from_probe[:, :3, :3] = Rotation.from_rotvec(rng.normal(scale=0.3, size=(count, 3))).as_matrix()
    tracker_from_probe[:, :3, 3] = rng.uniform(-200, 200, (count, 3))
    poses = [
        Poses.of("Probe", "Tracker", tracker_from_probe),
        Poses.of("Needle", "Tracker", tracker_from_probe @ probe_from_needle),
    ]
    size = (int(IMAGE),) * dimension
    blank = np.zeros((1, *size[::-1]), dtype=np.uint8)
    return Recording(
        times=np.arange(count) / 8.0,
        poses={one.name: one for one in poses},
        frames=ArrayFrames(np.broadcast_to(blank, (count, *size[::-1]))),
        image=ImageGeometry(size, 1, "uint8", "MF", np.eye(4)),
    )
