"""Dots of images and the wires that they may be of, in the form that the core takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.errors import InputError
from sonocal.geometry import Array

__all__ = ["LabelTable", "Settled"]

MOST_DOTS, MOST_WIRES = 255, 255
SPACING_SHARE, LEAST_MM, MOST_MM = 0.2, 1.0, 5.0
SAMPLES = 64
# Standard deviations that a second wire must be farther from a dot than its own.
CLEARLY = 4.0


@dataclass(frozen=True, eq=False)
class Settled:
    """A similarity and the labels that it gives.

    Attributes:
        matrix: (4, 4), mm from px.
        labels: (N,): the wire of each dot, -1 for none.
        distances_mm: (N,): from it; NaN without one.
        score: sum of 1 - (distance / threshold)^2.
    """

    matrix: Array
    labels: NDArray[np.int32]
    distances_mm: Array
    score: float


@dataclass(frozen=True, eq=False)
class LabelTable:
    """Dots, frame by frame.

    Attributes:
        points: (N, 2), px, in the order of frames.
        first: (F + 1,): a frame's dots are those from its number here to the next.
        wires: (F, L, 2, 3), mm.
        order: (N,): where each dot stood when it was given.
    """

    points: Array
    first: NDArray[np.int32]
    wires: Array
    order: NDArray[np.int64]

    @classmethod
    def of(cls, points: ArrayLike, wires: ArrayLike, frame: ArrayLike | None) -> LabelTable:
        """The table of what a user gave.

        Raises:
            InputError: shapes differ, a number is not finite, or a frame does not exist.
        """
        dots = _numbers("points", points, (2,), "(N, 2) px")
        lines = np.asarray(wires, dtype=np.float64)
        if lines.ndim == 3:
            lines = lines[None]
        if lines.ndim != 4 or lines.shape[2:] != (2, 3) or 0 in lines.shape:
            raise InputError(
                f"lines must be (L, 2, 3) or (F, L, 2, 3) mm, two points on each; got {lines.shape}"
            )
        if not np.isfinite(lines).all():
            raise InputError("lines holds a number that is not finite; leave out frames without a pose")
        if (lines[:, :, 0] == lines[:, :, 1]).all(axis=-1).any():
            raise InputError("lines holds one whose two points are one; give two places on each")
        number = np.zeros(len(dots), dtype=np.int64) if frame is None else np.asarray(frame)
        if number.shape != (len(dots),) or number.dtype.kind not in "iu":
            raise InputError(
                f"frame must be {len(dots)} whole numbers, one a point; got {number.dtype} {number.shape}"
            )
        if len(number) and not (number.min() >= 0 and number.max() < len(lines)):
            raise InputError(
                f"frame must be between 0 and {len(lines) - 1}, as lines are of {len(lines)} frames; got "
                f"{number.min()} to {number.max()}"
            )
        counts = np.bincount(number, minlength=len(lines))
        if counts.max(initial=0) > MOST_DOTS or lines.shape[1] > MOST_WIRES:
            raise InputError(
                f"a frame may have {MOST_DOTS} points and {MOST_WIRES} lines at the most; got {counts.max(initial=0)} "
                f"and {lines.shape[1]}: keep the brightest points"
            )
        order = np.argsort(number, kind="stable")
        first = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
        return cls(np.ascontiguousarray(dots[order]), first, np.ascontiguousarray(lines), order)

    @property
    def frame(self) -> NDArray[np.int64]:
        """(N,): of each dot."""
        return np.repeat(np.arange(len(self.wires)), np.diff(self.first))

    def settled(self, starts: Array, threshold_mm: float) -> list[Settled]:
        """From rough similarities (K, 4, 4) to labels and least squares, in turn, on all frames."""
        if len(starts) == 0:
            return []
        found = _core.settle_labels(
            self.points, self.first, self.wires, np.ascontiguousarray(starts), threshold_mm
        )
        return [
            Settled(matrix, labels, distances, float(score))
            for matrix, labels, distances, score in zip(*found, strict=True)
            if np.isfinite(matrix).all()
        ]

    def telling_mm(self) -> float:
        """A fifth of the least distance between two wires, so that none is taken for the next; from 1 to 5 mm."""
        share = np.linspace(0, 1, SAMPLES)[:, None]
        places = [(1 - share) * one[0] + share * one[1] for one in self.wires[0]]
        apart = [
            np.linalg.norm(places[i][:, None] - places[j], axis=-1).min()
            for i in range(len(places))
            for j in range(i)
        ]
        return float(np.clip(SPACING_SHARE * min(apart, default=np.inf), LEAST_MM, MOST_MM))

    def sure(self, settled: Settled) -> NDArray[np.bool_]:
        """(N,): labelled dots that are not about as near to a second wire, as where two cross in the image."""
        ends = self.wires[self.frame]
        along = ends[:, :, 1] - ends[:, :, 0]
        along = along / np.linalg.norm(along, axis=-1, keepdims=True)
        away = (self.points @ settled.matrix[:3, :2].T + settled.matrix[:3, 3])[:, None] - ends[:, :, 0]
        away = away - np.einsum("nli,nli->nl", away, along)[..., None] * along
        distances = np.linalg.norm(away, axis=-1)
        labelled = np.flatnonzero(settled.labels >= 0)
        own = distances[labelled, settled.labels[labelled]]
        distances[labelled, settled.labels[labelled]] = np.inf
        sigma = float(np.median(own)) / 1.1774 if len(own) else 0.0
        sure = np.zeros(len(self.points), dtype=bool)
        sure[labelled] = distances[labelled].min(axis=1) > own + CLEARLY * sigma
        return sure

    def as_given(self, settled: Settled) -> tuple[NDArray[np.int64], Array]:
        """Labels that are sure and distances (N,) in the order in which the dots were given."""
        labels, distances = np.empty(len(self.points), dtype=np.int64), np.empty(len(self.points))
        sure = self.sure(settled)
        labels[self.order] = np.where(sure, settled.labels, -1)
        distances[self.order] = np.where(sure, settled.distances_mm, np.nan)
        return labels, distances

    def shuffled(self, by: int) -> LabelTable:
        """The same dots against the wires of other frames."""
        return LabelTable(
            self.points, self.first, np.ascontiguousarray(np.roll(self.wires, by, axis=0)), self.order
        )

    def box_mm2(self, scale: float) -> float:
        """The area of the box that holds all dots."""
        sides = np.ptp(self.points, axis=0) * scale if len(self.points) else np.zeros(2)
        return max(float(np.prod(sides)), 1e-9)


def _numbers(name: str, given: ArrayLike, shape: tuple[int, ...], words: str) -> Array:
    array = np.asarray(given, dtype=np.float64)
    if array.ndim != 1 + len(shape) or array.shape[1:] != shape:
        raise InputError(f"{name} must be {words}; got shape {array.shape}")
    if not np.isfinite(array).all():
        raise InputError(f"{name} holds a number that is not finite; leave out what was not found")
    return array
