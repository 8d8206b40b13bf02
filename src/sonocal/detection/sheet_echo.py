"""Where a wall's first echo is, in sections across it.

As in `first_echo`: a Gaussian pulse, logarithmically compressed, is a parabola of grey levels, and it has its top where
the echo is. What follows the first echo lies behind it, so that the parabola is fitted to the flank that faces the
transducer. A slice that has a thickness sees a tilted wall blurred evenly to both sides: the top stays, the edge moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = ["STEP_PX", "WallEcho", "sampled", "wall_echo"]

STEP_PX = 0.5
WHITE = 250.0
"""Saturated pixels say nothing of the pulse's shape."""
DEEP, DEEP_OF_WHITE = 0.5, 0.85
"""Of the contrast, below the top: fainter are the pulse's wings, and the speckle; less is left of a saturated one."""
FIRST = 0.6
"""Of the contrast: the first top that is so bright is the first echo."""
BEYOND_PX = 0.5
"""How far behind the top a sample still belongs to the flank."""
LEAST_CONTRAST = 12.0
"""Grey levels; and of the usual contrast of the wall's sections:"""
FAINT = 0.35
ALONG_PX = 2.0
"""Sections blurred along the wall, standard deviation: speckle is."""
FARTHEST = 1.0
"""From the first top of a section to its parabola's, in parts of how far the parabola reaches."""
FEWEST = 3
"""Samples of a flank."""
WINDOW = 12.0
"""Sections that share a pulse's width, standard deviation."""
LEAST_CURVATURE = 0.1


@dataclass(frozen=True, eq=False)
class WallEcho:
    """The first echo in sections across a wall.

    Attributes:
        away_px: (N,): how far it lies from each station along the normal; NaN where there is none.
        contrast: (N,): grey levels by which it stands out from before and behind it, whichever is brighter.
    """

    away_px: Array
    contrast: Array


def wall_echo(
    grey: NDArray[np.float32], mask: NDArray[np.bool_], stations: Array, normal: Array, reach: float
) -> WallEcho:
    """The first echo along a normal from stations that lie within reach of it.

    Args:
        grey: an image or a volume.
        mask: where to look.
        stations: (N, D), (u, v[, w]), in the order in which they follow one another.
        normal: (D,): away from the transducer.
        reach: how far to look, px, either way.
    """
    from scipy.ndimage import gaussian_filter1d

    steps = np.arange(-reach, reach + STEP_PX / 2, STEP_PX)
    sections = sampled(grey, stations, normal, steps)
    seen = sampled(mask.astype(np.float32), stations, normal, steps)
    whole = np.asarray(np.all(seen > 0.99, axis=1))
    if stations.shape[1] == 2 and len(stations) > 1:
        weight = gaussian_filter1d(whole.astype(float), ALONG_PX)
        sums = gaussian_filter1d(np.where(whole[:, None], sections, 0.0), ALONG_PX, axis=0)
        sections = sums / np.maximum(weight, 1e-6)[:, None]
    first = _first_tops(sections)
    top = np.take_along_axis(sections, first[:, None], axis=1)[:, 0]
    contrast = top - _sides(sections, first)
    shown = whole & (contrast > LEAST_CONTRAST)
    usual = float(np.median(contrast[shown])) if shown.any() else np.inf
    shown &= contrast > FAINT * usual
    away = np.full(len(stations), np.nan)
    felt = int(np.ceil(np.abs(normal).sum() / STEP_PX)) - 1  # of linear interpolation
    away[shown] = _tops_of_flanks(sections[shown], steps, first[shown], contrast[shown], felt)
    return WallEcho(away, np.where(shown, contrast, 0.0))


def sampled(values: NDArray[np.float32], stations: Array, normal: Array, steps: Array) -> Array:
    """(N, S): along the normal through every station; 0 beyond the rim."""
    from scipy.ndimage import map_coordinates

    places = stations[:, None] + steps[:, None] * normal
    flat = places.reshape(-1, places.shape[-1]).T[::-1]
    sampled = map_coordinates(values, flat, order=1, mode="constant", output=np.float64)
    return np.asarray(sampled.reshape(places.shape[:2]))


