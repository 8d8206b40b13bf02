"""Points that stand for a plane of the source: where they lie, whatever its origin and axes are."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = ["PlaneSamples", "joined_samples", "normals_of"]

# A plane's points, about the place of it that is nearest to the sources' centre: of an equilateral triangle the
# squared distances from any plane are the same however it is turned in its own.
CORNERS = np.array([[np.cos(a), np.sin(a)] for a in 2 * np.pi / 3 * np.arange(3)])

# Of coordinates: distances below this part of them are none.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class PlaneSamples:
    """Planes of the source whose rows have three points each.

    Attributes:
        planes: (M, 4), unit normals.
        size: (M,): how far the points lie from their middle; NaN: as far as the sources lie from their centre.
        row: (M,): the first of each plane's three rows.
    """

    planes: Array
    size: Array
    row: NDArray[np.int64]

    def placed(self, points: Array) -> Array:
        """The rows' points (N, 3), those of the planes where they belong among all the others."""
        if not len(self.row):
            return points
        rows = self.row[:, None] + np.arange(3)
        others = np.ones(len(points), dtype=bool)
        others[rows] = False
        centre = _centre(points[others], self.planes)
        away = self.planes[:, :3] @ centre + self.planes[:, 3]
        size = np.where(np.isnan(self.size), _spread(points[others], centre, away), self.size)
        middles = centre - away[:, None] * self.planes[:, :3]
        placed = points.copy()
        placed[rows] = middles[:, None] + size[:, None, None] * (CORNERS @ normals_of(self.planes[:, :3]))
        return placed


def joined_samples(parts: list[PlaneSamples | None], starts: NDArray[np.int64]) -> PlaneSamples | None:
    """The samples of rows put together, whose parts begin at rows (P,)."""
    found = [(part, start) for part, start in zip(parts, starts, strict=True) if part is not None]
    if not found:
        return None
    return PlaneSamples(
        np.concatenate([part.planes for part, _ in found]),
        np.concatenate([part.size for part, _ in found]),
        np.concatenate([part.row + start for part, start in found]),
    )


def normals_of(directions: Array) -> Array:
    """Two unit vectors (..., 2, 3) perpendicular to unit directions (..., 3) and to each other."""
    least = np.abs(directions).argmin(axis=-1)
    first = np.cross(directions, np.eye(3)[least])
    first = first / np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=-2)


def _centre(points: Array, planes: Array) -> Array:
    """(3,): the least sum of squared distances from points and planes."""
    normals = planes[:, :3]
    matrix = len(points) * np.eye(3) + normals.T @ normals
    right = points.sum(axis=0) - normals.T @ planes[:, 3]
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=None)[0])


def _spread(points: Array, centre: Array, away: Array) -> float:
    """Root mean square distance of points and planes from their centre."""
    squares = np.concatenate([np.sum((points - centre) ** 2, axis=1), away**2])
    spread = float(np.sqrt(squares.mean()))
    # Planes that all meet in one point leave growth about it free: any size serves to find that out.
    return (
        spread
        if spread > ROUNDING * float(np.linalg.norm(centre))
        else max(float(np.linalg.norm(centre)), 1.0)
    )
