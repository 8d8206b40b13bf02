"""What speaks for labels: that chance gives no such ones, that poses matter, and that no other answer fits as well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.geometry import Array
from sonocal.registration.label_table import LabelTable, Settled

__all__ = ["WireEvidence", "by_chance", "ratio_to_shuffled", "tells_apart", "wire_evidence"]

# What a dot that no wire explains costs, in nats: as much as one that is three standard deviations off.
MOST_COST = 4.5
# So many standard errors, of frames' differences, that an answer must be better by; and so many nats.
STANDARD_ERRORS, NATS = 4.0, 14.0
# Of frames, from which on these tell how much their differences scatter.
ENOUGH_FRAMES = 6
SHUFFLES = (0.5, 0.25, 0.38, 0.62, 0.12)
# Dots that make a hypothesis; and parts of the threshold that are tried.
SAMPLE, CLOSER = 4, (1.0, 0.7, 0.5, 0.35, 0.25)


def _level_mm2(settled: Settled) -> float:
    """Variance of a residual along either axis across its wire, from the median."""
    squares = settled.distances_mm[settled.labels >= 0] ** 2
    return float(np.median(squares)) / (2 * np.log(2)) if len(squares) else 1.0


def _costs(settled: Settled, level_mm2: float) -> Array:
    squares = np.where(settled.labels >= 0, settled.distances_mm, np.inf) ** 2
    return np.asarray(np.minimum(squares / (2 * level_mm2), MOST_COST))


def tells_apart(table: LabelTable, best: Settled, other: Settled) -> bool:
    """Whether the dots say that `other` is wrong.

    Costs are summed by frame, as a pose's error is shared by all dots of one; how much the frames' differences
    scatter tells what their sum is worth.
    """
    level = max(_level_mm2(best), 1e-12)
    each = np.bincount(table.frame, _costs(other, level) - _costs(best, level), minlength=len(table.wires))
    each = each[np.diff(table.first) > 0]
    if each.sum() < NATS:
        return False
    if len(each) < ENOUGH_FRAMES:
        return True
    error = float(np.std(each, ddof=1)) * np.sqrt(len(each))
    return bool(each.sum() > STANDARD_ERRORS * error)


def by_chance(table: LabelTable, settled: Settled, threshold_mm: float) -> float:
    """Log of how many answers would be expected to explain dots as well if these lay anywhere: below 0, none.

    At the distance at which that is least, as a right answer's dots lie near their wires.

    Source: a-contrario model estimation with an adaptive threshold (Moisan, Moulon and Monasse 2012).
    """
    from scipy.special import bdtrc

    scale = float(np.linalg.norm(settled.matrix[:3, 0]))
    wires, count = table.wires.shape[1], len(table.points)
    answers = SAMPLE * float(np.log(count * wires)) + float(np.log(len(CLOSER)))
    least = np.inf
    for within in threshold_mm * np.array(CLOSER):
        one = wires * np.pi * within**2 / table.box_mm2(scale)
        hits = int(np.count_nonzero(settled.distances_mm[settled.labels >= 0] <= within))
        if hits <= SAMPLE or one >= 1:
            continue
        tail = float(bdtrc(hits - SAMPLE - 1, count - SAMPLE, one))
        least = min(least, answers + float(np.log(max(tail, 1e-300))))
    return least


def ratio_to_shuffled(table: LabelTable, settled: Settled, threshold_mm: float) -> float:
    """The score, over the best that is left with the wires of other frames; 0 frames to shuffle: infinite."""
    frames = len(table.wires)
    shifts = sorted({max(1, round(frames * share)) for share in SHUFFLES} & set(range(1, frames)))
    scores = [
        one.score for by in shifts for one in table.shuffled(by).settled(settled.matrix[None], threshold_mm)
    ]
    return settled.score / max(*scores, 1e-9) if scores else np.inf


@dataclass(frozen=True, eq=False)
class WireEvidence:
    """What each wire says of the labels.

    Attributes:
        seen: (L,): how often it crosses the part of the image where dots are.
        hits: (L,): how often a dot was there.
        mean_mm: (L,): how far dots are from it on average.
        error_mm: (L,): by how much that is known.
    """

    seen: Array
    hits: Array
    mean_mm: Array
    error_mm: Array


def wire_evidence(table: LabelTable, settled: Settled) -> WireEvidence:
    """What each wire says of the labels."""
    wires = table.wires.shape[1]
    turn, origin = settled.matrix[:3, :3], settled.matrix[:3, 3]
    normal = turn[:, 2]
    along = table.wires[:, :, 1] - table.wires[:, :, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = ((origin - table.wires[:, :, 0]) @ normal) / (along @ normal)
        places = table.wires[:, :, 0] + share[..., None] * along
        crossing = np.linalg.solve(turn, (places - origin).reshape(-1, 3).T).T[:, :2]
    low, high = table.points.min(axis=0), table.points.max(axis=0)
    inside = (np.isfinite(crossing) & (crossing >= low) & (crossing <= high)).all(axis=1).reshape(-1, wires)
    known = settled.labels >= 0
    label, vectors = settled.labels[known], table.vectors(settled)[known]
    hits = np.bincount(label, minlength=wires).astype(float)
    at_least_one = np.maximum(hits, 1)
    mean = np.stack([np.bincount(label, vectors[:, k], minlength=wires) for k in range(3)], axis=1)
    mean /= at_least_one[:, None]
    squares = np.bincount(label, np.sum((vectors - mean[label]) ** 2, axis=1), minlength=wires)
    error = np.sqrt(squares / np.maximum(hits - 1, 1) / at_least_one)
    return WireEvidence(np.maximum(inside.sum(axis=0), hits), hits, np.linalg.norm(mean, axis=1), error)
