"""Which dot of an image is of which line, with nobody naming one; and the similarity that goes with it."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.registration.association import Association
from sonocal.registration.label_errors import FrameErrors, weighed
from sonocal.registration.label_input import SearchLimits
from sonocal.registration.label_lines import LineTable
from sonocal.registration.label_lines_search import search_lines
from sonocal.registration.label_others import LABELLING
from sonocal.registration.label_rivals import rival_starts
from sonocal.registration.label_table import LabelTable
from sonocal.registration.label_verdict import judged, nothing_fits
from sonocal.registration.options import positive_number, whole_number

__all__ = ["associate"]

FINDS, FINDS_OF_ONE_FRAME = 5, 20


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

    Four dots on four lines give a similarity (four_points), two lines of volumes on two (two_lines); it is right where
    all pairs are, and then the lines cross the images at other dots, too. The search ends when its best answer was
    found five times, twenty of a single frame. Then the answers that it is most easily taken for are tried on purpose:
    the tilt that nearly parallel lines leave open, and the motions that bring the lines onto themselves.

    Args:
        points: (N, 2), px: dots of all frames; some may be of no line. Of volumes (N, 2, 3), px: two points on each of
            the lines that they show, at the ends of what is seen.
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
    volumes = np.ndim(points) == 3
    table: LabelTable = LineTable.of(points, lines, frame) if volumes else LabelTable.of(points, lines, frame)
    if table.wires.shape[1] < 2:
        kind = "line_line" if volumes else "point_line"
        raise InputError(
            f"one line needs no labels: register its {'lines' if volumes else 'points'} with {kind} and register"
        )
    within_mm = (
        table.telling_mm() if threshold_mm == "auto" else positive_number("threshold_mm", threshold_mm)
    )
    most = whole_number("max_hypotheses", max_hypotheses, 1, 1 << 40)
    seconds = positive_number("time_limit_s", time_limit_s)
    finds = FINDS if np.count_nonzero(np.diff(table.first)) > 1 else FINDS_OF_ONE_FRAME
    limits = SearchLimits(finds, most, seconds, whole_number("seed", seed, 0, 2**63 - 1))
    matrices, counts, tried, finished = _searched(table, within_mm, limits)
    named = [(LABELLING, one) for one in table.settled(matrices, within_mm)]
    answers = weighed(table, named, FrameErrors.expected(within_mm), within_mm)
    if not answers:
        return nothing_fits(table, within_mm, tried, table.why_none())
    for name, start in rival_starts(table, answers[0].settled):
        named += [(name, one) for one in table.settled(start[None], within_mm)]
    for _ in range(2):  # of the best, which they may change
        errors = FrameErrors.of(table, answers[0].settled, within_mm)
        answers = weighed(table, named, errors, within_mm)
    return judged(table, answers, errors, within_mm, (int(counts.max()), tried, finished))


def _searched(
    table: LabelTable, within_mm: float, limits: SearchLimits
) -> tuple[Array, NDArray[np.int64], int, bool]:
    """Similarities, the best first, how often each was found, how many were tried, and whether that was the end."""
    if isinstance(table, LineTable):
        return search_lines(table, within_mm, limits)
    matrices, _, counts, tried, finished = _core.search_labels(
        table.points, table.first, table.wires, within_mm, limits.finds, limits.hypotheses, limits.seconds,
        0.0, 0.0, limits.seed,
    )  # fmt: skip
    return matrices, counts, tried, finished
