"""Two lines of volumes on two wires give a similarity: which pairs are right, as all others then say."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, segment_directions
from sonocal.registration.label_input import SearchLimits
from sonocal.registration.label_lines import FEWEST, LineTable
from sonocal.registration.label_table import Settled, distances_from
from sonocal.registration.minimal_solvers import two_lines

__all__ = ["search_lines"]

DRAWN, CHECKED_FRAMES = 1024, 16
# Lines enclose the angle of their wires, but for noise.
SAME_ANGLE_DEG = 8.0
# Pairs nearer to parallel tell no turn.
LEAST_ANGLE_DEG = 3.0
# Of those scored at a time, so many are settled; rough ones are scored within so many thresholds.
SETTLED, ROUGH = 6, 3.0
MOST_CANDIDATES = 12
# In thresholds, and how many wires a line may be so near to by chance: else a score says nothing.
SHRUNK, BY_CHANCE = 2.0, 0.2
# Answers are one that label so large a part of the lines alike that both label.
SAME_LABELS = 0.95
# An answer that comes so near to the best one asks for that to be found so many times as often.
NEAR, AGAINST_NEAR = 0.8, 3


@dataclass
class _Found:
    """Answers so far, the best first, and how often each was found."""

    answers: list[Settled] = field(default_factory=list)
    finds: list[int] = field(default_factory=list)

    def add(self, one: Settled) -> None:
        for i, other in enumerate(self.answers):
            both = (one.labels >= 0) & (other.labels >= 0)
            if both.any() and np.mean(one.labels[both] == other.labels[both]) >= SAME_LABELS:
                self.finds[i] += 1
                if one.score > other.score:
                    self.answers[i] = one
                break
        else:
            self.answers.append(one)
            self.finds.append(1)
        order = np.argsort([-each.score for each in self.answers], kind="stable")[:MOST_CANDIDATES]
        self.answers, self.finds = [self.answers[i] for i in order], [self.finds[i] for i in order]

    def is_sure(self, finds: int) -> bool:
        if not self.answers:
            return False
        near = len(self.answers) > 1 and self.answers[1].score > NEAR * self.answers[0].score
        return self.finds[0] >= finds * (AGAINST_NEAR if near else 1)


def search_lines(
    table: LineTable, within_mm: float, limits: SearchLimits
) -> tuple[Array, NDArray[np.int64], int, bool]:
    """Answers by trying two lines on two wires, until the best one was found so often.

    Args:
        table: lines and wires.
        within_mm: a line farther from a wire is not of it.
        limits: when to end; the best answer is to be found three times as often while another comes near it.

    Returns:
        Similarities (K, 4, 4) mm from px, the best first; how often each was found; how many hypotheses were tried;
        and whether the search came to its end.

    Source: the paper's section 6.2, with two lines for four points.
    """
    random, begin, found, tried = np.random.default_rng(limits.seed), time.monotonic(), _Found(), 0
    if len(table.points) < FEWEST:
        return np.empty((0, 4, 4)), np.empty(0, dtype=np.int64), 0, False
    used = np.flatnonzero(np.diff(table.first) > 0)
    checked = random.permutation(used)[:CHECKED_FRAMES]
    part = _of_frames(table, checked)
    while tried < limits.hypotheses and time.monotonic() - begin < limits.seconds:
        pairs = _drawn(table, random)
        tried += len(pairs[0])
        if len(pairs[0]) == 0:
            tried += DRAWN  # none that could be right: that is an end, too
            continue
        matrices = _solved(table, *pairs)
        scales = np.linalg.norm(matrices[:, :3, 0], axis=1)
        # A volume that is shrunk onto where wires come together is near to them whatever it shows.
        matrices = matrices[[table.chance(float(one), SHRUNK * within_mm) < BY_CHANCE for one in scales]]
        scores = _scores(part, matrices, ROUGH * within_mm)
        for i in np.argsort(-scores, kind="stable")[:SETTLED]:
            if scores[i] > 0:
                for one in part.settled(matrices[i][None], within_mm):
                    found.add(one)
        if found.is_sure(limits.finds):
            break
    matrices = np.array([one.matrix for one in found.answers]).reshape(-1, 4, 4)
    return matrices, np.array(found.finds, dtype=np.int64), tried, found.is_sure(limits.finds)


def _of_frames(table: LineTable, frames: NDArray[np.intp]) -> LineTable:
    keep = np.isin(table.frame, frames)
    number = np.searchsorted(np.sort(frames), table.frame[keep])
    return LineTable.of(table.points[keep], table.wires[np.sort(frames)], number)


def _drawn(
    table: LineTable, random: np.random.Generator
) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Two lines each and two wires for them that enclose the same angle; half of them of one frame, if it has two."""
    count, wires = len(table.points), table.wires.shape[1]
    frame, each = table.frame, np.diff(table.first)
    one = random.integers(0, count, size=DRAWN)
    here = table.first[frame[one]] + (random.random(DRAWN) * each[frame[one]]).astype(np.int64)
    other = np.where(random.random(DRAWN) < 0.5, here, random.integers(0, count, size=DRAWN))
    first, second = random.integers(0, wires, size=DRAWN), random.integers(0, wires, size=DRAWN)
    # A frame shows a wire once, and a line is no pair.
    keep = (one != other) & ((frame[one] != frame[other]) | (first != second))
    one, other, first, second = one[keep], other[keep], first[keep], second[keep]
    lines, there = segment_directions(table.points), segment_directions(table.wires)
    seen = _angle_deg(lines[one], lines[other])
    meant = _angle_deg(there[frame[one], first], there[frame[other], second])
    alike = (np.abs(seen - meant) < SAME_ANGLE_DEG) & (np.minimum(seen, meant) > LEAST_ANGLE_DEG)
    return one[alike], other[alike], first[alike], second[alike]


def _angle_deg(one: Array, other: Array) -> Array:
    return np.asarray(np.degrees(np.arccos(np.clip(np.abs(np.sum(one * other, axis=-1)), 0, 1))))


def _solved(
    table: LineTable,
    one: NDArray[np.intp],
    other: NDArray[np.intp],
    first: NDArray[np.intp],
    second: NDArray[np.intp],
) -> Array:
    """(K, 4, 4): what the pairs give."""
    lines = np.stack([table.points[one], table.points[other]], axis=1)
    wires = np.stack([table.wires[table.frame[one], first], table.wires[table.frame[other], second]], axis=1)
    solved = two_lines(lines, wires)
    real = np.arange(solved.matrices.shape[1]) < np.reshape(solved.count, (-1, 1))
    return np.asarray(solved.matrices[real])


def _scores(table: LineTable, matrices: Array, within_mm: float) -> Array:
    """(K,): sum over lines of 1 - (distance / threshold)^2, each from the nearest wire of its frame."""
    scores = np.zeros(len(matrices))
    for frame in range(len(table.wires)):
        lines = table.points[table.first[frame] : table.first[frame + 1]]
        mapped = np.einsum("kij,nej->knei", matrices[:, :3, :3], lines) + matrices[:, None, None, :3, 3]
        each = distances_from(mapped[:, :, None], table.wires[frame][:, None])  # (K, n, L, 2)
        least = np.mean(each**2, axis=-1).min(axis=-1)
        scores += np.maximum(1 - least / within_mm**2, 0).sum(axis=1)
    return scores
