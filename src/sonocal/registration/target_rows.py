"""Points against points, lines and planes, row by row: what is asked of rows on lines, asked of any mix."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.registration.constraints import Rows, rows_of_spanned
from sonocal.registration.rows import noise_level
from sonocal.registration.spanned import SpannedRows

__all__ = ["TargetRows"]


@dataclass(frozen=True, eq=False)
class TargetRows:
    """Points of one frame that lie on targets of another, row by row.

    Attributes:
        points: (N, 3), px; ``w = 0`` throughout when they are those of a 2D image.
        spanning_mm: (N, 3, 3): the first of three points span each row's target; the others repeat the first.
        spans: (N,): how many do: 1 a point, 2 a line, 3 a plane.
        dimension: 2 or 3, of the image.
        sightings: (N,): rows of one sighting lie on one target; counted from 0.
        frame, target: (N,), counted from 0.
        sigma_px, sigma_mm: (N,): noise of a point and of a spanning point along every axis, where known.
    """

    points: Array
    spanning_mm: Array
    spans: NDArray[np.int32]
    dimension: int
    sightings: NDArray[np.int32]
    frame: NDArray[np.int32]
    target: NDArray[np.int32]
    sigma_px: Array | None = None
    sigma_mm: Array | None = None

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """(N,): the rows as the core has them, those of a sighting side by side."""
        return np.argsort(self.sightings, kind="stable")

    @cached_property
    def _first(self) -> NDArray[np.int64]:
        """(C,): where each sighting begins in that order."""
        return np.flatnonzero(np.diff(self.sightings[self.order], prepend=-1))

    @cached_property
    def spanned(self) -> SpannedRows:
        """The same by sightings, as what a likelihood is made from."""
        first, one = np.append(self._first, len(self)), self.order[self._first]
        return SpannedRows(
            np.ascontiguousarray(self.points[self.order]),
            first.astype(np.int32),
            np.ascontiguousarray(self.spanning_mm[one]),
            np.ascontiguousarray(self.spans[one]),
            None if self.sigma_mm is None else np.ascontiguousarray(self.sigma_mm[one]),
            None if self.sigma_px is None else np.ascontiguousarray(self.sigma_px[self.order]),
        )

    @cached_property
    def constraints(self) -> Rows:
        """The same as points in planes, which say what holds a motion."""
        return rows_of_spanned(self.spanned)

    @cached_property
    def core(self) -> _core.Table:
        """The rows as the core keeps them, checked once."""
        rows = self.spanned
        about = rows.points, rows.first, rows.spanning, rows.spans, rows.sigma_px, rows.sigma_mm
        try:
            return _core.Table.of_targets(*about, self.codes(self.target), dimension=self.dimension)
        except ValueError as error:
            raise InputError(f"the rows cannot be fitted: {error}") from None

    def marks(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Rows (N,), all of a sighting alike, as the core takes them: (C,)."""
        return np.ascontiguousarray(chosen[self.order[self._first]])

    def codes(self, labels: NDArray[Any]) -> NDArray[np.int32]:
        """The group (N,) of each row, as the core takes them."""
        return np.ascontiguousarray(labels[self.order], dtype=np.int32)

    def times(self, time: Array) -> Array:
        """Likewise of times (N,)."""
        return np.ascontiguousarray(time[self.order], dtype=float)

    def residuals(self, chosen: NDArray[np.bool_]) -> int:
        """How many numbers tell the chosen rows from their targets: three of a point, two on a line, one in a plane."""
        return int((4 - self.spans[chosen]).sum())

    def within(self, away_mm: Array, limit_mm: float) -> NDArray[np.bool_]:
        """(N,): rows of the sightings whose points are within a distance (N,) in the mean square."""
        squares = np.bincount(self.sightings, away_mm**2) / np.bincount(self.sightings)
        return np.asarray(np.sqrt(squares)[self.sightings] <= limit_mm)

    def select(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> TargetRows:
        """The rows of a mask, or of indices in their order; codes are counted from 0 again."""
        return TargetRows(
            points=self.points[chosen],
            spanning_mm=self.spanning_mm[chosen],
            spans=self.spans[chosen],
            dimension=self.dimension,
            sightings=_counted(self.sightings[chosen]),
            frame=_counted(self.frame[chosen]),
            target=_counted(self.target[chosen]),
            sigma_px=None if self.sigma_px is None else self.sigma_px[chosen],
            sigma_mm=None if self.sigma_mm is None else self.sigma_mm[chosen],
        )

    def with_spanning(self, spanning_mm: Array) -> TargetRows:
        """The same points on targets that are elsewhere."""
        return replace(self, spanning_mm=spanning_mm)

    def mirrored(self) -> TargetRows:
        """The rows of a volume mirrored along one axis."""
        return replace(self, points=self.points * [1.0, 1.0, -1.0])

    def level_px(self, sigma_px: float | None) -> float:
        """The level of point noise, as of `PointLineRows`."""
        return noise_level(sigma_px, self.sigma_px)

    def level_mm(self, sigma_mm: float | None) -> float:
        """The level of spanning points' noise, likewise."""
        return noise_level(sigma_mm, self.sigma_mm)


def _counted(codes: NDArray[np.int32]) -> NDArray[np.int32]:
    return np.unique(codes, return_inverse=True)[1].reshape(-1).astype(np.int32)
