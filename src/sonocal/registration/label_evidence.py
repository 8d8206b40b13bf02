"""What speaks for labels: that chance gives no such ones, that poses matter, and that no other answer fits as well."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.label_table import LabelTable, Settled

__all__ = ["by_chance", "hardly_seen", "ratio_to_shuffled", "tells_apart"]

# What a dot that no wire explains costs, in nats: as much as one that is three standard deviations off.
MOST_COST = 4.5
# So many standard errors, of frames' differences, that an answer must be better by; and so many nats.
STANDARD_ERRORS, NATS = 2.5, 25.0
# Of a few frames, of which nobody knows how much they scatter.
NATS_OF_FEW = 14.0
# A wire of fewer dots than such a part of the best met one's is hardly seen, where there are so many frames.
HARDLY, LEAST_SHOWN = 0.25, 4
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
    if len(each) < ENOUGH_FRAMES:
        return bool(each.sum() >= NATS_OF_FEW)
    if each.sum() < NATS:
        return False
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


def hardly_seen(table: LabelTable, settled: Settled) -> NDArray[np.int64]:
    """Wires of which far fewer dots are than of the others.

    Dots are lost of all wires alike; of a phantom whose wires are elsewhere a few are met by accident, others never.
    """
    if np.count_nonzero(np.diff(table.first)) < LEAST_SHOWN:
        return np.empty(0, dtype=np.int64)
    hits = np.bincount(settled.labels[settled.labels >= 0], minlength=table.wires.shape[1])
    return np.flatnonzero(hits < HARDLY * hits.max())


def ratio_to_shuffled(table: LabelTable, settled: Settled, threshold_mm: float) -> float:
    """The score, over the best that is left with the wires of other frames; 0 frames to shuffle: infinite."""
    frames = len(table.wires)
    shifts = sorted({max(1, round(frames * share)) for share in SHUFFLES} & set(range(1, frames)))
    scores = [
        one.score for by in shifts for one in table.shuffled(by).settled(settled.matrix[None], threshold_mm)
    ]
    return settled.score / max(*scores, 1e-9) if scores else np.inf
