"""Points of a source against targets that other points span: what a likelihood of any mix is made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["SpannedRows", "joined_spanned", "spanned"]


@dataclass(frozen=True, eq=False)
class SpannedRows:
    """Sightings of points, lines and planes.

    Attributes:
        points: (N, 3), px; ``w = 0`` throughout when they are those of a 2D image.
        first: (C + 1,): sighting c has the points ``first[c]`` up to ``first[c + 1]``.
        spanning: (C, 3, 3), mm: the first of three rows span a target; the others mean nothing.
        spans: (C,): how many do: 1 a point, 2 a line, 3 a plane.
        sigma_mm: (C,): noise of spanning points, along every axis, in parts of each other's; None: all alike.
        sigma_px: (N,), likewise of points.
    """

    points: Array
    first: NDArray[np.int32]
    spanning: Array
    spans: NDArray[np.int32]
    sigma_mm: Array | None = None
    sigma_px: Array | None = None

    __repr__ = brief

    def __len__(self) -> int:
        return len(self.spans)

    @property
    def dimension(self) -> int:
        """2 where all points are of a 2D image."""
        return 3 if self.points[:, 2].any() else 2

    @property
    def residuals(self) -> int:
        """How many numbers tell the points from their targets: three of a point, two on a line, one in a plane."""
        return int(((4 - self.spans) * np.diff(self.first)).sum())

    @cached_property
    def core(self) -> _core.Table:
        """The sightings as the core keeps them, checked once.

        Raises:
            InputError: two points of a line are one, or three of a plane on one line.
        """
        about = self.points, self.first, self.spanning, self.spans, self.sigma_px, self.sigma_mm
        try:
            return _core.Table.of_targets(*about, dimension=self.dimension)
        except ValueError as error:
            raise InputError(f"the correspondences cannot be registered: {error}") from None

    def select(self, chosen: NDArray[np.bool_]) -> SpannedRows:
        """Those of the sightings (C,) that are chosen."""
        sizes = np.diff(self.first)
        row = np.repeat(chosen, sizes)
        return SpannedRows(
            np.ascontiguousarray(self.points[row]),
            _starts(sizes[chosen]),
            np.ascontiguousarray(self.spanning[chosen]),
            np.ascontiguousarray(self.spans[chosen]),
            None if self.sigma_mm is None else np.ascontiguousarray(self.sigma_mm[chosen]),
            None if self.sigma_px is None else np.ascontiguousarray(self.sigma_px[row]),
        )


def spanned(points: Array, spanning: Array) -> SpannedRows:
    """Points (C, m, 3) or (C, 3) against what points (C, K, 3) span, as many of each sighting."""
    count, spans = spanning.shape[:2]
    each = points.size // (3 * count) if count else 1
    padded = np.zeros((count, 3, 3))
    padded[:, :spans] = spanning
    return SpannedRows(
        np.ascontiguousarray(points.reshape(-1, 3), dtype=float),
        _starts(np.full(count, each)),
        padded,
        np.full(count, spans, dtype=np.int32),
    )


def joined_spanned(parts: Sequence[SpannedRows | None]) -> SpannedRows | None:
    """Several kinds put together; None where one of them is not known by what spans it."""
    there = [part for part in parts if part is not None]
    if len(there) < len(parts):
        return None
    return SpannedRows(
        np.concatenate([part.points for part in there]),
        _starts(np.concatenate([np.diff(part.first) for part in there])),
        np.concatenate([part.spanning for part in there]),
        np.concatenate([part.spans for part in there]),
    )


def _starts(sizes: NDArray[np.integer]) -> NDArray[np.int32]:
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int32)
