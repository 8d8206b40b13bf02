"""Points against lines, in the arrays that the core takes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import InputError
from sonocal.geometry import Array, AxisScaled
from sonocal.registration.options import Options

__all__ = ["PointLineRows", "to_core"]


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

    def level_px(self, sigma_px: float | None) -> float:
        """The core's level of point noise: given, or 1 beside a column of it, or 0: to be estimated."""
        return sigma_px or (0.0 if self.sigma_px is None else 1.0)

    def level_mm(self, sigma_mm: float | None) -> float:
        """The core's level of segment noise; as `level_px`."""
        return sigma_mm or (0.0 if self.sigma_mm is None else 1.0)

    def core_options(self, options: Options) -> _core.Options:
        """The options as the core takes them for these rows."""
        return options.to_core(self.level_px(options.sigma_px), self.level_mm(options.sigma_mm))


def to_core(transform: AxisScaled) -> _core.Transform:
    """A transform as the core takes it."""
    return _core.Transform(
        np.ascontiguousarray(transform.rotation),
        np.ascontiguousarray(transform.translation),
        np.ascontiguousarray(transform.scales),
    )


def _counted(codes: NDArray[np.int32]) -> NDArray[np.int32]:
    return np.unique(codes, return_inverse=True)[1].reshape(-1).astype(np.int32)
