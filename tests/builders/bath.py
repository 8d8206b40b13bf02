"""Recordings of targets in a bath that nobody placed, and what may be one of them in each image; no image is drawn."""

from __future__ import annotations

import numpy as np
from benchmarks.simulators.places import Noise, sweep
from benchmarks.simulators.places_hand import IMAGE_PX

from sonocal.detection import Detections
from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording
from sonocal.recording.model import Provenance


def bath(kind, frames=80, seed=1, **more):
    """A recording whose images are black, and the scene (`benchmarks.simulators`) that it shows."""
    scene = sweep(kind, frames, seed, Noise(), **more)
    first = np.unique(scene.frame, return_index=True)[1]
    stack = ArrayFrames(np.zeros((frames, *IMAGE_PX[::-1]), np.uint8))
    poses = Poses.of("Probe", "Tracker", np.linalg.inv(scene.poses[first]))
    recording = Recording(
        times=np.arange(frames) / 20.0,
        frames=stack,
        poses={poses.name: poses},
        image=ImageGeometry.of(stack),
        provenance=Provenance(name="bath"),
    )
    return recording, scene


def shown(scene, each=1):
    """What images show of the target: numbers (M,) and points (M, each, 2)."""
    return scene.frame[::each], scene.points_px[:, :2].reshape(-1, each, 2)


def anywhere(frames, count, seed=0, each=1):
    """So many other things in each image."""
    random = np.random.default_rng([seed, 5])
    middle = random.uniform([0, 0], IMAGE_PX, (frames * count, 1, 2))
    half = random.normal(size=middle.shape) * 50
    points = np.concatenate([middle - half, middle + half], axis=1) if each == 2 else middle
    return np.repeat(np.arange(frames), count), points


def crossing(scene, place, seed=0):
    """Where images cross a further line (2, 3), with a pixel's noise; only where it is within the image."""
    poses = scene.true_poses[np.unique(scene.frame, return_index=True)[1]]
    image_from_room = np.linalg.inv(scene.truth) @ poses
    ends = place @ np.swapaxes(image_from_room[:, :3, :3], 1, 2) + image_from_room[:, None, :3, 3]
    share = ends[:, 0, 2] / (ends[:, 0, 2] - ends[:, 1, 2])
    points = ends[:, 0, :2] + share[:, None] * (ends[:, 1] - ends[:, 0])[:, :2]
    points += np.random.default_rng(seed).normal(size=points.shape)
    inside = ((points > 0) & (points < IMAGE_PX)).all(axis=1)
    return np.flatnonzero(inside), points[inside, None]


def seen(*parts, images, swapped=0):
    """Detections of parts (numbers, points), in every image those of the first parts best.

    So large a share of the images as `swapped` has its best and its second best the other way round.
    """
    frame = np.concatenate([part[0] for part in parts])
    points = np.concatenate([part[1] for part in parts])
    which = np.concatenate([np.full(len(part[0]), i) for i, part in enumerate(parts)]).astype(float)
    turned = np.random.default_rng(3).random(images) < swapped
    which[(which == 1) & turned[frame]] = -1
    order = np.lexsort((which, frame))
    each = points.shape[1]
    covariance = np.broadcast_to(np.eye(2), (len(frame), each, 2, 2))
    return Detections(
        frame[order], points[order], covariance, np.ones(len(frame)), images=images, source="bath"
    )
