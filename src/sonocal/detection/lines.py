"""The needle as a line in a volume: bright voxels, a robust line through them, refined section by section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.detection.grey import as_grey
from sonocal.detection.points import PointDetector, Progress
from sonocal.detection.slices import slice_volume
from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.recording import Recording

__all__ = ["LineCandidate", "LineCandidates", "detect_lines", "detect_volumes", "line_through_slices"]

COUNT = 3
COARSE_SIDE = 64
BRIGHT = 300
FINE_PX, WIDE_PX = 0.8, 2.5
NOISE_BLOCK = 4
"""Coarse voxels over which the noise is taken to be even."""
LEAST_SCORE = 4.0
PAIRS = 500
NEAR_PX, SHELL_PX = 1.5, 4.0
"""Of the coarse volume: what belongs to a line, and what around it must be dark."""
REACH_PX, STEP_PX = 6, 0.5
SECTION_PX = 3.0
"""What belongs to a line through slices."""
CUT = 0.85
CORRELATION_PX = 3.0
"""Sections closer than the point spread see the same speckle: they are not independent."""
LEAST_LENGTH_PX = 10.0
FLOOR_PX2 = 0.02
LEAST_POINTS = 4


@dataclass(frozen=True, eq=False)
class LineCandidate:
    """A line that may be the needle.

    Attributes:
        ends_px: (2, 3): where it begins and ends, (u, v, w).
        covariance_px2: (2, 3, 3): of the ends, across the line; along it an end means nothing.
        score: brightness along the line against what surrounds it.
    """

    ends_px: Array
    covariance_px2: Array
    score: float

    @property
    def direction(self) -> Array:
        """Unit vector; its sign has no meaning."""
        along = self.ends_px[1] - self.ends_px[0]
        return np.asarray(along / np.linalg.norm(along))

    @property
    def sigma_px(self) -> Array:
        """(2,): standard deviation of an end across the line, the mean over both directions."""
        return np.asarray(np.sqrt(np.trace(self.covariance_px2, axis1=1, axis2=2) / 2))


@dataclass(frozen=True, eq=False)
class LineCandidates:
    """Lines that may be the needle; all have one entry a candidate, best first within a volume.

    Attributes:
        frame: (N,) index of the volume.
        rank: (N,): 0 for the best candidate of its volume.
        lines: (N,).
        frames: how many volumes were looked at.
    """

    frame: NDArray[np.int64]
    rank: NDArray[np.int64]
    lines: tuple[LineCandidate, ...]
    frames: int

    def __len__(self) -> int:
        return len(self.lines)


def detect_volumes(
    recording: Recording, *, count: int = COUNT, progress: Progress | None = None
) -> LineCandidates:
    """Lines in every valid volume of a recording, one volume in memory at a time.

    Args:
        recording: 3D images.
        count: candidates a volume at the most.
        progress: called with how many volumes are done and how many there are.

    Raises:
        InputError: there are no volumes.
    """
    if recording.image is None or recording.image.dimension != 3 or len(recording.frames) == 0:
        raise InputError(f"{recording.name}: has no volumes to look for a needle in; record volumes too")
    found: list[LineCandidate] = []
    frame: list[int] = []
    rank: list[int] = []
    for i, volume in enumerate(recording.frames):
        if recording.image_valid[i]:
            lines = detect_lines(volume, count, name=f"{recording.name}, frame {i}")
            found += lines
            frame += [i] * len(lines)
            rank += range(len(lines))
        if progress is not None:
            progress(i + 1, len(recording))
    return LineCandidates(
        np.array(frame, dtype=np.int64),
        np.array(rank, dtype=np.int64),
        tuple(found),
        int(recording.image_valid.sum()),
    )


def detect_lines(
    volume: NDArray[Any], count: int = COUNT, *, seed: int = 0, name: str = "volume"
) -> list[LineCandidate]:
    """Lines in a volume, best first.

    Args:
        volume: indexed [w, v, u].
        count: how many at the most.
        seed: of the pairs of voxels tried.
        name: what messages call it.

    Returns:
        None to `count` candidates.

    Raises:
        InputError: the volume has another shape or is too small.
    """
    grey = as_grey(volume, 3, name)
    places, weights, pool = _bright_voxels(grey)
    rng = np.random.default_rng(seed)
    found: list[LineCandidate] = []
    while len(found) < count and len(places) >= LEAST_POINTS:
        coarse = _strongest(places, weights, rng)
        if coarse is None:
            break
        ends, score = coarse
        line = _refined(grey, _voxels(ends, pool), score)
        if line is not None and all(_apart(line, other) for other in found):
            found.append(line)
        left = _distances(places, ends) > SHELL_PX
        places, weights = places[left], weights[left]
    return sorted(found, key=lambda line: -line.score)


def line_through_slices(
    volume: NDArray[Any],
    angles: Sequence[float],
    offsets_px: Sequence[float] = (-16.0, 0.0, 16.0),
    *,
    seed: int = 0,
) -> LineCandidate | None:
    """The line through the needle's sections in slices: the paper's way (section 9).

    Args:
        volume: indexed [w, v, u].
        angles: rad, see `slice_volume`; slices across the needle show it best.
        offsets_px: of the slices from the volume's middle, so that they meet the needle in different places.
        seed: of the pairs tried.

    Returns:
        The line, or None where no three sections lie on one.
    """
    grey = as_grey(volume, 3)
    points, weights = [np.empty((0, 3))], [np.empty(0)]
    for angle in angles:
        for offset in offsets_px:
            cut = slice_volume(grey, angle, offset_px=offset)
            mask = cut.image > 0
            if mask.any():
                found, _, score = PointDetector(mask, 3, centre="mass").detect(
                    cut.image.clip(0, 255).astype(np.uint8)
                )
                points.append(cut.to_volume(found))
                weights.append(score)
    places, strength = np.concatenate(points), np.concatenate(weights)
    line = (
        _strongest(places, strength, np.random.default_rng(seed), near=SECTION_PX)
        if len(places) >= 3
        else None
    )
    if line is None:
        return None
    near = _distances(places, line[0]) <= SECTION_PX
    return (
        _fit(places[near], strength[near], line[1], independent=int(near.sum())) if near.sum() >= 3 else None
    )


def _bright_voxels(grey: NDArray[np.float32]) -> tuple[Array, Array, int]:
    """Places (N, 3) in a coarse volume, how far they stand out in units of noise, and the coarse volume's step."""
    from scipy.ndimage import gaussian_filter

    pool = max(1, round(max(grey.shape) / COARSE_SIDE))
    coarse = _pooled(grey, pool)
    inside = (coarse > 0).astype(np.float32)
    fine = gaussian_filter(coarse, FINE_PX, truncate=2.5)
    wide, weight = (gaussian_filter(part, WIDE_PX, truncate=2.0) for part in (coarse, inside))
    response = (fine - wide / np.maximum(weight, 0.05)) * inside
    flat = (response / _noise(response, inside)).reshape(-1)
    top = np.argpartition(-flat, min(BRIGHT, flat.size - 1))[:BRIGHT]
    top = np.sort(top[flat[top] > LEAST_SCORE])
    places = np.stack(np.unravel_index(top, response.shape)[::-1], axis=-1).astype(float)
    return places, flat[top].astype(float), pool


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


