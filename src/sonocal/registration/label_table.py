"""Dots of images and the wires that they may be of, in the form that the core takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.geometry import Array
from sonocal.registration.label_input import numbers, sorted_by_frame

__all__ = ["LabelTable", "Settled", "Shifted", "distances_from"]

SPACING_SHARE, LEAST_MM, MOST_MM = 0.2, 1.0, 5.0
SAMPLES, MOST_LOOKED_AT = 64, 9
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
class Shifted:
    """What an answer leaves when each frame is shifted by what its pose may be off.

    Attributes:
        costs: (F,), nats: of a frame's dots, at most 4.5 each, and of its shift.
        labels: (N,): the wire of each dot, -1 for none.
        distances_mm: (N,): from it; NaN without one.
        shifts_mm: (F, 3).
    """

    costs: Array
    labels: NDArray[np.int32]
    distances_mm: Array
    shifts_mm: Array


@dataclass(frozen=True, eq=False)
class LabelTable:
    """Dots, frame by frame.

    Attributes:
        points: (N, 2), px, in the order of frames.
        first: (F + 1,): a frame's dots are those from its number here to the next.
        wires: (F, L, 2, 3), mm.
        order: (N,): where each dot stood when it was given.
    """

    sample: ClassVar[int] = 4
    """How many dots on wires give a similarity."""
    most_hardly_seen: ClassVar[float] = 1 / 3
    """Part of the wires: one or two of a phantom may be broken, or hidden."""

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
        return cls(*sorted_by_frame(numbers("points", points, (2,), "(N, 2) px"), wires, frame))

    def why_none(self) -> str:
        """Why no answer was found, as far as can be told."""
        return "no similarity brings more than a few dots onto lines"

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
        """A fifth of the least distance between two wires, so that none is taken for the next; from 1 to 5 mm.

        Of needles that move against one another, in the middle one of some frames.
        """
        share = np.linspace(0, 1, SAMPLES)[:, None]
        least: list[float] = []
        for wires in self.wires[np.unique(np.linspace(0, len(self.wires) - 1, MOST_LOOKED_AT).astype(int))]:
            places = [(1 - share) * one[0] + share * one[1] for one in wires]
            apart = [
                np.linalg.norm(places[i][:, None] - places[j], axis=-1).min()
                for i in range(len(places))
                for j in range(i)
            ]
            least.append(float(min(apart, default=np.inf)))
        return float(np.clip(SPACING_SHARE * float(np.median(least)), LEAST_MM, MOST_MM))

    def mapped_mm(self, matrix: Array) -> Array:
        """(M, 3): where a similarity takes the dots."""
        return np.asarray(self.points @ matrix[:3, :2].T + matrix[:3, 3])

    def distances_mm(self, matrix: Array) -> Array:
        """(N, L): of each dot from each wire of its frame."""
        return distances_from(self.mapped_mm(matrix)[:, None], self.wires[self.frame])

    def sure(self, settled: Settled) -> NDArray[np.bool_]:
        """(N,): labelled dots that are not about as near to a second wire, as where two cross in the image."""
        distances = self.distances_mm(settled.matrix)
        labelled = np.flatnonzero(settled.labels >= 0)
        own = distances[labelled, settled.labels[labelled]]
        distances[labelled, settled.labels[labelled]] = np.inf
        sigma = float(np.median(own)) / 1.1774 if len(own) else 0.0
        sure = np.zeros(len(self.points), dtype=bool)
        sure[labelled] = distances[labelled].min(axis=1) > own + CLEARLY * sigma
        return sure

    def shifted(
        self, answers: list[Settled], threshold_mm: float, dot_mm: float, shift_mm: float
    ) -> list[Shifted]:
        """What each of some answers costs, frame by frame, with errors of dots and of frames (standard deviations)."""
        starts = np.stack([one.matrix for one in answers])
        found = _core.shift_labels(
            self.points, self.first, self.wires, starts, threshold_mm, dot_mm, shift_mm
        )
        return [Shifted(*each) for each in zip(*found, strict=True)]

    def chance(self, scale: float, within_mm: float) -> float:
        """How many wires are within a distance of a dot that lies anywhere, on average."""
        return float(self.wires.shape[1] * np.pi * within_mm**2 / self.box_mm2(scale))

    def as_given(self, settled: Settled) -> tuple[NDArray[np.int64], Array]:
        """Labels that are sure and distances (N,) in the order in which the dots were given."""
        labels, distances = np.empty(len(self.points), dtype=np.int64), np.empty(len(self.points))
        sure = self.sure(settled)
        labels[self.order] = np.where(sure, settled.labels, -1)
        distances[self.order] = np.where(sure, settled.distances_mm, np.nan)
        return labels, distances

    def shuffled(self, by: int) -> LabelTable:
        """The same dots against the wires of other frames."""
        return replace(self, wires=np.ascontiguousarray(np.roll(self.wires, by, axis=0)))

    def box_mm2(self, scale: float) -> float:
        """The area of the box that holds all dots."""
        sides = np.ptp(self.points, axis=0) * scale if len(self.points) else np.zeros(2)
        return max(float(np.prod(sides)), 1e-9)


def distances_from(places: Array, wires: Array) -> Array:
    """(...): of places (..., 3) from the lines through the ends of wires (..., 2, 3)."""
    along = wires[..., 1, :] - wires[..., 0, :]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    away = places - wires[..., 0, :]
    away = away - np.sum(away * along, axis=-1, keepdims=True) * along
    return np.asarray(np.linalg.norm(away, axis=-1))
