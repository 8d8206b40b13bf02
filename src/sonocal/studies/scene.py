"""Many independent simulated scenes at a time, by the paper's protocol and beyond it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.simulation.scene import IMAGE_PX, MARKER_DISTANCE_MM, NEEDLE_MM, PAPER_SCALE_MM_PER_PX

__all__ = ["BLOCK_TRIALS", "Scene", "Trials", "simulate_block"]

BLOCK_TRIALS = 200
"""Trials simulated together, always all of them: what a trial sees depends on its block's number alone."""


class Scene(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What a trial looks like.

    Attributes:
        dimension: 2 or 3, the probe's.
        needles: poses of the needle that a trial calibrates from.
        pool: 0: every trial has its own probe and poses. Otherwise one probe and so many poses stay for the whole
            study, and a trial takes `needles` of them at random (paper section 9.1); noise is new in each trial.
        image_px: side of the square or cubic image.
        scale_mm_per_px: true scale.
        needle_mm: distance of the needle's tracked ends.
        crossing: the image crosses a needle within this share of its length from its middle.
        reach_mm: 0: the image is between the tracked ends. Otherwise both are on the needle's handle, and the image is
            up to so far beyond them.
        tilt_deg: needles lie within this angle of the image's normal (2D) or of its third axis (3D); 90: anywhere.
        sigma_px: noise of an image point along each axis.
        sigma_mm: noise of a needle's end along each axis.
        probe_sigma_mm: noise of the probe marker's place along each axis, where the probe moves.
        probe_sigma_deg: noise of the probe marker's turn about each axis.
        outlier_share: share of the needles whose image points are uniform over the image.
        latency_ms: how late the tracker's poses are.
        speed_mm_s: speed of needle and probe against one another, in a random direction at each sighting.
        turn_deg_s: how fast they turn against one another, about a random axis through the image's centre.
        depth_mm: where the error at a target is measured: so deep in the middle of the image.
        crosswires: sightings of a cross-wire that a tracked tip has touched (paper section 9.2).
    """

    dimension: int = 2
    needles: int = 10
    pool: int = 0
    image_px: float = IMAGE_PX
    scale_mm_per_px: float = PAPER_SCALE_MM_PER_PX
    needle_mm: float = NEEDLE_MM
    crossing: float = 0.4
    reach_mm: float = 0.0
    tilt_deg: float = 90.0
    sigma_px: float = 1.0
    sigma_mm: float = 1.0
    probe_sigma_mm: float = 0.0
    probe_sigma_deg: float = 0.0
    outlier_share: float = 0.0
    latency_ms: float = 0.0
    speed_mm_s: float = 10.0
    turn_deg_s: float = 5.0
    depth_mm: float = 60.0
    crosswires: int = 0

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Trials:
    """T trials of N rows each; a needle gives one row in 2D and two in turn in 3D.

    Attributes:
        points: (T, N, 3), px: as measured; the third coordinate is 0 in 2D.
        segments: (T, N, 2, 3), mm: as measured, in the probe marker's frame.
        true_points, true_segments: the same without noise.
        sound: (T, N): whether the row is no outlier.
        truth: (T, 4, 4): the true calibrations, mm from px.
        wire_points: (T, K, 3), px: a cross-wire where the image shows it.
        wire_places: (T, K, 3), mm: where the tip says that it is, in the probe marker's frame.
        seeds: (T,): for the methods' own random samples.
        white: (T, 7): standard normal numbers, for draws from the bound's distribution.
    """

    points: Array
    segments: Array
    true_points: Array
    true_segments: Array
    sound: NDArray[np.bool_]
    truth: Array
    wire_points: Array
    wire_places: Array
    seeds: NDArray[np.uint64]
    white: Array

    def __len__(self) -> int:
        return len(self.points)

    def first(self, count: int) -> Trials:
        """The first so many trials."""
        return Trials(**{name: np.ascontiguousarray(values[:count]) for name, values in vars(self).items()})


def simulate_block(scene: Scene, seed: int, key: int, block: int) -> Trials:
    """A block of trials; the same for the same arguments on every machine with this NumPy.

    Args:
        scene: what a trial looks like.
        seed: the study's.
        key: of the scene among the study's: scenes of different keys share nothing.
        block: the block's number.
    """
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(key, block)))
    if scene.pool:
        fixed = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(scene.dimension,)))
        poses = _poses(scene, fixed, 1, scene.pool)
        chosen = rng.random((BLOCK_TRIALS, scene.pool)).argsort(axis=1)[:, : scene.needles]
        poses = _Poses(
            np.repeat(poses.rotation, BLOCK_TRIALS, axis=0),
            np.repeat(poses.translation, BLOCK_TRIALS, axis=0),
            poses.points[0, chosen],
            poses.segments[0, chosen],
        )
    else:
        poses = _poses(scene, rng, BLOCK_TRIALS, scene.needles)
    return _measured(scene, rng, poses)


@dataclass(frozen=True, eq=False)
class _Poses:
    """What is true: the calibration, image points (T, n, rows a needle, 3), px, and segments (T, n, 2, 3), mm."""

    rotation: Array
    translation: Array
    points: Array
    segments: Array


def _poses(scene: Scene, rng: np.random.Generator, trials: int, needles: int) -> _Poses:
    rotation = _rotations(rng.normal(size=(trials, 4)))
    translation = rng.uniform(-1, 1, (trials, 3)) * MARKER_DISTANCE_MM
    size = scene.image_px
    middle = rng.uniform(0, size, (trials, needles, 3))
    along = _directions(scene, rng, (trials, needles))
    if scene.dimension == 2:
        middle[..., 2] = 0
        points = middle[:, :, None]
    elif scene.tilt_deg < 90:
        # As far both ways as the volume reaches, less a random share.
        room = np.min(
            np.minimum(middle, size - middle) / np.maximum(np.abs(along), 1e-9), axis=-1, keepdims=True
        )
        half = room * rng.uniform(0.2, 1, room.shape) * along
        points = np.stack([middle - half, middle + half], axis=2)
    else:
        # Two places anywhere, as slices of the volume at different angles give them (paper section 9).
        points = np.stack([middle, rng.uniform(0, size, middle.shape)], axis=2)
        along = points[:, :, 1] - points[:, :, 0]
        along /= np.linalg.norm(along, axis=-1, keepdims=True)
        middle = points.mean(axis=2)
    crossed = _carried(rotation, translation, scene.scale_mm_per_px * middle)
    direction = np.einsum("tij,tnj->tni", rotation, along)
    # The image is somewhere along the needle, not always at its middle.
    spread = rng.uniform(-1, 1, (trials, needles, 1))
    if scene.reach_mm:
        before = scene.needle_mm + (0.5 + 0.5 * spread) * scene.reach_mm
    else:
        before = (0.5 + scene.crossing * spread) * scene.needle_mm
    ends = [crossed - before * direction, crossed + (scene.needle_mm - before) * direction]
    return _Poses(rotation, translation, points, np.stack(ends, axis=2))


def _directions(scene: Scene, rng: np.random.Generator, shape: tuple[int, int]) -> Array:
    """Unit vectors (..., 3), uniform within the tilt about the third axis."""
    height = rng.uniform(np.cos(np.radians(scene.tilt_deg)), 1, shape)
    turn = rng.uniform(0, 2 * np.pi, shape)
    away = np.sqrt(1 - height**2)
    return np.stack([away * np.cos(turn), away * np.sin(turn), height], axis=-1)


def _measured(scene: Scene, rng: np.random.Generator, poses: _Poses) -> Trials:
    rotation, translation, points, segments = poses.rotation, poses.translation, poses.points, poses.segments
    trials, needles, per_needle = points.shape[:3]
    axes = np.arange(3) < scene.dimension
    seen = points + rng.normal(scale=scene.sigma_px, size=points.shape) * axes
    ends = segments + rng.normal(scale=scene.sigma_mm, size=segments.shape)
    centre = translation + np.einsum(
        "tij,j->ti", rotation, 0.5 * scene.scale_mm_per_px * scene.image_px * axes
    )
    ends = _late(scene, rng, ends, centre)
    ends = _seen_from_noisy_probe(scene, rng, ends)
    outlier = rng.random((trials, needles)).argsort(axis=1) < round(scene.outlier_share * needles)
    nonsense = rng.uniform(0, scene.image_px, points.shape) * axes
    seen = np.where(outlier[..., None, None], nonsense, seen)
    wires = rng.uniform(0, scene.image_px, (trials, scene.crosswires, 3)) * axes
    places = _carried(rotation, translation, scene.scale_mm_per_px * wires)
    touched = places + rng.normal(scale=scene.sigma_mm, size=places.shape)
    truth = np.zeros((trials, 4, 4))
    truth[:, :3, :3], truth[:, :3, 3], truth[:, 3, 3] = scene.scale_mm_per_px * rotation, translation, 1

    def by_row(values: NDArray[Any]) -> NDArray[Any]:
        return np.repeat(values, per_needle, axis=1)

    return Trials(
        points=seen.reshape(trials, -1, 3),
        segments=by_row(ends),
        true_points=points.reshape(trials, -1, 3),
        true_segments=by_row(segments),
        sound=by_row(~outlier),
        truth=truth,
        wire_points=wires + rng.normal(scale=scene.sigma_px, size=wires.shape) * axes,
        wire_places=_seen_from_noisy_probe(scene, rng, touched[:, :, None])[:, :, 0],
        seeds=np.asarray(rng.integers(2**63, size=trials, dtype=np.uint64)),
        white=rng.normal(size=(trials, 7)),
    )


def _late(scene: Scene, rng: np.random.Generator, ends: Array, centre: Array) -> Array:
    """Needles where they were a latency ago: each has moved and turned about the image's centre (T, 3)."""
    if scene.latency_ms == 0:
        return ends
    seconds = 1e-3 * scene.latency_ms
    shift = seconds * scene.speed_mm_s * _unit(rng.normal(size=(*ends.shape[:2], 3)))
    turn = _turns(seconds * np.radians(scene.turn_deg_s) * _unit(rng.normal(size=(*ends.shape[:2], 3))))
    about = centre[:, None, None]
    return np.asarray(np.einsum("tnij,tnkj->tnki", turn, ends - about) + about + shift[:, :, None])


def _seen_from_noisy_probe(scene: Scene, rng: np.random.Generator, points: Array) -> Array:
    """Points (T, n, k, 3) in the frame of a marker whose tracked pose is off, by itself at each sighting.

    Only the pose of the needle against the probe enters a calibration, so a probe that moves is a probe that
    rests with its pose's noise on every sighting.
    """
    if scene.probe_sigma_mm == 0 and scene.probe_sigma_deg == 0:
        return points
    shape = (*points.shape[:2], 3)
    turn = _turns(rng.normal(scale=np.radians(scene.probe_sigma_deg), size=shape))
    shift = rng.normal(scale=scene.probe_sigma_mm, size=shape)
    return np.asarray(np.einsum("tnij,tnkj->tnki", turn, points) + shift[:, :, None])


def _carried(rotation: Array, translation: Array, points: Array) -> Array:
    return np.asarray(np.einsum("tij,tnj->tni", rotation, points) + translation[:, None])


def _unit(vectors: Array) -> Array:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def _turns(rotvec: Array) -> Array:
    """Rotations (..., 3, 3) of rotation vectors (..., 3), rad."""
    angle = np.linalg.norm(rotvec, axis=-1, keepdims=True)
    return _rotations(
        np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / (2 * np.pi)) * rotvec], axis=-1)
    )


def _rotations(quaternions: Array) -> Array:
    """Rotations (..., 3, 3) of quaternions (..., 4), w first, of any length; normal ones give uniform rotations."""
    w, x, y, z = np.moveaxis(_unit(quaternions), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
