"""Errors of dots, and those that the dots of a frame share, as they come of its pose: what each answer costs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.registration.label_table import LabelTable, Settled, Shifted

__all__ = ["Answer", "FrameErrors", "weighed"]

# In thresholds: what is taken before an answer is known, and what is tried where one is.
FIRST_DOT, FIRST_SHIFT = 0.2, 0.6
DOTS, SHIFTS = (0.03, 0.06, 0.1, 0.15, 0.2, 0.3), (0.05, 0.2, 0.4, 0.7, 1.0)


@dataclass(frozen=True)
class FrameErrors:
    """Standard deviations along each axis, mm: of a dot, and of the shift that a frame's dots share.

    A tracker's error moves all dots of a frame alike, and is often several times what each is off by itself.
    """

    dot_mm: float
    shift_mm: float

    @classmethod
    def expected(cls, threshold_mm: float) -> FrameErrors:
        """Before any answer is known."""
        return cls(FIRST_DOT * threshold_mm, FIRST_SHIFT * threshold_mm)

    @classmethod
    def of(cls, table: LabelTable, answer: Settled, threshold_mm: float) -> FrameErrors:
        """As the residuals of an answer have them: those under which its dots are likeliest."""
        tried = [cls(dot * threshold_mm, shift * threshold_mm) for dot in DOTS for shift in SHIFTS]
        return max(
            tried,
            key=lambda one: one._likelihood(table, answer, one.shifted(table, [answer], threshold_mm)[0]),
        )

    def _likelihood(self, table: LabelTable, answer: Settled, one: Shifted) -> float:
        """Log, over that of dots that lie anywhere in the images."""
        given = one.labels >= 0
        each = np.bincount(table.frame[given], minlength=len(table.wires))
        anywhere = table.box_mm2(float(np.linalg.norm(answer.matrix[:3, 0]))) / table.wires.shape[1]
        dots = given.sum() * np.log(anywhere / (2 * np.pi * self.dot_mm**2))
        dots -= float((one.distances_mm[given] ** 2).sum()) / (2 * self.dot_mm**2)
        shifts = float((one.shifts_mm**2).sum()) / (2 * self.shift_mm**2)
        # A shift across the wires has two components, each known as well as its dots tell it.
        return float(dots - shifts - np.log1p(each * (self.shift_mm / self.dot_mm) ** 2).sum())

    def shifted(self, table: LabelTable, answers: list[Settled], threshold_mm: float) -> list[Shifted]:
        """What each answer costs, frame by frame."""
        if not answers:
            return []
        return table.shifted(answers, threshold_mm, self.dot_mm, self.shift_mm)


@dataclass(frozen=True, eq=False)
class Answer:
    """One of several, and what it costs.

    Attributes:
        name: where it comes from.
        settled: its similarity and labels.
        shifted: what it leaves.
    """

    name: str
    settled: Settled
    shifted: Shifted

    @property
    def cost(self) -> float:
        """Of all dots and frames, nats."""
        return float(self.shifted.costs.sum())


def weighed(
    table: LabelTable, named: list[tuple[str, Settled]], errors: FrameErrors, threshold_mm: float
) -> list[Answer]:
    """Answers by what they cost, the least first; none that shrinks the images so that dots are near wires anyway."""
    wires = table.wires.shape[1] * np.pi * threshold_mm**2
    kept = [
        (name, one) for name, one in named if table.box_mm2(float(np.linalg.norm(one.matrix[:3, 0]))) > wires
    ]
    shifted = errors.shifted(table, [one for _, one in kept], threshold_mm)
    answers = [Answer(name, one, each) for (name, one), each in zip(kept, shifted, strict=True)]
    return sorted(answers, key=lambda one: one.cost)
