"""What speaks for labels: that chance gives no such ones, that poses matter, and that no other answer fits as well."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.label_errors import Answer, FrameErrors
from sonocal.registration.label_table import LabelTable

__all__ = ["AgainstShuffled", "by_chance", "hardly_seen", "nats_apart", "tells_apart"]

# So many standard errors, of frames' differences, that an answer must be better by; and so many nats.
STANDARD_ERRORS, NATS = 2.5, 25.0
# Of a few frames, of which nobody knows how much they scatter.
NATS_OF_FEW = 14.0
# The same for the wires of other frames, of which nobody searched the best.
ERRORS_OF_POSES, NATS_OF_POSES, NATS_OF_FEW_POSES = 2.0, 10.0, 4.0
# A wire of fewer dots than such a part of the best met one's is hardly seen, where there are so many frames.
HARDLY, LEAST_SHOWN = 0.25, 4
# Of frames, from which on these tell how much their differences scatter.
ENOUGH_FRAMES = 6
SHUFFLES = (0.5, 0.25, 0.38, 0.62, 0.12)
# Parts of the threshold that are tried.
CLOSER = (1.0, 0.7, 0.5, 0.35, 0.25)


def nats_apart(table: LabelTable, costs: Array, others: Array) -> tuple[float, float]:
    """How much less `costs` (F,) are than `others`, and over how many standard errors, by how the frames scatter.

    Costs are summed by frame, as a pose's error is shared by all dots of one.
    """
    each = (others - costs)[np.diff(table.first) > 0]
    if len(each) < ENOUGH_FRAMES:
        return float(each.sum()), np.inf
    error = float(np.std(each, ddof=1)) * np.sqrt(len(each))
    return float(each.sum()), float(each.sum()) / max(error, 1e-12)


def tells_apart(table: LabelTable, best: Answer, other: Answer) -> bool:
    """Whether the dots say that `other` is wrong."""
    nats, errors = nats_apart(table, best.shifted.costs, other.shifted.costs)
    if not np.isfinite(errors):
        return nats >= NATS_OF_FEW
    return nats >= NATS and errors > STANDARD_ERRORS


def by_chance(table: LabelTable, answer: Answer, threshold_mm: float) -> float:
    """Log of how many answers would be expected to explain dots as well if these lay anywhere: below 0, none.

    At the distance at which that is least, as a right answer's dots lie near their wires; before each frame is shifted
    by what its pose may be off, and after that.

    Source: a-contrario model estimation with an adaptive threshold (Moisan, Moulon and Monasse 2012).
    """
    one, scale = answer.settled, float(np.linalg.norm(answer.settled.matrix[:3, 0]))
    wires, count, sample = table.wires.shape[1], len(table.points), table.sample
    tried = sample * float(np.log(count * wires)) + float(np.log(2 * len(CLOSER)))
    within_mm = threshold_mm * np.array(CLOSER)
    chances = [table.chance(scale, within) for within in within_mm]
    plain = _by_chance(one.distances_mm, within_mm, sample, tried, chances)
    # A frame's shift brings a dot onto a wire that is within reach: one dot fewer tells, and so many shifts are tried.
    hit = np.bincount(table.frame[answer.shifted.labels >= 0], minlength=len(table.wires)) > 0
    pairs = np.diff(table.first)[hit] * chances[0]
    shifted = _by_chance(
        answer.shifted.distances_mm,
        within_mm,
        sample + int(np.count_nonzero(hit)),
        tried + float(np.log1p(pairs).sum()),
        chances,
    )
    return min(plain, shifted)


def _by_chance(distances_mm: Array, within_mm: Array, used: int, tried: float, chances: list[float]) -> float:
    """As `by_chance`, where so many dots were brought onto wires, by the best of so many answers (log)."""
    from scipy.special import bdtrc

    least, count = np.inf, len(distances_mm)
    for within, one in zip(within_mm, chances, strict=True):
        hits = int(np.count_nonzero(distances_mm <= within))  # NaN where there is no wire
        if hits <= used or one >= 1:
            continue
        tail = float(bdtrc(hits - used - 1, count - used, one))
        least = min(least, tried + float(np.log(max(tail, 1e-300))))
    return least


def hardly_seen(table: LabelTable, answer: Answer) -> NDArray[np.int64]:
    """Wires of which far fewer dots are than of the others.

    Dots are lost of all wires alike; of a phantom whose wires are elsewhere a few are met by accident, others never.
    """
    if np.count_nonzero(np.diff(table.first)) < LEAST_SHOWN:
        return np.empty(0, dtype=np.int64)
    labels = answer.settled.labels
    hits = np.bincount(labels[labels >= 0], minlength=table.wires.shape[1])
    return np.flatnonzero(hits < HARDLY * hits.max())


@dataclass(frozen=True)
class AgainstShuffled:
    """What an answer is worth beside those that are left with the wires of other frames; infinite without any.

    Attributes:
        ratio: its score over the best of theirs.
        nats: how much less it costs; the middle one.
        standard_errors: of that, by how the frames scatter.
    """

    ratio: float
    nats: float
    standard_errors: float

    @classmethod
    def of(
        cls, table: LabelTable, answer: Answer, errors: FrameErrors, threshold_mm: float
    ) -> AgainstShuffled:
        """Of rolls by several parts of the frames."""
        frames = len(table.wires)
        shifts = sorted({max(1, round(frames * share)) for share in SHUFFLES} & set(range(1, frames)))
        scores, worth = [1e-9], []
        for by in shifts:
            other = table.shuffled(by)
            left = other.settled(answer.settled.matrix[None], threshold_mm)
            for settled, each in zip(left, errors.shifted(other, left, threshold_mm), strict=True):
                scores.append(settled.score)
                worth.append(nats_apart(table, answer.shifted.costs, each.costs))
        if not worth:
            return cls(np.inf, np.inf, np.inf)
        nats, away = np.median(worth, axis=0)
        return cls(answer.settled.score / max(scores), float(nats), float(away))

    @property
    def tells(self) -> bool:
        """Whether the poses matter, so that the answer is of these frames."""
        if np.isfinite(self.standard_errors):
            return self.nats >= NATS_OF_POSES and self.standard_errors > ERRORS_OF_POSES
        return self.nats >= NATS_OF_FEW_POSES
