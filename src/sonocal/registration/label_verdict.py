"""The verdict on the best labels: found, open between several, not searched for long enough, or of something else."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Similarity
from sonocal.registration.association import Association, RivalLabels, Verdict
from sonocal.registration.label_errors import Answer, FrameErrors
from sonocal.registration.label_evidence import AgainstShuffled, by_chance, hardly_seen
from sonocal.registration.label_others import LABELLING, SAME_LABELS, other_answers
from sonocal.registration.label_table import LabelTable

__all__ = ["judged", "nothing_fits"]

# Log of expected answers by chance.
SURE = -7.0
# In thresholds: frames whose wires are nearer to one another say nothing of the poses.
STILL = 3.0


def judged(
    table: LabelTable,
    answers: list[Answer],
    errors: FrameErrors,
    within_mm: float,
    search: tuple[int, int, bool],
) -> Association:
    """The best answer, with the verdict on it."""
    finds, tried, finished = search
    best, others = answers[0], other_answers(table, answers, within_mm)
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
    elif len(missing := hardly_seen(table, best)) > table.most_hardly_seen * table.wires.shape[1]:
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
    labels, residuals = table.as_given(best.settled)
    second = next((one for one, _ in others if one.share_of_labels > SAME_LABELS), None)
    return Association(
        verdict, reason, labels, residuals, Similarity.from_matrix(best.settled.matrix), rivals, second,
        best.settled.score, poses.ratio, within_mm, finds, tried,
    )  # fmt: skip


def nothing_fits(table: LabelTable, within_mm: float, tried: int, why: str) -> Association:
    """Where no answer was found."""
    count = len(table.points)
    none, far = np.full(count, -1, dtype=np.int64), np.full(count, np.nan)
    return Association("nothing fits", why, none, far, None, (), None, 0.0, 0.0, within_mm, 0, tried)


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
