"""Labels of dots, how sure they are, and other answers that the dots do not exclude."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, Similarity
from sonocal.geometry.shown import brief

__all__ = ["Association", "RivalLabels", "Verdict"]

Verdict = Literal["found", "ambiguous", "unfinished", "nothing fits"]


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
        view: what would tell the two apart, such as "tilt the image by 20 degrees about u"; "" where nothing that was
            tried does.
        view_apart_mm: how far their dots part then.
    """

    name: str
    labels: NDArray[np.int64]
    target_from_source: Similarity
    score: float
    apart_mm: float
    behind_nats: float
    share_of_labels: float
    view: str = ""
    view_apart_mm: float = 0.0

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
