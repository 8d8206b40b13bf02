"""A hand-held needle whose tracking errs as trackers do: slowly, by place, by gravity. NumPy only.

The truth is made here from nothing of sonocal's: a needle is moved through an image, a marker's pose is given to the
probe, and what the tracker says of both is off by an error that neighbouring frames, or neighbouring places, share.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SCALE, IMAGE_PX, NEEDLE_MM = 0.2, 500.0, 200.0
FRAMES_PER_S = 20.0


@dataclasses.dataclass(frozen=True)
class Drifting:
    """A scan: points (N, d) px and segments (N, 2, 3) mm, their frames (N,), the truth (4, 4), the poses (F, 4, 4)."""

    points_px: Array
    segments_mm: Array
    frame: NDArray[np.int64]
    probe_from_image: Array
    tracker_from_probe: Array


def turned(vector: Array) -> Array:
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad (Rodrigues)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*vector.shape[:-1], 3, 3)
    square = cross @ cross
    small = np.maximum(angle, 1e-12)
    return np.eye(3) + np.sin(angle) / small * cross + (1 - np.cos(angle)) / small**2 * square


def autoregression(rng: np.random.Generator, frames: int, memory: float, width: int = 3) -> Array:
    """(frames, width): of unit variance, correlated by exp(-frames / memory).

    With infinite memory, a random walk that has come as far as 1 at its end.
    """
    steps = rng.normal(size=(frames, width))
    if np.isinf(memory):
        return np.cumsum(steps, axis=0) / np.sqrt(frames)
    keeps, state = np.exp(-1 / memory), steps[0]
    out = [state]
    for step in steps[1:]:
        state = keeps * state + np.sqrt(1 - keeps**2) * step
        out.append(state)
    return np.array(out)


def smooth(rng: np.random.Generator, frames: int, seconds: float, width: int) -> Array:
    """(frames, width): what a hand does, between some -1 and 1, coming back about every `seconds`."""
    time = np.arange(frames)[:, None, None] / FRAMES_PER_S
    rates, phases = rng.uniform(0.5, 1.5, (4, width)) / seconds, rng.uniform(0, 2 * np.pi, (4, width))
    return np.sin(2 * np.pi * rates * time + phases).sum(axis=1) * 0.6


def field(rng: np.random.Generator, reach_mm: float = 250.0, waves: int = 12) -> Any:
    """A smooth random displacement of places (..., 3) mm, of unit variance: what metal does to an EM tracker."""
    directions, phases = rng.normal(size=(waves, 3)) / reach_mm, rng.uniform(0, 2 * np.pi, waves)
    sizes = rng.normal(size=(waves, 3)) * np.sqrt(2 / waves)
    return lambda places: np.cos(places @ directions.T + phases) @ sizes


def drifting_scan(
    seed: int,
    *,
    dimension: int = 2,
    frames: int = 300,
    memory: float = 0.0,
    drift_mm: float = 0.0,
    distortion_mm: float = 0.0,
    sag_mm: float = 0.0,
    repeats: int = 1,
    still: bool = False,
    both_ends: bool = True,
    sigma_px: float = 1.0,
    sigma_mm: float = 0.3,
) -> Drifting:
    """A needle moved through the image of a probe that moves, too.

    Args:
        seed: of everything random.
        dimension: 2 or 3, of the image.
        frames: images.
        memory: frames after which the drift has forgotten, e-fold; infinite for a random walk.
        drift_mm: the drift's standard deviation along every axis, at the needle.
        distortion_mm: of a field's displacement of the needle's marker, by where it is in the room.
        sag_mm: the needle's tip hangs lower than its marker says, in the room.
        repeats: so many neighbouring frames have one pose and one image, with another pixel noise.
        still: every frame is a new hold, not a hand's path.
        both_ends: the drift shifts the needle; False: its ends drift apart from one another.
        sigma_px: noise of a point.
        sigma_mm: noise of both ends of the needle.
    """
    rng = np.random.default_rng(seed)
    count = -(-frames // repeats)
    path = rng.uniform(-1, 1, (count, 11)) if still else np.clip(smooth(rng, count, 4.0, 11), -1, 1)
    rotation = turned(rng.normal(size=3))
    truth = np.eye(4)
    truth[:3, :3], truth[:3, 3] = SCALE * rotation, rotation @ [-50.0, 60.0, 10.0]

    # In the image's frame, mm: where the needle crosses, how it is tilted, how far its ends are.
    crossing = np.zeros((count, 3))
    crossing[:, :dimension] = (0.5 + 0.45 * path[:, :dimension]) * IMAGE_PX * SCALE
    along = np.column_stack([0.7 * path[:, 3:5], np.ones(count)])
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    before = NEEDLE_MM * (0.6 + 0.2 * path[:, 5:6])
    ends = np.stack([crossing - before * along, crossing + (NEEDLE_MM - before) * along], axis=1)
    shown = (
        crossing[:, None]
        if dimension == 2
        else crossing[:, None] + np.array([[0.0], [30.0]]) * along[:, None]
    )
    probe = ends @ rotation.T + truth[:3, 3]

    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = turned(0.5 * path[:, 8:11] + rng.normal(size=3))
    poses[:, :3, 3] = 100 * path[:, 5:8]
    into_probe = np.swapaxes(poses[:, :3, :3], 1, 2)
    if drift_mm:
        drift = autoregression(rng, count, memory, 3 if both_ends else 6)
        probe = probe + drift_mm * (drift[:, None] if both_ends else drift.reshape(count, 2, 3))
    room = np.einsum("nij,nkj->nki", poses[:, :3, :3], probe) + poses[:, None, :3, 3]
    if distortion_mm:
        shift = distortion_mm * field(rng)(room[:, :1])
        probe = probe + np.einsum("nij,nkj->nki", into_probe, np.broadcast_to(shift, probe.shape))
    if sag_mm:
        lower = np.zeros_like(probe)
        lower[:, 1, 2] = sag_mm  # the marker end is where it is said to be
        probe = probe + np.einsum("nij,nkj->nki", into_probe, lower)
    probe = probe + sigma_mm * rng.normal(size=probe.shape)

    each = np.repeat(np.arange(count), repeats)[:frames]
    seen = np.repeat(shown / SCALE, repeats, axis=0)[:frames, :, :dimension]
    points = seen + sigma_px * rng.normal(size=seen.shape)
    per_frame = seen.shape[1]
    row = np.repeat(each, per_frame)
    frame = np.repeat(np.arange(frames), per_frame)
    return Drifting(points.reshape(-1, dimension), probe[row], frame, truth, poses[each])
