"""A recording whose tracker is late by a lag that nobody knows: roughly of candidates, finely of what is chosen."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from sonocal.calibration import point_line_rows
from sonocal.calibration.lagged import lag_of_rows
from sonocal.detection import Detections
from sonocal.errors import InputError, SonocalError
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.observations.velocities import with_velocities
from sonocal.recording import Recording
from sonocal.setup_checks.lag_fit import LagFit
from sonocal.setup_checks.lag_search import rough_lag
from sonocal.setup_checks.moving_lines import moving_in_recording, velocities_in_recording
from sonocal.setup_checks.rows_in_time import RowsInTime
from sonocal.sweep.choice import CandidateCalibration
from sonocal.sweep.options import PointsOptions, telling_threshold_mm
from sonocal.sweep.tabulate import Posing, tabulate, tabulated
from sonocal.targets import Line

__all__ = [
    "lag_of_candidates",
    "lag_of_points",
    "most_used",
    "moving_rows",
    "require_clock",
    "with_line_velocities",
]

# Candidates an image by which the lag is found roughly: the first are the surest, and in speckle too few the needle.
RANKS = (1, 2)
# Of these, those that agree under a lag that is one.
LEAST_SHARE = 0.25
# Of lines that rest, noise and tremor are no motion.
STILL_MM_S = 1.0


def lag_of_candidates(
    recording: Recording,
    lines: Sequence[Line],
    detections: Detections,
    segments_mm: Array,
    options: PointsOptions,
) -> tuple[float, ...]:
    """The lag, s, under which the images' best candidates agree best; where few do, several, none among them.

    Args:
        recording: as it was read.
        lines: the needles and wires.
        detections: candidates.
        segments_mm: (N, L, 2, 3): the lines' ends in every item.
        options: how rows are fitted.
    """
    within_mm = telling_threshold_mm(lines) if options.threshold_mm == "auto" else options.threshold_mm
    unsure = []
    for ranks in RANKS:
        best = detections.select(detections.rank < ranks)
        rows = tabulated(recording, lines, best, segments_mm).observations
        rough = rough_lag(moving_rows(recording, lines, rows, segments_mm), within_mm, options.model)
        if rough is not None and np.mean(rough[1].inlier) >= LEAST_SHARE:
            return (rough[0],)
        unsure += [] if rough is None else [rough[0]]
    return tuple(dict.fromkeys([*unsure, 0.0]))


def most_used(ways: Sequence[Callable[[], CandidateCalibration]]) -> Observations:
    """The rows that were chosen in one of some ways: that in which most images took part.

    Raises:
        SonocalError: each refuses; the first one's refusal.
    """
    refusals: list[SonocalError] = []
    found: list[CandidateCalibration] = []
    for way in ways:
        try:
            found.append(way())
        except SonocalError as error:
            refusals.append(error)
    if not found:
        raise refusals[0]
    return max(found, key=lambda one: one.used).observations


def lag_of_points(
    recording: Recording, lines: Sequence[Line], points: Detections, options: PointsOptions
) -> LagFit:
    """The lag of points that were found in the images by other means.

    Raises:
        InputError: the recording has no times, or its poses were moved before.
        DegenerateGeometryError, NoConsensusError: as `lag_of_rows`.
    """
    require_clock(recording)
    segments = options.posing.segments_mm(recording, lines)
    rows = tabulate(recording, lines, points, options.posing).observations
    return lag_of_rows(moving_rows(recording, lines, rows, segments), options, recording.name)


def require_clock(recording: Recording) -> None:
    """Refuse a recording whose lag cannot be estimated.

    Raises:
        InputError: it has no times, or its poses were moved by a latency before.
    """
    if np.isnan(recording.times).any():
        raise InputError(
            f"{recording.name}: its items have no times, so that no lag can be estimated; add stamps"
        )
    if recording.latency_s:
        raise InputError(
            f"{recording.name}: its poses were moved by a latency of {recording.latency_s:g} s before; estimate the "
            "lag of the recording as it was read"
        )


def with_line_velocities(
    rows: Observations, recording: Recording, lines: Sequence[Line], posing: Posing
) -> Observations:
    """The table of a recording with its lines' velocities, where they move: another program may fit a lag by them.

    Args:
        rows: of the recording: their frames are its items.
        recording: as the rows were made from it.
        lines: the needles and wires.
        posing: how they came into the probe marker's frame.
    """
    if np.isnan(recording.times).any():
        return rows
    velocities = velocities_in_recording(recording.times, posing.segments_mm(recording, lines))
    names = [line.name for line in lines]
    each = velocities[rows.frame, [names.index(str(name)) for name in rows.target]]
    known = np.isfinite(each).all(axis=(1, 2))
    moves = known.any() and np.sqrt(np.mean(each[known] ** 2)) > STILL_MM_S
    return with_velocities(rows, each) if moves else rows


def moving_rows(
    recording: Recording, lines: Sequence[Line], rows: Observations, segments_mm: Array
) -> RowsInTime:
    """The rows, with their needles as the whole recording says where they were."""
    names = [line.name for line in lines]
    track = np.array([names.index(str(name)) for name in rows.target], dtype=np.int64)
    return moving_in_recording(point_line_rows(rows), recording.times, segments_mm, rows.frame, track)
