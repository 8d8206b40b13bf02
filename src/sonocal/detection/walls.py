"""Walls, floors and membranes: lines of 2D images and planes of volumes, each candidate with its covariance.

A wall is straight, as bright as can be, or fades along its length, and is followed by echoes of itself. What is found
are ridges (both sides darker, so that no edge of the fan is one), straight sheets through them, and, in sections across
each, the first echo.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.detection.grey import as_grey
from sonocal.detection.sheet_contrast import sheet_contrast
from sonocal.detection.sheet_echo import wall_echo
from sonocal.detection.sheet_fit import Sheet, fit_sheet
from sonocal.detection.sheet_search import NEAR_PX, Ridges, find_ridges, strongest_sheet
from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["WallCandidate", "WallDetector"]

COUNT = 3
TRIES = 4
"""Further sheets that are looked at beyond those asked for: of some nothing is left."""
REACH_SHARE, LEAST_REACH_PX = 1 / 50, {2: 7.0, 3: 4.0}
"""Of the smaller side: how far from a coarse sheet its echo is looked for."""
SPACING_PX = {2: 1.0, 3: 1.5}
"""Between sections."""
CORRELATION_SHARE, LEAST_CORRELATION_PX = 1 / 50, {2: 3.0, 3: 2.0}
"""Of the smaller side: sections nearer than a beam is wide see the same speckle."""
SHORTEST_SHARE = 1 / 6
"""Of the smaller side: what is shorter is an oblique needle, a spot, or no wall that tells a direction."""
COVERED = 0.5
"""Of the sections between the first and the last: where fewer show an echo, there is no wall but spots in a row."""
BENT_SHARE, LEAST_BENT_PX = 0.02, 1.5
"""Of the length: what sags by more is a layer of tissue, or an arc about the probe's face."""
RAGGED_PX = {2: 3.0, 3: 2.0}
"""Scatter of sections about the sheet beyond which they do not show one."""
PARALLEL = np.cos(np.radians(12.0))
FACING = np.sin(np.radians(15.0))
"""Of its normal the part along depth: where a wall is along the beams, its echoes are not below it."""
ECHO_SHARE = 0.3
"""Of its strength: a sheet below another that is parallel and so strong, or stronger, is an echo of it."""
NOTHING, SHORT, SPARSE, BENT, EDGE = (
    "nothing straight stands out",
    "what stands out is too short",
    "what stands out is spots in a row",
    "what stands out is bent",
    "what stands out is at the edge of what is shown",
)


@dataclass(frozen=True, eq=False)
class WallCandidate:
    """A line or plane that may be a wall.

    Attributes:
        points_px: (D, D): points that span it, well apart: two of a line, three of a plane; (u, v[, w]).
        covariance_px2: (D, D, D): of each, across it; along it a point means nothing. They are independent.
        score: how far it stands out: grey levels, less where it is short.
        normal: (D,): unit, away from the transducer.
        is_echo: whether it lies below a parallel one that it may be an echo of.
    """

    points_px: Array
    covariance_px2: Array
    score: float
    normal: Array
    is_echo: bool = False

    __repr__ = brief


