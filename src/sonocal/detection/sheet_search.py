"""Where walls may be: points of ridges in a coarser image or volume, and straight sheets through some of them.

A wall is a line of an image and a plane of a volume: the same search, of as many points as its space has axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = ["Ridges", "find_ridges", "strongest_sheet"]

COARSE_SIDE = {2: 160, 3: 64}
"""Of the image or volume, in coarse pixels, about."""
ASIDE_PX = {2: (3, 6), 3: (2, 4)}
"""How far from a ridge either side of it is looked at: it is darker there. Coarse pixels, as all below."""
NOISE_PX = {2: 12.0, 3: 5.0}
"""Over which the noise is taken to be even."""
FINE_PX, WIDE_PX = 1.0, 4.0
FEWEST_GREY = 2.0
"""Noise in grey levels where there is none: water is black."""
LEAST = 2.0
MOST = 8.0
"""In units of noise: what is fainter is no ridge; what is brighter counts no more, so that a spot outshines no wall."""
POINTS = {2: 900, 3: 1500}
SAMPLES = {2: 600, 3: 1500}
NEAR_PX, APART_PX, AROUND_PX = 1.2, 2.2, 4.6
"""What belongs to a sheet; and from where to where what surrounds it must be dark."""
LEAST_SPREAD_PX = 6.0
"""Of a sample's points: nearer ones tell no direction."""


@dataclass(frozen=True, eq=False)
class Ridges:
    """Points brighter than both sides of something that passes through them.

    Attributes:
        places: (N, D), in coarse pixels, (u, v[, w]).
        weights: (N,): how far they stand out, in units of noise, up to a limit.
        pool: pixels of the image to a coarse one, along each axis.
    """

    places: Array
    weights: Array
    pool: int

    def __len__(self) -> int:
        return len(self.weights)

    def fine(self, places: Array) -> Array:
        """Coarse places as those in the image itself."""
        return np.asarray(places * self.pool + 0.5 * (self.pool - 1))

    def beyond(self, normal: Array, offset: float, reach: float) -> Ridges:
        """Those further than `reach` from a sheet ``normal . x = offset``."""
        keep = np.abs(self.places @ normal - offset) > reach
        return Ridges(self.places[keep], self.weights[keep], self.pool)


def find_ridges(grey: NDArray[np.float32], mask: NDArray[np.bool_]) -> Ridges:
    """Ridges of an image or a volume, those that stand out most.

    Both sides of a ridge are darker, and both are looked at: what ends at the mask, such as the bright band under the
    probe's face or the fan's edge, is none.
    """
    pool = max(1, round(max(grey.shape) / COARSE_SIDE[grey.ndim]))
    weight = _pooled(mask.astype(np.float32), pool)
    sums = _pooled(np.where(mask, grey, np.float32(0)), pool)
    coarse: NDArray[np.float32] = np.divide(sums, np.maximum(weight, 1e-3), dtype=np.float32)
    inside = weight > 0.5
    fine, wide = (_blurred(coarse, inside, width) for width in (FINE_PX, WIDE_PX))
    standing = _standing(fine, inside) / _noise(fine - wide, inside)
    flat = np.flatnonzero(standing > LEAST)
    most = POINTS[grey.ndim]
    if len(flat) > most:
        flat = np.sort(flat[np.argpartition(-standing.reshape(-1)[flat], most)[:most]])
    places = np.stack(np.unravel_index(flat, standing.shape)[::-1], axis=-1).astype(float)
    return Ridges(places, np.minimum(standing.reshape(-1)[flat].astype(float), MOST), pool)


def strongest_sheet(ridges: Ridges, rng: np.random.Generator) -> tuple[Array, float, float] | None:
    """Of sheets through random points the one with most on it and least around it.

    Returns:
        Its unit normal (D,), its offset, ``normal . x = offset``, coarse, and its score; None where there is none.
    """
    places, weights = ridges.places, ridges.weights
    axes = places.shape[1]
    if len(ridges) < 4 * axes:
        return None
    picked = rng.choice(len(places), size=(SAMPLES[axes], axes), p=weights / weights.sum())
    normal = _normals(places[picked])
    apart = np.isfinite(normal).all(axis=1)
    if not apart.any():
        return None
    normal, through = normal[apart], places[picked[apart, 0]]
    return _best(places, weights, normal, np.einsum("si,si->s", normal, through))


