"""Points found by other means of which nobody says which wire each is of: geometry names them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sonocal.detection import Detections
from sonocal.errors import InputError, NoConsensusError
from sonocal.findings import Diagnostic
from sonocal.recording import Recording
from sonocal.registration import associate
from sonocal.sweep.labels import ADVICE, label_findings, unsure_in_words
from sonocal.sweep.options import PointsOptions, telling_threshold_mm
from sonocal.sweep.tabulate import check_places
from sonocal.targets import Line

__all__ = ["named_points"]


def named_points(
    recording: Recording, lines: Sequence[Line], detections: Detections, options: PointsOptions
) -> tuple[Detections, list[Diagnostic]]:
    """Points with the names of their lines, and what is to be said of these; those of no line are left out.

    Points that are named already, or of the only line, are given back as they are.

    Raises:
        InputError: some name a line and others do not, or nothing connects a line to the probe.
        NoConsensusError: points and lines have nothing to do with each other.
    """
    unnamed = detections.target == ""
    if len(lines) < 2 or not unnamed.any():
        return detections, []
    names = [line.name for line in lines]
    if not unnamed.all():
        raise InputError(
            f"{detections.source}: {unnamed.sum()} of {len(unnamed)} points name none of the lines "
            f"{', '.join(names)[:200]}, and others do; name all, or none: then they are told apart by where they lie"
        )
    check_places(recording, detections)
    segments = options.posing.segments_mm(recording, lines)
    posed = np.isfinite(segments[detections.frame]).all(axis=(1, 2, 3))
    frames, code = np.unique(detections.frame[posed], return_inverse=True)
    if len(frames) == 0:
        return detections, []  # which is refused with why
    points = detections.points_px[posed]
    found = associate(
        points if detections.points_each > 1 else points.reshape(-1, detections.dimension),
        segments[frames],
        frame=code,
        threshold_mm=telling_threshold_mm(lines),
        seed=options.seed,
    )
    told = found.labels >= 0
    if found.verdict == "nothing fits" or not told.any():
        fit = f"no labels of the {len(lines)} lines fit: {found.reason}"
        raise NoConsensusError(
            f"{detections.source}: its points name no line, and "
            f"{fit if found.verdict == 'nothing fits' else unsure_in_words(found)}; name the line of each point in a "
            f"column target, or {ADVICE}",
            best_count=int(np.count_nonzero(told)),
        )
    seen = detections.select(np.flatnonzero(posed)[told])
    named = Detections(  # whose ranks are among those of one line
        seen.frame,
        seen.points_px,
        seen.covariance_px2,
        seen.score,
        target=np.array(names)[found.labels[told]],
        images=detections.images,
        source=detections.source,
        origin=seen.origin,
    )
    return named, list(label_findings(found, names, in_sheet=False))