def _first_tops(sections: Array) -> NDArray[np.int64]:
    """(N,): the first local maximum of each section that is nearly as bright as the brightest."""
    sections = np.minimum(sections, WHITE)
    low, high = sections.min(axis=1, keepdims=True), sections.max(axis=1, keepdims=True)
    bright = sections >= low + FIRST * (high - low)
    ahead = np.pad(sections, ((0, 0), (0, 1)), constant_values=-np.inf)[:, 1:]
    before = np.pad(sections, ((0, 0), (1, 0)), constant_values=-np.inf)[:, :-1]
    # Of a plateau, as of saturated pixels, the first: what follows it is no greater.
    return np.asarray(np.argmax(bright & (sections >= ahead) & (sections > before), axis=1))


def _sides(sections: Array, first: NDArray[np.int64]) -> Array:
    """(N,): the brighter of the darkest before and the darkest behind the first echo."""
    index = np.arange(sections.shape[1])
    before = np.where(index <= first[:, None], sections, np.inf).min(axis=1)
    behind = np.where(index >= first[:, None], sections, np.inf).min(axis=1)
    return np.asarray(np.maximum(before, behind))


def _tops_of_flanks(
    sections: Array, steps: Array, first: NDArray[np.int64], contrast: Array, felt: int
) -> Array:
    """(N,): tops of parabolas through each section's flank, of a curvature that neighbouring sections share.

    g = a + b s - c s^2 with the neighbours' c: its top is at b / 2 c. A saturated pixel is felt so many samples far.
    """
    top = np.take_along_axis(sections, first[:, None], axis=1)
    s = steps - steps[first][:, None]
    dark = sections < top - np.where(top < WHITE, DEEP, DEEP_OF_WHITE) * contrast[:, None]
    joined = np.cumsum((dark & (s <= 0))[:, ::-1], axis=1)[:, ::-1] == 0
    flank = joined & ~dark & (s <= BEYOND_PX) & ~_whitened(sections, felt)
    count = flank.sum(axis=1)
    x, x2, g = (_centred(column, flank, count) for column in (s, s**2, sections))
    squares = np.maximum((x * x).sum(axis=1), 1e-9)
    tilt2, tilt = ((x * column).sum(axis=1) / squares for column in (x2, g))
    curvature = _curvature(x2 - tilt2[:, None] * x, g - tilt[:, None] * x)
    place = (tilt + curvature * tilt2) / (2 * curvature)
    sound = (count >= FEWEST) & (np.abs(place) <= FARTHEST * np.sqrt(contrast / curvature))
    # Where so much is white that no flank is left, the middle of what is white.
    white = np.cumsum((sections < WHITE) & (s >= 0), axis=1) == 0
    plateau = 0.5 * STEP_PX * (np.sum(white & (s >= 0), axis=1) - 1)
    middle = np.where(top[:, 0] >= WHITE, plateau, np.nan)
    return np.asarray(steps[first] + np.where(sound, place, middle))


def _curvature(square: Array, grey: Array) -> Array:
    """(N,): of the pulse, grey levels a squared pixel, by what is left of s^2 and of grey levels once a slope is out.

    A pulse is wider where the beam meets the wall aslant, so that sections share it with their neighbours alone.
    """
    from scipy.ndimage import gaussian_filter1d

    sums = [(square * column).sum(axis=1) for column in (grey, square)]
    above, below = (gaussian_filter1d(one, WINDOW, mode="nearest") for one in sums)
    return np.asarray(np.maximum(-above / np.maximum(below, 1e-9), LEAST_CURVATURE))


def _centred(column: Array, flank: NDArray[np.bool_], count: NDArray[np.int64]) -> Array:
    """Of each section's flank, less its mean; 0 elsewhere."""
    mean = np.where(flank, column, 0.0).sum(axis=1) / np.maximum(count, 1)
    return np.where(flank, column - mean[:, None], 0.0)


def _whitened(sections: Array, felt: int) -> NDArray[np.bool_]:
    """Samples that are saturated, or interpolated from a pixel that is: so many samples further."""
    from scipy.ndimage import binary_dilation

    white = sections >= WHITE
    return np.asarray(binary_dilation(white, np.ones((1, 2 * felt + 1))) if white.any() else white)
