"""Rows under a transform: where their points come to lie, seen from their lines; each computed once, when asked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sonocal import _core
from sonocal.geometry import Array, AxisScaled
from sonocal.registration.rows import PointLineRows, to_core

__all__ = ["MappedRows"]


@dataclass(frozen=True, eq=False)
class MappedRows:
    """Points (N) mapped by a transform, against their lines.

    Attributes:
        transform: mm from px.
        table: the rows.
    """

    transform: AxisScaled
    table: PointLineRows

    @cached_property
    def directions(self) -> Array:
        """(N, 3): of the lines."""
        along = self.table.segments_mm[:, 1] - self.table.segments_mm[:, 0]
        return np.asarray(along / self.lengths_mm[:, None])

    @cached_property
    def lengths_mm(self) -> Array:
        """(N,): of the segments."""
        along = self.table.segments_mm[:, 1] - self.table.segments_mm[:, 0]
        return np.asarray(np.sqrt(np.einsum("ni,ni->n", along, along)))

    @cached_property
    def from_first(self) -> Array:
        """(N, 3), mm: from each segment's first end to the mapped point."""
        return np.asarray(self.transform.apply(self.table.points) - self.table.segments_mm[:, 0])

    @cached_property
    def along_mm(self) -> Array:
        """(N,): the mapped point's place on its line, from the segment's first end."""
        return np.asarray(np.einsum("ni,ni->n", self.from_first, self.directions))

    @cached_property
    def residuals(self) -> Array:
        """(N, 3), mm: from each line to its mapped point, at right angles to the line."""
        return _core.residual_vectors(self.table.core, to_core(self.transform))

    @cached_property
    def distances(self) -> Array:
        """(N,), mm: of each mapped point to its line."""
        return np.asarray(np.sqrt(np.einsum("ni,ni->n", self.residuals, self.residuals)))
