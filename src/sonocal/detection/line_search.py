"""Where lines may be in a volume: bright voxels of a coarser one, and lines through pairs of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = [
    "SHELL_PX",
    "bright_voxels",
    "distances",
    "prominence",
    "prominence_along",
    "strongest_line",
    "voxels",
]

COARSE_SIDE = 64
BRIGHT = 300
FINE_PX, WIDE_PX = 0.8, 2.5
NOISE_BLOCK = 4
"""Coarse voxels over which the noise is taken to be even."""
LEAST_SCORE = 3.0
PAIRS = 500
NEAR_PX, SHELL_PX = 1.5, 4.0
"""Of the coarse volume: what belongs to a line, and what around it must be dark."""
LEAST_LENGTH_PX = 5.0


def prominence(grey: NDArray[np.float32]) -> tuple[NDArray[np.float32], int]:
    """How far voxels of a coarse volume stand out from what surrounds them, in units of noise, and its step."""
    from scipy.ndimage import gaussian_filter

    pool = max(1, round(max(grey.shape) / COARSE_SIDE))
    coarse = _pooled(grey, pool)
    inside = (coarse > 0).astype(np.float32)
    fine = gaussian_filter(coarse, FINE_PX, truncate=2.5)
    wide, weight = (gaussian_filter(part, WIDE_PX, truncate=2.0) for part in (coarse, inside))
    response = (fine - wide / np.maximum(weight, 0.05)) * inside
    return response / _noise(response, inside), pool


def bright_voxels(prominent: NDArray[np.float32]) -> tuple[Array, Array]:
    """Places (N, 3) in a coarse volume that stand out most, and how far (N,)."""
    flat = prominent.reshape(-1)
    top = np.argpartition(-flat, min(BRIGHT, flat.size - 1))[:BRIGHT]
    top = np.sort(top[flat[top] > LEAST_SCORE])
    places = np.stack(np.unravel_index(top, prominent.shape)[::-1], axis=-1).astype(float)
    return places, flat[top].astype(float)


def prominence_along(prominent: NDArray[np.float32], pool: int, ends: Array) -> float:
    """How far a line (2, 3) px of the volume stands out on average."""
    from scipy.ndimage import map_coordinates

    first, last = (ends - 0.5 * (pool - 1)) / pool
    steps = np.linspace(0, 1, 1 + int(np.linalg.norm(last - first)))[:, None]
    places = first + steps * (last - first)
    return float(map_coordinates(prominent, places.T[::-1], order=1).mean())


def _noise(response: NDArray[np.float32], inside: NDArray[np.float32]) -> NDArray[np.float32]:
    """The noise around every voxel: under the probe's face and in bright tissue there is more of it."""
    from scipy.ndimage import gaussian_filter

    pad = [(0, -n % NOISE_BLOCK) for n in response.shape]
    size, weight = (
        gaussian_filter(_pooled(np.pad(part, pad), NOISE_BLOCK), 1.0) for part in (np.abs(response), inside)
    )
    # The mean of |x| is 0.8 standard deviations of a normal deviate.
    local = 1.25 * size / np.maximum(weight, 0.05)
    for axis in range(local.ndim):
        local = np.repeat(local, NOISE_BLOCK, axis=axis)
    return np.asarray(np.maximum(local[tuple(slice(n) for n in response.shape)], 1.0))


def _pooled(values: NDArray[np.float32], pool: int) -> NDArray[np.float32]:
    """Means over cubes."""
    for axis in range(values.ndim):
        count = values.shape[axis] // pool * pool
        parts = [values[(slice(None),) * axis + (slice(k, count, pool),)] for k in range(pool)]
        values = sum(parts[1:], start=parts[0])
    return np.asarray(values / np.float32(pool**values.ndim), dtype=np.float32)


def strongest_line(
    places: Array, weights: Array, rng: np.random.Generator, near: float = NEAR_PX
) -> tuple[Array, float] | None:
    """Of lines through random pairs the one with most brightness on it and least around it; its extent and score."""
    chance = weights / weights.sum()
    pairs = rng.choice(len(places), size=(PAIRS, 2), p=chance)
    first, second = places[pairs[:, 0]], places[pairs[:, 1]]
    along = second - first
    length = np.linalg.norm(along, axis=1)
    keep = length > LEAST_LENGTH_PX
    if not keep.any():
        return None
    first, along = first[keep], along[keep] / length[keep, None]
    offset = places - first[:, None]
    t = np.einsum("pni,pi->pn", offset, along)
    distance = np.sqrt(np.maximum((offset**2).sum(-1) - t**2, 0))
    score = ((distance <= near) - 0.5 * ((distance > near + 1) & (distance <= SHELL_PX))) @ weights
    best = int(np.argmax(score))
    if score[best] <= 0:
        return None
    on = t[best][distance[best] <= near]
    return first[best] + np.array([[on.min()], [on.max()]]) * along[best], float(score[best])


def voxels(places: Array, pool: int) -> Array:
    """Places in a coarse volume as those in the volume itself."""
    return places * pool + 0.5 * (pool - 1)


def distances(points: Array, ends: Array) -> Array:
    """(N,): of points (N, 3) to the line through two ends."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    return np.asarray(np.linalg.norm(np.cross(points - ends[0], along), axis=1))
