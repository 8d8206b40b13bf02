"""Points against lines, in the arrays that the core takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import InputError
from sonocal.geometry import Array, AxisScaled
from sonocal.registration.options import Options

__all__ = ["PointLineRows", "noise_level", "to_core"]


@dataclass(frozen=True, eq=False)
class PointLineRows:
    """Points of one frame that lie on lines of another, row by row.

    Attributes:
        points: (N, 3), px; ``w = 0`` throughout when they are those of a 2D image.
        segments_mm: (N, 2, 3): two points of each line.
        dimension: 2 or 3, of the image.
        sightings: (N,), 3D: rows of one sighting lie on one image line and have one segment; counted from 0.
        frame, target: (N,), counted from 0: minimal samples take different ones where they can.
        sigma_px, sigma_mm: (N,): noise of a point and of a segment's end point along every axis, where known.
    """

    points: Array
    segments_mm: Array
    dimension: int
    sightings: NDArray[np.int32] | None = None
    frame: NDArray[np.int32] | None = None
    target: NDArray[np.int32] | None = None
    sigma_px: Array | None = None
    sigma_mm: Array | None = None

    def __len__(self) -> int:
        return len(self.points)

    @cached_property
    def core(self) -> _core.Table:
        """The rows as the core keeps them, checked once; every row of a 2D image is a sighting of its own."""
        try:
            return _core.Table.of_lines(
                self.points,
                self.segments_mm,
                self.sightings if self.dimension == 3 else None,
                self.frame,
                self.target,
                self.sigma_px,
                self.sigma_mm,
                dimension=self.dimension,
            )
        except ValueError as error:
            raise InputError(f"the rows cannot be fitted: {error}") from None

    def select(self, chosen: NDArray[np.bool_] | NDArray[np.int64]) -> PointLineRows:
        """The rows of a mask, or of indices in their order; sightings are counted from 0 again."""
        sightings = self.sightings
        if sightings is not None:
            sightings = np.unique(sightings[chosen], return_inverse=True)[1].reshape(-1).astype(np.int32)
        return PointLineRows(
            points=self.points[chosen],
            segments_mm=self.segments_mm[chosen],
            dimension=self.dimension,
            sightings=sightings,
            frame=None if self.frame is None else _counted(self.frame[chosen]),
            target=None if self.target is None else _counted(self.target[chosen]),
            sigma_px=None if self.sigma_px is None else self.sigma_px[chosen],
            sigma_mm=None if self.sigma_mm is None else self.sigma_mm[chosen],
        )

    @property
    def spanning_mm(self) -> Array:
        """(N, 2, 3): the points that span each row's line."""
        return self.segments_mm

    @property
    def spans(self) -> NDArray[np.int32]:
        """(N,): how many points span each row's target."""
        return np.full(len(self), 2, dtype=np.int32)

    def with_spanning(self, spanning_mm: Array) -> PointLineRows:
        """The same points on lines that are elsewhere."""
        return replace(self, segments_mm=spanning_mm)

    def mirrored(self) -> PointLineRows:
        """The rows of a volume mirrored along one axis; along which is all the same, a turn apart."""
        return replace(self, points=self.points * [1.0, 1.0, -1.0])

    def marks(self, chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Rows (N,) as the core takes them."""
        return chosen

    def codes(self, labels: NDArray[Any]) -> NDArray[np.int32]:
        """The group (N,) of each row, as the core takes them."""
        return np.ascontiguousarray(labels, dtype=np.int32)

    def times(self, time: Array) -> Array:
        """Likewise of times (N,)."""
        return np.ascontiguousarray(time, dtype=float)

    def residuals(self, chosen: NDArray[np.bool_]) -> int:
        """How many numbers tell the chosen rows from their lines."""
        return 2 * int(np.count_nonzero(chosen))

    def within(self, away_mm: Array, limit_mm: float) -> NDArray[np.bool_]:
        """(N,): rows whose points are within a distance (N,)."""
        return np.asarray(away_mm <= limit_mm)

    def level_px(self, sigma_px: float | None) -> float:
        """The core's level of point noise: given, or 1 beside a column of it, or 0: to be estimated."""
        return noise_level(sigma_px, self.sigma_px)

    def level_mm(self, sigma_mm: float | None) -> float:
        """The core's level of segment noise; as `level_px`."""
        return noise_level(sigma_mm, self.sigma_mm)

    def core_options(self, options: Options) -> _core.Options:
        """The options as the core takes them for these rows."""
        return options.to_core(self.level_px(options.sigma_px), self.level_mm(options.sigma_mm))


def noise_level(given: float | None, column: Array | None) -> float:
    """The core's level of noise: given, or 1 beside a column of it, or 0: to be estimated."""
    return given or (0.0 if column is None else 1.0)


def to_core(transform: AxisScaled) -> _core.Transform:
    """A transform as the core takes it."""
    return _core.Transform(
        np.ascontiguousarray(transform.rotation),
        np.ascontiguousarray(transform.translation),
        np.ascontiguousarray(transform.scales),
    )


def _counted(codes: NDArray[np.int32]) -> NDArray[np.int32]:
    return np.unique(codes, return_inverse=True)[1].reshape(-1).astype(np.int32)
