"""The needle as a line in a volume: bright voxels, a robust line through them, refined section by section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.detection.first_echo import Echo, first_echo
from sonocal.detection.grey import as_grey
from sonocal.detection.line_fit import bright_sections, fit_line
from sonocal.detection.line_search import (
    SHELL_PX,
    bright_voxels,
    distances,
    prominence,
    prominence_along,
    strongest_line,
    voxels,
)
from sonocal.detection.points import PointDetector
from sonocal.detection.slices import slice_volume
from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = [
    "LineCandidate",
    "detect_line_near",
    "detect_lines",
    "line_through_slices",
]

COUNT = 3
REACH_PX, NEAR_PX = 6.0, 3.0
"""How far the needle may be from a coarse line, and from where a calibration says it is."""
LEAST_PROMINENCE = 1.5
"""Of what lies along a line, on average, in units of noise: in noise alone lines reach a third of that."""
SECTION_PX = 3.0
"""What belongs to a line through slices."""
LEAST_LENGTH_PX = 10.0
LEAST_POINTS = 4
LEAST_SHARE = 0.5
"""Of a line's sections: where fewer show a pulse, the line stays where it was."""
FLOOR_PX2, ECHO_FLOOR_PX2 = 0.02, 0.0017
"""Of an end's variance what sections do not show: through all that is bright, through the first echo (simulated)."""


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

    __repr__ = brief

    @property
    def direction(self) -> Array:
        """Unit vector; its sign has no meaning."""
        along = self.ends_px[1] - self.ends_px[0]
        return np.asarray(along / np.linalg.norm(along))

    @property
    def sigma_px(self) -> Array:
        """(2,): standard deviation of an end across the line, the mean over both directions."""
        return np.asarray(np.sqrt(np.trace(self.covariance_px2, axis1=1, axis2=2) / 2))


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
    prominent, pool = prominence(grey)
    places, weights = bright_voxels(prominent)
    rng = np.random.default_rng(seed)
    found: list[LineCandidate] = []
    while len(found) < count and len(places) >= LEAST_POINTS:
        coarse = strongest_line(places, weights, rng)
        if coarse is None:
            break
        ends, score = coarse
        line = _refined(grey, voxels(ends, pool), score, REACH_PX)
        if (
            line is not None
            and prominence_along(prominent, pool, line.ends_px) >= LEAST_PROMINENCE
            and all(_apart(line, other) for other in found)
        ):
            found.append(line)
        left = distances(places, ends) > SHELL_PX
        places, weights = places[left], weights[left]
    return sorted(found, key=lambda line: -line.score)


def detect_line_near(
    volume: NDArray[Any], needle_px: ArrayLike, *, name: str = "volume"
) -> LineCandidate | None:
    """The line near where a needle must be: it may be fainter than what `detect_lines` finds by itself.

    Args:
        volume: indexed [w, v, u].
        needle_px: (2, 3): two points of the needle, anywhere along it, (u, v, w).
        name: what messages call the volume.

    Returns:
        The line, or None where nothing stands out.

    Raises:
        InputError: the volume has another shape or is too small.
    """
    grey = as_grey(volume, 3, name)
    ends = _inside(np.asarray(needle_px, dtype=float), np.array(grey.shape[::-1]) - 1.0)
    line = None if ends is None else _refined(grey, ends, 0.0, NEAR_PX)
    if line is None:
        return None
    score = prominence_along(*prominence(grey), line.ends_px)
    return replace(line, score=score) if score >= LEAST_PROMINENCE else None


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
        strongest_line(places, strength, np.random.default_rng(seed), near=SECTION_PX)
        if len(places) >= 3
        else None
    )
    if line is None:
        return None
    near = distances(places, line[0]) <= SECTION_PX
    if near.sum() < 3:
        return None
    return LineCandidate(*fit_line(places[near], strength[near], FLOOR_PX2, int(near.sum())), line[1])


def _refined(grey: NDArray[np.float32], ends: Array, score: float, reach: float) -> LineCandidate | None:
    """The line through the brightest place of every section across it, and then through the first echo there."""
    if np.linalg.norm(ends[1] - ends[0]) < LEAST_LENGTH_PX:
        return None
    points, contrast = bright_sections(grey, ends, reach)
    if len(points) < LEAST_POINTS:
        return None
    ends, covariance = fit_line(points, contrast, FLOOR_PX2)
    echo = first_echo(grey, ends)
    if len(echo.points_px) >= max(LEAST_POINTS, LEAST_SHARE * len(points)):
        ends, covariance = fit_line(echo.points_px, 1 / (ECHO_FLOOR_PX2 + echo.sigma_px**2), ECHO_FLOOR_PX2)
        covariance += _along_tail(echo, ends)
    return LineCandidate(ends, covariance, score)


def _inside(needle: Array, last: Array) -> Array | None:
    """The part of a line within a volume whose last voxel is given; None where it passes by."""
    along = needle[1] - needle[0]
    with np.errstate(divide="ignore", invalid="ignore"):
        crossings = np.sort([-needle[0] / along, (last - needle[0]) / along], axis=0)
    enters, leaves = np.nanmax(crossings[0]), np.nanmin(crossings[1])
    return needle[0] + np.array([[enters], [leaves]]) * along if enters < leaves else None


def _along_tail(echo: Echo, ends: Array) -> Array:
    """(2, 3, 3) px^2: what a tail adds to the ends' covariance."""
    along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    tail = echo.tail - (echo.tail @ along) * along
    nearest = [int(np.argmin(np.linalg.norm(echo.points_px - end, axis=1))) for end in ends]
    return np.asarray(echo.sigma_px[nearest, None, None] ** 2 * np.outer(tail, tail))


def _apart(line: LineCandidate, other: LineCandidate) -> bool:
    return bool(
        distances(line.ends_px, other.ends_px).max() > 2 * REACH_PX
        or abs(line.direction @ other.direction) < 0.95
    )
