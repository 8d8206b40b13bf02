"""What the checks look at: a fit and its rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, AxisScaled
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.registration.mapped import Mapped
from sonocal.registration.options import Model, unknowns
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = ["Evidence"]


@dataclass(frozen=True, eq=False)
class Evidence:
    """A transform and the rows it was fitted to, outliers included.

    Attributes:
        observations: the rows as the user has them: splits, targets, times.
        mapped: the same as registration takes them, under the transform.
        model: one scale, or one along u and one along v.
        covariance: (k, k), of the transform's tangent, or None where it is unknown.
        area_px: (2, d): the least and the greatest corner of the image.
        threshold_mm: rows within this distance agree.
        rms_mm: of the distances of the rows that agree.
        tolerance_mm: error at the area's corners that is accepted.
        area_name: what messages call the area, which is the image where its size is known.
        sigma_px: noise of an image point, px; 0 where it is not known.
    """

    observations: Observations
    mapped: Mapped
    model: Model
    covariance: Array | None
    area_px: Array
    threshold_mm: float
    rms_mm: float
    tolerance_mm: float = 2.0
    area_name: str = "image"
    sigma_px: float = 0.0

    __repr__ = brief

    @property
    def transform(self) -> AxisScaled:
        """From px to mm."""
        return self.mapped.transform

    @property
    def table(self) -> PointLineRows | TargetRows:
        """The rows as registration takes them."""
        return self.mapped.table

    @property
    def parameters(self) -> int:
        """As many unknowns as the model has."""
        return unknowns(self.model, self.observations.dimension)

    @cached_property
    def seen_px(self) -> Array:
        """(2, d): the box of the rows that agree, or of all where none does."""
        points = self.observations.points_px
        points = points[self.inlier] if self.inlier.any() else points
        return np.array([points.min(axis=0), points.max(axis=0)])

    @cached_property
    def inlier(self) -> NDArray[np.bool_]:
        """(N,): whether the row agrees."""
        return np.asarray(self.mapped.distances <= self.threshold_mm)
