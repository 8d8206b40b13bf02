"""Rows under a transform: where their points come to lie, seen from their targets; each computed once, when asked."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import Array, AxisScaled
from sonocal.registration.rows import PointLineRows, to_core
from sonocal.registration.target_rows import TargetRows

__all__ = ["Mapped", "MappedRows", "MappedTargets", "mapped_rows"]


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

    @cached_property
    def shares(self) -> Array:
        """(N, 2): how much each end has of the place on the line that is nearest to the mapped point."""
        place = self.along_mm / self.lengths_mm
        return np.stack([1.0 - place, place], axis=1)

    def across(self, rows: NDArray[np.int64], moved: Array) -> Array:
        """(M, 3, k): of what moves the points of some rows (M,), the part that leads away from their lines."""
        directions = self.directions[rows]
        return np.asarray(moved - directions[:, :, None] * (directions[:, None, :] @ moved))


@dataclass(frozen=True, eq=False)
class MappedTargets:
    """Points (N) mapped by a transform, against points, lines and planes.

    Attributes:
        transform: mm from px.
        table: the rows.
    """

    transform: AxisScaled
    table: TargetRows

    @cached_property
    def _sides(self) -> Array:
        """(N, 3, 2): of what spans a line or a plane, from its first point; zero where there is none."""
        sides = self.table.spanning_mm[:, 1:] - self.table.spanning_mm[:, :1]
        there = np.arange(1, 3) < self.table.spans[:, None]
        return np.asarray(np.where(there[:, :, None], sides, 0.0).transpose(0, 2, 1))

    @cached_property
    def _inverse(self) -> Array:
        """(N, 2, 3)."""
        return np.asarray(np.linalg.pinv(self._sides))

    @cached_property
    def _from_first(self) -> Array:
        return np.asarray(self.transform.apply(self.table.points) - self.table.spanning_mm[:, 0])

    @cached_property
    def shares(self) -> Array:
        """(N, 3): how much each spanning point has of the place on the target that is nearest to the mapped point."""
        along = np.einsum("nij,nj->ni", self._inverse, self._from_first)
        return np.column_stack([1.0 - along.sum(axis=1), along])

    @cached_property
    def residuals(self) -> Array:
        """(N, 3), mm: from each target to its mapped point, at right angles to the target."""
        every = np.arange(len(self.table))
        return self.across(every, self._from_first[:, :, None])[:, :, 0]

    @cached_property
    def distances(self) -> Array:
        """(N,), mm: of each mapped point to its target."""
        return np.asarray(np.linalg.norm(self.residuals, axis=1))

    def across(self, rows: NDArray[np.int64], moved: Array) -> Array:
        """(M, 3, k): of what moves the points of some rows (M,), the part that leads away from their targets."""
        return np.asarray(moved - self._sides[rows] @ (self._inverse[rows] @ moved))


Mapped = MappedRows | MappedTargets


def mapped_rows(transform: AxisScaled, table: PointLineRows | TargetRows) -> Mapped:
    """Rows of either form under a transform."""
    if isinstance(table, PointLineRows):
        return MappedRows(transform, table)
    return MappedTargets(transform, table)
