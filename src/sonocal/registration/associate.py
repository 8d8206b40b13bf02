"""Which dot of an image is of which line, with nobody naming one; and the similarity that goes with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.errors import InputError
from sonocal.geometry import Array, Similarity
from sonocal.geometry.shown import brief
from sonocal.registration.label_errors import Answer, FrameErrors, weighed
from sonocal.registration.label_evidence import (
    AgainstShuffled,
    by_chance,
    hardly_seen,
    nats_apart,
    tells_apart,
)
from sonocal.registration.label_rivals import rival_starts
from sonocal.registration.label_table import LabelTable, Settled
from sonocal.registration.options import positive_number, whole_number

__all__ = ["Association", "RivalLabels", "Verdict", "associate"]

Verdict = Literal["found", "ambiguous", "unfinished", "nothing fits"]

FINDS, FINDS_OF_ONE_FRAME = 5, 20
# Of the dots that both label: answers that differ in fewer are one; so are those that are near to one another, of which
# the noise of a dot or two decides.
SAME_LABELS, SAME_LABELS_NEARBY = 0.02, 0.15
# In thresholds: answers that take a dot farther apart are two, whatever their labels.
FAR = 3.0
# Log of expected answers by chance.
SURE = -7.0
# Part of the lines: one or two of a phantom may be broken, or hidden.
MOST_HARDLY_SEEN = 1 / 3
# In thresholds: frames whose wires are nearer to one another say nothing of the poses.
STILL = 3.0
LABELLING, ELSEWHERE = "another labelling", "another place of the images"


@dataclass(frozen=True, eq=False)
class RivalLabels:
    """Another answer that the dots do not exclude.

    Attributes:
        name: where it comes from, such as "a turn by 180 degrees" of the wires.
        labels: (N,): the line of each dot, -1 for none.
        target_from_source: the similarity, mm from px.
        score: as of `Association`.
        apart_mm: how far the two take a dot apart at most.
        behind_nats: how much less likely it is, as a logarithm; a shift of each frame, as of its pose, is let be.
        share_of_labels: of the dots that both label, the share that it labels otherwise: 0 for another similarity
            alone.
    """

    name: str
    labels: NDArray[np.int64]
    target_from_source: Similarity
    score: float
    apart_mm: float
    behind_nats: float
    share_of_labels: float

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class Association:
    """Labels of dots, and how sure they are.

    Attributes:
        verdict: "found"; "ambiguous": another answer fits as well; "unfinished": the search ended before it was
            sure; "nothing fits": dots and lines have nothing to do with each other, as far as is seen. Labels are
            answers where it is "found" alone.
        reason: of the verdict, in a sentence.
        labels: (N,): the line of each dot, -1 for none, and where two lines cross so near to it that noise decides.
        residuals_mm: (N,): of each dot from its line; NaN without one.
        target_from_source: the similarity that they were found with, mm from px; None where nothing was.
        rivals: other answers that the dots do not exclude; where it is "found", with the same labels.
        second: the next best answer with other labels, excluded or not, and how far behind; None where none comes near.
        score: sum over the dots of 1 - (residual / threshold)^2.
        ratio: the score over the best that is left with the lines of other frames.
        threshold_mm: dots farther from a line are not of it.
        finds: how often the answer was found.
        hypotheses: how many were tried.
    """

    verdict: Verdict
    reason: str
    labels: NDArray[np.int64]
    residuals_mm: Array
    target_from_source: Similarity | None
    rivals: tuple[RivalLabels, ...]
    second: RivalLabels | None
    score: float
    ratio: float
    threshold_mm: float
    finds: int
    hypotheses: int

    __repr__ = brief


def associate(
    points: ArrayLike,
    lines: ArrayLike,
    *,
    frame: ArrayLike | None = None,
    threshold_mm: float | Literal["auto"] = "auto",
    max_hypotheses: int = 3_000_000,
    time_limit_s: float = 6.0,
    seed: int = 0,
) -> Association:
    """Which dot is of which line, and the similarity that carries dots onto lines, with no label known.

    Four dots on four lines give a similarity (four_points); it is right where all four pairs are, and then the lines
    cross the images at other dots, too. The search ends when its best answer was found five times, twenty of a single
    frame. Then the answers that it is most easily taken for are tried on purpose: the tilt that nearly parallel lines
    leave open, and the motions that bring the lines onto themselves.

    Args:
        points: (N, 2), px: dots of all frames; some may be of no line.
        lines: (L, 2, 3) mm, two points on each at the ends of what may be seen; or (F, L, 2, 3), of every frame, in
            the frame of the target, such as the probe's marker.
        frame: (N,): of each dot, an index into the first axis of lines; default: all of one.
        threshold_mm: dots farther from a line are not of it, in units of the lines; "auto": a fifth of the least
            distance between two lines, from 1 to 5.
        max_hypotheses: the search is unfinished after so many; the same seed gives the same answer.
        time_limit_s: or after so long.
        seed: of the search.

    Returns:
        The labels, the similarity, and a verdict on them.

    Raises:
        InputError: shapes differ, a number is not finite, there are fewer than two lines, or an option means nothing.

    Source: the paper's section 6.2, for hypotheses of labels.
    """
    table = LabelTable.of(points, lines, frame)
    if table.wires.shape[1] < 2:
        raise InputError("one line needs no labels: register its points with point_line and register")
    within_mm = (
        table.telling_mm() if threshold_mm == "auto" else positive_number("threshold_mm", threshold_mm)
    )
    most = whole_number("max_hypotheses", max_hypotheses, 1, 1 << 40)
    seconds = positive_number("time_limit_s", time_limit_s)
    finds = FINDS if np.count_nonzero(np.diff(table.first)) > 1 else FINDS_OF_ONE_FRAME
    matrices, _, counts, tried, finished = _core.search_labels(
        table.points, table.first, table.wires, within_mm, finds, most, seconds, 0.0, 0.0,
        whole_number("seed", seed, 0, 2**63 - 1),
    )  # fmt: skip
    named = [(LABELLING, one) for one in table.settled(matrices, within_mm)]
    answers = weighed(table, named, FrameErrors.expected(within_mm), within_mm)
    if not answers:
        return _nothing(table, within_mm, tried, "no similarity brings more than a few dots onto lines")
    for name, start in rival_starts(table, answers[0].settled):
        named += [(name, one) for one in table.settled(start[None], within_mm)]
    for _ in range(2):  # of the best, which they may change
        errors = FrameErrors.of(table, answers[0].settled, within_mm)
        answers = weighed(table, named, errors, within_mm)
    return _judged(table, answers, errors, within_mm, (int(counts.max()), tried, finished))


def _judged(
    table: LabelTable,
    answers: list[Answer],
    errors: FrameErrors,
    within_mm: float,
    search: tuple[int, int, bool],
) -> Association:
    """The best answer, with the verdict on it."""
    finds, tried, finished = search
    best, others = answers[0], _others(table, answers, within_mm)
    rivals = tuple(one for one, excluded in others if not excluded)
    doubts = [one for one in rivals if one.share_of_labels > SAME_LABELS]
    poses = AgainstShuffled.of(table, best, errors, within_mm)
    symmetric = next((one for one in doubts if one.name != LABELLING), None)
    fits = int((best.settled.labels >= 0).sum())
    verdict: Verdict = "found"
    reason = f"the best of {tried} hypotheses, found {finds} times, fits {fits} dots"
    if by_chance(table, best, within_mm) > SURE:
        verdict = "nothing fits"
        reason = f"{fits} of {len(table.points)} dots lie on lines, and so many do by chance"
    elif symmetric is None and _moves(table, within_mm) and not poses.tells:
        verdict = "nothing fits"
        reason = f"lines of other frames fit nearly as well (the score is {poses.ratio:.2f} of theirs): no pose tells"
    elif len(missing := hardly_seen(table, best)) > MOST_HARDLY_SEEN * table.wires.shape[1]:
        verdict = "nothing fits"
        reason = f"{len(missing)} of {table.wires.shape[1]} lines are hardly met: they are elsewhere, or not in view"
    elif symmetric is None and not finished:
        verdict, reason = (
            "unfinished",
            f"after {tried} hypotheses the best answer was found {finds} times only",
        )
    elif doubts:
        verdict, reason = "ambiguous", _open(symmetric or doubts[0])
    elif rivals:
        reason += (
            f"; {rivals[0].name} has the same labels and fits as well, up to {rivals[0].apart_mm:.1f} mm away"
        )
    labels, residuals = _as_given(table, best.settled)
    second = next((one for one, _ in others if one.share_of_labels > SAME_LABELS), None)
    return Association(
        verdict, reason, labels, residuals, _similarity(best.settled.matrix), rivals, second,
        best.settled.score, poses.ratio, within_mm, finds, tried,
    )  # fmt: skip


def _others(table: LabelTable, answers: list[Answer], within_mm: float) -> list[tuple[RivalLabels, bool]]:
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
        labels = _as_given(table, one.settled)[0]
        nats, _ = nats_apart(table, best.shifted.costs, one.shifted.costs)
        name = ELSEWHERE if one.name == LABELLING and share <= SAME_LABELS else one.name
        found.append((
            RivalLabels(name, labels, _similarity(one.settled.matrix), one.settled.score, apart, nats, share),
            excluded,
        ))  # fmt: skip
    return found


def _differing(one: Answer, other: Answer) -> float:
    """Of the dots that both label, the share that they label otherwise; 1 where there are none."""
    labels, others = one.settled.labels, other.settled.labels
    both = (labels >= 0) & (others >= 0)
    return float(np.mean(labels[both] != others[both])) if both.any() else 1.0


def _apart_mm(table: LabelTable, one: Answer, other: Answer) -> float:
    """The farthest that two answers take a dot apart."""
    between = one.settled.matrix - other.settled.matrix
    return float(np.linalg.norm(table.points @ between[:3, :2].T + between[:3, 3], axis=1).max())


def _alike(table: LabelTable, one: Answer, other: Answer, within_mm: float) -> bool:
    share = _differing(one, other)
    if share <= SAME_LABELS:
        return True
    return share <= SAME_LABELS_NEARBY and _apart_mm(table, one, other) < FAR * within_mm


def _open(rival: RivalLabels) -> str:
    """What is left open, and which view would tell."""
    if rival.name == LABELLING:
        tells = "add frames in which more of the lines are seen, from other sides"
    else:
        tells = "turn the image against the lines, by 20 degrees and more about u and about v, and move it across them"
    return f"{rival.name} fits as well, up to {rival.apart_mm:.1f} mm away; {tells}"


def _moves(table: LabelTable, within_mm: float) -> bool:
    """Whether wires move across themselves from frame to frame, so that those of another do not fit."""
    along = table.wires[:, :, 1] - table.wires[:, :, 0]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    away = table.wires[:1] - table.wires[:, :, :1]
    away = away - np.einsum("flei,fli->fle", away, along)[..., None] * along[:, :, None]
    return bool(np.linalg.norm(away, axis=-1).max() > STILL * within_mm)


def _nothing(table: LabelTable, within_mm: float, tried: int, why: str) -> Association:
    count = len(table.points)
    none, far = np.full(count, -1, dtype=np.int64), np.full(count, np.nan)
    return Association("nothing fits", why, none, far, None, (), None, 0.0, 0.0, within_mm, 0, tried)


def _as_given(table: LabelTable, settled: Settled) -> tuple[NDArray[np.int64], Array]:
    """Labels and distances in the order in which the dots were given."""
    labels, distances = np.empty(len(table.points), dtype=np.int64), np.empty(len(table.points))
    sure = table.sure(settled)
    labels[table.order] = np.where(sure, settled.labels, -1)
    distances[table.order] = np.where(sure, settled.distances_mm, np.nan)
    return labels, distances


def _similarity(matrix: Array) -> Similarity:
    return Similarity.from_matrix(matrix)