def _strongest(
    places: Array, weights: Array, rng: np.random.Generator, near: float = NEAR_PX
) -> tuple[Array, float] | None:
    """Of lines through random pairs the one with most brightness on it and least around it; its extent and score."""
    chance = weights / weights.sum()
    pairs = rng.choice(len(places), size=(PAIRS, 2), p=chance)
    first, second = places[pairs[:, 0]], places[pairs[:, 1]]
    along = second - first
    length = np.linalg.norm(along, axis=1)
    keep = length > LEAST_LENGTH_PX / 2
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


def _refined(grey: NDArray[np.float32], ends: Array, score: float) -> LineCandidate | None:
    """The line through the brightest place of every section across it."""
    line: LineCandidate | None = None
    for reach in (REACH_PX, REACH_PX // 2):
        if np.linalg.norm(ends[1] - ends[0]) < LEAST_LENGTH_PX:
            return line
        points, weights = _sections(grey, ends, reach)
        if len(points) < LEAST_POINTS:
            return line
        line = _fit(points, weights, score)
        ends = line.ends_px
    return line


def _sections(grey: NDArray[np.float32], ends: Array, reach: int) -> tuple[Array, Array]:
    """Centre and contrast of the bright spot in sections one voxel apart across a line."""
    from scipy.ndimage import map_coordinates

    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    along /= length
    side = np.cross(along, [0.0, 1.0, 0.0] if abs(along[1]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    other = np.cross(along, side)
    steps = np.arange(-reach, reach + STEP_PX, STEP_PX)
    a, b = (grid.reshape(-1) for grid in np.meshgrid(steps, steps))
    inside = np.hypot(a, b) <= reach
    patch = a[inside, None] * side + b[inside, None] * other
    starts = ends[0] + np.arange(0, length + 0.5)[:, None] * along
    places = starts[:, None] + patch
    values = map_coordinates(grey, places.reshape(-1, 3).T[::-1], order=1, mode="constant").reshape(
        places.shape[:2]
    )
    background = np.median(values, axis=1, keepdims=True)
    top = values.max(axis=1, keepdims=True)
    # Only what is nearly as bright as the first echo counts: its reverberations lie right behind it.
    weight = np.maximum(values - background - CUT * (top - background), 0)
    total = weight.sum(axis=1)
    contrast = (top - background)[:, 0]
    keep = (total > 0) & (contrast > 0.3 * np.median(contrast))
    centres = starts[keep] + (weight[keep] @ patch) / total[keep, None]
    return centres, contrast[keep]


def _fit(points: Array, weights: Array, score: float, independent: int | None = None) -> LineCandidate:
    """A line by iteratively reweighted total least squares (Huber), and its ends' covariance."""
    weight = weights / weights.mean()
    for _ in range(10):
        middle = np.average(points, axis=0, weights=weight)
        spread = (points - middle) * np.sqrt(weight)[:, None]
        along = np.linalg.svd(spread, full_matrices=False)[2][0]
        t = (points - middle) @ along
        distance = np.linalg.norm(points - middle - t[:, None] * along, axis=1)
        sigma = max(1e-3, float(np.median(distance)) / 1.1774)
        weight = weights / weights.mean() * np.minimum(1.0, 2 * sigma / np.maximum(distance, 1e-9)) ** 2
    held = distance <= 5 * sigma
    ends_t = np.array([t[held].min(), t[held].max()])
    count = independent or max(2.0, (ends_t[1] - ends_t[0]) / CORRELATION_PX)
    share = 1 / count + (ends_t - t[held].mean()) ** 2 / (count * max(t[held].var(), 1e-9))
    across = np.eye(3) - np.outer(along, along)
    covariance = (sigma**2 * share + FLOOR_PX2)[:, None, None] * across
    return LineCandidate(middle + ends_t[:, None] * along, covariance, score)


def _voxels(places: Array, pool: int) -> Array:
    return places * pool + 0.5 * (pool - 1)


def _distances(points: Array, ends: Array) -> Array:
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    return np.asarray(np.linalg.norm(np.cross(points - ends[0], along), axis=1))


def _apart(line: LineCandidate, other: LineCandidate) -> bool:
    return bool(
        _distances(line.ends_px, other.ends_px).max() > 2 * REACH_PX
        or abs(line.direction @ other.direction) < 0.95
    )
