"""Answers beside the best one: each once, by name, and how far they are from it."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Similarity
from sonocal.registration.association import RivalLabels
from sonocal.registration.label_errors import Answer
from sonocal.registration.label_evidence import nats_apart, tells_apart
from sonocal.registration.label_table import LabelTable
from sonocal.registration.label_views import telling_view

__all__ = ["LABELLING", "SAME_LABELS", "other_answers"]

# Of the dots that both label: answers that differ in fewer are one; so are those that are near to one another, of which
# the noise of a dot or two decides.
SAME_LABELS, SAME_LABELS_NEARBY = 0.02, 0.15
# In thresholds: answers that take a dot farther apart are two, whatever their labels.
FAR = 3.0
LABELLING, ELSEWHERE = "another labelling", "another place of the images"


def other_answers(
    table: LabelTable, answers: list[Answer], within_mm: float
) -> list[tuple[RivalLabels, bool]]:
    """Other answers, each once, the likeliest first; and whether the dots exclude them.

    Of those that have the best one's labels the first that is far from it, and not excluded.
    """
    best = answers[0]
    kept: list[Answer] = [best]
    found: list[tuple[RivalLabels, bool]] = []
    tilted = False
    for one in sorted(answers[1:], key=lambda each: (each.cost, each.name == LABELLING)):
        apart, share = _apart_mm(table, best, one), _differing(best, one)
        excluded = tells_apart(table, best, one)
        if any(_alike(table, one, other, within_mm) for other in kept):
            if tilted or excluded or share > SAME_LABELS or apart < FAR * within_mm:
                continue
            tilted = True
        kept.append(one)
        labels, there = table.as_given(one.settled)[0], Similarity.from_matrix(one.settled.matrix)
        nats, _ = nats_apart(table, best.shifted.costs, one.shifted.costs)
        name = _name(table, one, answers, within_mm)
        view = telling_view(table, best.settled.matrix, one.settled.matrix)
        rival = RivalLabels(name, labels, there, one.settled.score, apart, nats, share, *view)
        found.append((rival, excluded))
    return found


def _name(table: LabelTable, one: Answer, answers: list[Answer], within_mm: float) -> str:
    """Of an answer; of one that the search found and a symmetry of the wires leads to, or away from, the symmetry's."""
    if one.name != LABELLING:
        return one.name
    if _differing(answers[0], one) <= SAME_LABELS:
        return ELSEWHERE
    named = (other for other in answers[1:] if other.name != LABELLING)
    return next((other.name for other in named if _alike(table, one, other, within_mm)), answers[0].name)


def _differing(one: Answer, other: Answer) -> float:
    """Of the dots that both label, the share that they label otherwise; 1 where there are none."""
    labels, others = one.settled.labels, other.settled.labels
    both = (labels >= 0) & (others >= 0)
    return float(np.mean(labels[both] != others[both])) if both.any() else 1.0


def _apart_mm(table: LabelTable, one: Answer, other: Answer) -> float:
    """The farthest that two answers take a dot apart."""
    between = table.mapped_mm(one.settled.matrix) - table.mapped_mm(other.settled.matrix)
    return float(np.linalg.norm(between, axis=1).max())


def _alike(table: LabelTable, one: Answer, other: Answer, within_mm: float) -> bool:
    share = _differing(one, other)
    if share <= SAME_LABELS:
        return True
    return share <= SAME_LABELS_NEARBY and _apart_mm(table, one, other) < FAR * within_mm