def _best(places: Array, weights: Array, normal: Array, offset: Array) -> tuple[Array, float, float] | None:
    away = np.abs(places @ normal.T - offset)
    on, around = away <= NEAR_PX, (away > APART_PX) & (away <= AROUND_PX)
    score = weights @ (on - 0.5 * around)
    best = int(np.argmax(score))
    return (normal[best], float(offset[best]), float(score[best])) if score[best] > 0 else None


def _normals(samples: Array) -> Array:
    """(S, D): of the sheets through samples (S, D, D); NaN where their points are too near one another."""
    sides = samples[:, 1:] - samples[:, :1]
    if samples.shape[1] == 2:
        normal = np.stack([-sides[:, 0, 1], sides[:, 0, 0]], axis=-1)
        least = LEAST_SPREAD_PX
    else:
        normal = np.cross(sides[:, 0], sides[:, 1])
        least = LEAST_SPREAD_PX**2
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.where(size > least, normal / np.maximum(size, 1e-12), np.nan)


def _standing(fine: NDArray[np.float32], inside: NDArray[np.bool_]) -> NDArray[np.float32]:
    """By how much each place that is the top of its section exceeds the brighter of its two sides, at most."""
    most = np.zeros_like(fine)
    closed = np.where(inside, fine, np.float32(np.inf))
    for way in _ways(fine.ndim):
        top = (fine >= _moved(fine, way)) & (fine >= _moved(fine, tuple(-x for x in way)))
        for far in ASIDE_PX[fine.ndim]:
            step = tuple(round(far * x / np.linalg.norm(way)) for x in way)
            sides = np.maximum(_moved(closed, step), _moved(closed, tuple(-x for x in step)))
            np.maximum(most, np.where(top, fine - sides, 0), out=most)
    return np.where(inside, most, np.float32(0))


def _ways(axes: int) -> list[tuple[int, ...]]:
    """Directions to neighbours, one of each two that are opposite."""
    return [way for way in product((-1, 0, 1), repeat=axes) if way > (0,) * axes]


def _moved(values: NDArray[np.float32], step: tuple[int, ...]) -> NDArray[np.float32]:
    """Each place's neighbour at a step; beyond the rim there is no end of brightness."""
    moved = np.full_like(values, np.inf)
    to = tuple(slice(max(0, -s), n - max(0, s)) for s, n in zip(step, values.shape, strict=True))
    of = tuple(slice(max(0, s), n + min(0, s)) for s, n in zip(step, values.shape, strict=True))
    moved[to] = values[of]
    return moved


def _noise(response: NDArray[np.float32], inside: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Around every place, of what the whole image has at most a few times: a wall is no noise."""
    size = np.where(inside, np.abs(response), np.float32(0))
    some = size[size > 0]
    usual = float(np.median(some)) if len(some) else 0.0
    around = _blurred(np.minimum(size, np.float32(3 * usual)), inside, NOISE_PX[response.ndim])
    # The mean of |x| is 0.8 standard deviations of a normal deviate.
    return np.asarray(np.maximum(np.float32(1.25) * around, np.float32(FEWEST_GREY)))


def _blurred(values: NDArray[np.float32], inside: NDArray[np.bool_], width: float) -> NDArray[np.float32]:
    """Blurred within the mask, of what is within it."""
    from scipy.ndimage import gaussian_filter

    part = inside.astype(np.float32)
    sums, weight = (gaussian_filter(one, width, truncate=2.5) for one in (values * part, part))
    return np.asarray(sums / np.maximum(weight, np.float32(0.02)))


def _pooled(values: NDArray[np.float32], pool: int) -> NDArray[np.float32]:
    """Means over squares or cubes."""
    for axis in range(values.ndim):
        count = values.shape[axis] // pool * pool
        parts = [values[(slice(None),) * axis + (slice(k, count, pool),)] for k in range(pool)]
        values = sum(parts[1:], start=parts[0])
    return np.asarray(values / np.float32(pool**values.ndim), dtype=np.float32)