class WallDetector:
    """Finds walls in images or volumes of one size.

    Args:
        mask: (rows, columns) or (depth, rows, columns): True where to look.
        count: candidates an image at the most.

    Raises:
        InputError: the mask leaves nothing to look at, or the count makes no sense.
    """

    def __init__(self, mask: NDArray[np.bool_], count: int = COUNT) -> None:
        if count < 1:
            raise InputError(f"detection needs a count of 1 or more; got {count}")
        if not mask.any():
            raise InputError("the mask hides the whole image; give another one")
        self._mask, self._count, self._side = mask, count, min(mask.shape)

    def __repr__(self) -> str:
        size = " x ".join(str(n) for n in self._mask.shape[::-1])
        return f"<WallDetector of images of {size} px: {self._count} candidates>"

    def detect(self, image: NDArray[Any], name: str = "image") -> tuple[list[WallCandidate], str]:
        """Candidates of one image, best first; and, where there is none, why.

        Raises:
            InputError: the image has another size than the mask.
        """
        axes = self._mask.ndim
        grey = as_grey(image, axes, name)
        if grey.shape != self._mask.shape:
            raise InputError(
                f"{name}: is {grey.shape} where the mask is {self._mask.shape}; give one of the same size"
            )
        ridges, rng = find_ridges(grey, self._mask), np.random.default_rng(0)
        found: list[WallCandidate] = []
        why = NOTHING
        for _ in range(self._count + TRIES):
            sheet = strongest_sheet(ridges, rng)
            if sheet is None or len(found) == self._count:
                break
            normal, offset, _ = sheet
            one = self._looked_at(grey, ridges, normal, offset)
            if isinstance(one, WallCandidate):
                found.append(one)
            elif why == NOTHING:
                why = one
            ridges = ridges.beyond(normal, offset, 2 * NEAR_PX)
        return _ranked(found), "" if found else why

    def _looked_at(
        self, grey: NDArray[np.float32], ridges: Ridges, normal: Array, offset: float
    ) -> WallCandidate | str:
        """A coarse sheet through its first echo, section by section; or why it is no wall."""
        axes = len(normal)
        on = np.abs(ridges.places @ normal - offset) <= NEAR_PX
        normal = normal * (1.0 if normal[1] >= 0 else -1.0)
        places = ridges.fine(ridges.places[on])
        for _ in range(2):
            stations = _stations(places, normal, SPACING_PX[axes])
            if len(stations) < 2 * axes:
                return SHORT
            echo = wall_echo(grey, self._mask, stations, normal, self._reach)
            seen = np.isfinite(echo.away_px)
            if seen.sum() < 2 * axes:
                return EDGE
            places = stations[seen] + echo.away_px[seen, None] * normal
            sheet = fit_sheet(places, normal, self._correlated)
            places, normal = places[sheet.used], sheet.normal
        on_sheet = stations - ((stations - sheet.middle) @ sheet.normal)[:, None] * sheet.normal
        contrast = sheet_contrast(
            grey, self._mask, on_sheet, sheet.normal, reach=self._reach, correlated=self._correlated
        )
        return self._judged(sheet, places, contrast) if contrast else NOTHING

    def _judged(self, sheet: Sheet, places: Array, contrast: float) -> WallCandidate | str:
        axes = len(sheet.normal)
        along = np.linalg.svd(sheet.normal[None])[2][1:]
        spread = (places - places.mean(axis=0)) @ along.T
        # Of places that are spread evenly the length is the square root of 12 times their standard deviation.
        length = np.sqrt(12.0 * np.maximum(np.linalg.eigvalsh(np.atleast_2d(np.cov(spread.T)))[0], 0.0))
        if length < SHORTEST_SHARE * self._side:
            return SHORT
        if len(places) < COVERED * _area(spread) / SPACING_PX[axes] ** (axes - 1):
            return SPARSE
        if (
            _sag(places, sheet, spread) > max(LEAST_BENT_PX, BENT_SHARE * length)
            or sheet.sigma_px > RAGGED_PX[axes]
        ):
            return BENT
        score = contrast * float(np.sqrt(length / self._side))
        return WallCandidate(sheet.spanning_px, sheet.covariance_px2, score, sheet.normal)

    @property
    def _reach(self) -> float:
        return float(max(LEAST_REACH_PX[self._mask.ndim], REACH_SHARE * self._side))

    @property
    def _correlated(self) -> float:
        """Sections that share their error."""
        axes = self._mask.ndim
        width = max(LEAST_CORRELATION_PX[axes], CORRELATION_SHARE * self._side)
        return float((width / SPACING_PX[axes]) ** (axes - 1))


def _stations(places: Array, normal: Array, spacing: float) -> Array:
    """(N, D): evenly over the sheet through places, within the box that holds them."""
    middle = places.mean(axis=0)
    along = np.linalg.svd(normal[None])[2][1:]
    spread = (places - middle) @ along.T
    ticks = [
        np.arange(low, high + spacing, spacing)
        for low, high in zip(spread.min(0), spread.max(0), strict=True)
    ]
    grid = np.stack(np.meshgrid(*ticks, indexing="ij"), axis=-1).reshape(-1, len(ticks))
    return np.asarray(middle + grid @ along)


def _area(spread: Array) -> float:
    """Length of what places (N, 1) extend over, or area (N, 2)."""
    if spread.shape[1] == 1:
        return float(np.ptp(spread))
    from scipy.spatial import ConvexHull

    return float(ConvexHull(spread).volume)


def _sag(places: Array, sheet: Sheet, spread: Array) -> float:
    """By how much the places bend away from the sheet from their middle to their ends."""
    off = (places - sheet.middle) @ sheet.normal
    columns = [np.ones(len(off)), *spread.T, *(spread**2).T]
    if spread.shape[1] == 2:
        columns.append(spread[:, 0] * spread[:, 1])
    solved = np.linalg.lstsq(np.column_stack(columns), off, rcond=None)[0]
    bend = solved[1 + spread.shape[1] : 1 + 2 * spread.shape[1]]
    return float(np.abs(bend * (0.5 * np.ptp(spread, axis=0)) ** 2).max())


def _ranked(found: list[WallCandidate]) -> list[WallCandidate]:
    """Best first, those that may be echoes of others last."""
    told = [
        replace(one, is_echo=True) if any(_is_echo(one, other) for other in found) else one for one in found
    ]
    return sorted(told, key=lambda one: (one.is_echo, -one.score))


def _is_echo(one: WallCandidate, other: WallCandidate) -> bool:
    """Whether one lies below another that is parallel and strong enough to have it for an echo."""
    if one is other or abs(float(one.normal @ other.normal)) < PARALLEL or other.normal[1] < FACING:
        return False
    below = float((one.points_px.mean(axis=0) - other.points_px.mean(axis=0)) @ other.normal)
    return below > 0 and other.score >= ECHO_SHARE * one.score
