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
from sonocal.registration.label_evidence import by_chance, hardly_seen, ratio_to_shuffled, tells_apart
from sonocal.registration.label_rivals import rival_starts
from sonocal.registration.label_table import LabelTable, Settled
from sonocal.registration.options import positive_number, whole_number

__all__ = ["Association", "RivalLabels", "Verdict", "associate"]

Verdict = Literal["found", "ambiguous", "unfinished", "nothing fits"]

FINDS, FINDS_OF_ONE_FRAME = 5, 20
# Of the best score: what is worse is no rival.
LEAST_OF_BEST = 0.5
# Of the labelled dots: answers that differ in fewer are one.
SAME_LABELS = 0.02
# Log of expected answers by chance.
SURE = -7.0
LEAST_RATIO = 1.04
# Part of the lines: one or two of a phantom may be broken, or hidden.
MOST_HARDLY_SEEN = 1 / 3
# In thresholds: frames whose wires are nearer to one another say nothing of the poses.
STILL = 3.0
LABELLING = "another labelling"


@dataclass(frozen=True, eq=False)
class RivalLabels:
    """Another answer that the dots do not exclude.

    Attributes:
        name: where it comes from, such as "a turn by 180 degrees" of the wires.
        labels: (N,): the line of each dot, -1 for none.
        target_from_source: the similarity, mm from px.
        score: as of `Association`.
        apart_mm: how far the two take a dot apart at most.
    """

    name: str
    labels: NDArray[np.int64]
    target_from_source: Similarity
    score: float
    apart_mm: float

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
        rivals: other answers that the dots do not exclude, with other labels.
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
    answers = table.settled(matrices, within_mm)
    if not answers:
        return _nothing(table, within_mm, tried, "no similarity brings more than a few dots onto lines")
    named = [(LABELLING, one) for one in answers]
    best = max(answers, key=_score)
    for name, start in rival_starts(table, best):
        named += [(name, one) for one in table.settled(start[None], within_mm)]
    best = max((one for _, one in named), key=_score)
    return _judged(table, best, named, within_mm, (int(counts.max()), tried, finished))


def _judged(
    table: LabelTable,
    best: Settled,
    named: list[tuple[str, Settled]],
    within_mm: float,
    search: tuple[int, int, bool],
) -> Association:
    """The best answer, with the verdict on it."""
    finds, tried, finished = search
    rivals = _rivals(table, best, named)
    ratio = ratio_to_shuffled(table, best, within_mm) if _moves(table, within_mm) else np.inf
    symmetric = next((one for one in rivals if one.name != LABELLING), None)
    verdict: Verdict = "found"
    reason = f"the best of {tried} hypotheses, found {finds} times, fits {int((best.labels >= 0).sum())} dots"
    if by_chance(table, best, within_mm) > SURE:
        verdict = "nothing fits"
        reason = f"{int((best.labels >= 0).sum())} of {len(table.points)} dots lie on lines, and so many do by chance"
    elif symmetric is None and ratio < LEAST_RATIO:
        verdict = "nothing fits"
        reason = f"lines of other frames fit as well (the score is {ratio:.2f} of theirs): no pose tells"
    elif len(missing := hardly_seen(table, best)) > MOST_HARDLY_SEEN * table.wires.shape[1]:
        verdict = "nothing fits"
        reason = f"{len(missing)} of {table.wires.shape[1]} lines are hardly met: they are elsewhere, or not in view"
    elif symmetric is None and not finished:
        verdict, reason = (
            "unfinished",
            f"after {tried} hypotheses the best answer was found {finds} times only",
        )
    elif rivals:
        verdict, reason = "ambiguous", _open(symmetric or rivals[0])
    labels, residuals = _as_given(table, best)
    return Association(
        verdict, reason, labels, residuals, _similarity(best.matrix), rivals, best.score, ratio, within_mm, finds, tried
    )  # fmt: skip


def _rivals(table: LabelTable, best: Settled, named: list[tuple[str, Settled]]) -> tuple[RivalLabels, ...]:
    """Answers with other labels that the dots do not exclude, the best first, each once."""
    kept: list[Settled] = [best]
    found: list[RivalLabels] = []
    for name, one in sorted(named, key=lambda each: (-each[1].score, each[0] == LABELLING)):
        if one.score < LEAST_OF_BEST * best.score or any(_alike(one, other) for other in kept):
            continue
        kept.append(one)
        if tells_apart(table, best, one):
            continue
        away = table.points @ (one.matrix - best.matrix)[:3, :2].T + (one.matrix - best.matrix)[:3, 3]
        labels = _as_given(table, one)[0]
        apart = float(np.linalg.norm(away, axis=1).max())
        found.append(RivalLabels(name, labels, _similarity(one.matrix), one.score, apart))
    return tuple(found)


def _score(settled: Settled) -> float:
    return settled.score


def _alike(one: Settled, other: Settled) -> bool:
    both = (one.labels >= 0) & (other.labels >= 0)
    count = int(np.count_nonzero(both))
    differ = int(np.count_nonzero(one.labels[both] != other.labels[both]))
    return count > 0 and differ <= SAME_LABELS * count


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
    return Association("nothing fits", why, none, far, None, (), 0.0, 0.0, within_mm, 0, tried)


def _as_given(table: LabelTable, settled: Settled) -> tuple[NDArray[np.int64], Array]:
    """Labels and distances in the order in which the dots were given."""
    labels, distances = np.empty(len(table.points), dtype=np.int64), np.empty(len(table.points))
    sure = table.sure(settled)
    labels[table.order] = np.where(sure, settled.labels, -1)
    distances[table.order] = np.where(sure, settled.distances_mm, np.nan)
    return labels, distances


def _similarity(matrix: Array) -> Similarity:
    return Similarity.from_matrix(matrix)
