"""From detections to the table of sightings: each against its line, in the probe marker's frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.detection import Detections
from sonocal.errors import InputError, require
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.recording import Recording
from sonocal.recording.health import moved_out
from sonocal.recording.poses import OnInvalid
from sonocal.targets import Line, check_lines

__all__ = [
    "Fixed",
    "Posing",
    "Sightings",
    "check_places",
    "check_posing",
    "moved",
    "tabulate",
    "tabulated",
    "with_origin",
]

Fixed = Mapping[tuple[str, str], ArrayLike] | None


@dataclass(frozen=True, eq=False)
class Posing:
    """How lines come into the probe marker's frame.

    Attributes:
        probe: the tool that the probe's marker is called.
        fixed: constant ``(target, source) -> (4, 4)`` beside the recording's, such as a device set's.
        on_invalid: what to do with poses marked valid that are not rigid: "raise" or "skip".

    Raises:
        InputError: an option means nothing.
    """

    probe: str = "Probe"
    fixed: Fixed = None
    on_invalid: OnInvalid = "raise"

    __repr__ = brief

    def __post_init__(self) -> None:
        check_posing(self.probe, self.fixed, self.on_invalid)

    def segments_mm(self, recording: Recording, lines: Sequence[Line]) -> Array:
        """(N, L, 2, 3): the ends of every line in every item of a recording; NaN without a valid pose.

            segment_probe = probe_from_tracker @ tracker_from_tool @ segment_tool

        Raises:
            InputError: no chain of transforms leads from a line to the probe, or a pose is not rigid.
        """
        if not lines:
            raise InputError(f"{recording.name}: there is no line to look for; give the needle or the wires")
        check_lines(recording.name, lines)
        probe_from = {
            frame: recording.between(self.probe, frame, self.fixed, self.on_invalid).matrices
            for frame in dict.fromkeys(line.frame for line in lines)
        }
        return np.stack([moved(probe_from[line.frame], line.segment_mm) for line in lines], axis=1)


def check_posing(probe: Any, fixed: Any, on_invalid: Any) -> None:
    """Refuse options that mean nothing.

    Raises:
        InputError: one does; the sentence names it and says what arrived.
    """
    if not isinstance(probe, str) or not probe:
        raise InputError(f"probe must be the name of the probe's marker, such as 'Probe'; got {probe!r}")
    if on_invalid not in ("raise", "skip"):
        raise InputError(f"on_invalid must be one of raise, skip; got {on_invalid!r}")
    if fixed is not None and not isinstance(fixed, Mapping):
        raise InputError(f"fixed must map (target, source) to a 4 x 4 matrix; got {type(fixed).__name__}")
    for key, matrix in (fixed or {}).items():
        shape = np.shape(matrix)
        if not (isinstance(key, tuple) and len(key) == 2) or shape != (4, 4):
            raise InputError(
                f"fixed must map (target, source) to a 4 x 4 matrix; got {key!r} to shape {shape}"
            )


@dataclass(frozen=True, eq=False)
class Sightings:
    """The table, and what was left out of it.

    Attributes:
        observations: the points of every detection whose pose is known, against each line that it may be of.
        kept: (N,) of the detections: which of them became rows.
        diagnostics: why others did not.
    """

    observations: Observations
    kept: NDArray[np.bool_]
    diagnostics: tuple[Diagnostic, ...]

    __repr__ = brief


def tabulate(
    recording: Recording, lines: Sequence[Line], detections: Detections, posing: Posing | None = None
) -> Sightings:
    """The table of sightings: every detection against its line in the probe marker's frame.

    A detection that names no line is tried against each. Rows are in the order of detections, or, where some are
    tried against several lines, in that of frames, and in a frame line by line. In volumes the two ends of a line
    are two rows, whose `split` is its rank, which tells candidates of one needle apart.

    Args:
        recording: where the images and poses come from; any latency is in its poses already.
        lines: the needles and wires.
        detections: what was found in the images.
        posing: which tool the probe's marker is, and what connects the lines to it.

    Returns:
        The table; detections in frames without a valid pose or image are left out and reported.

    Raises:
        InputError: a detection names no line or no frame of the recording, no chain of transforms leads from a line
            to the probe, or nothing is left.
    """
    require("recording", recording, Recording)
    return tabulated(recording, lines, detections, (posing or Posing()).segments_mm(recording, lines))


def tabulated(
    recording: Recording, lines: Sequence[Line], detections: Detections, segments_mm: Array
) -> Sightings:
    """As `tabulate`, with the lines' ends (N, L, 2, 3) in every item of the recording."""
    row, line = _trials(lines, detections)
    check_places(recording, detections)
    segments = segments_mm[detections.frame[row], line]
    posed = np.asarray(np.isfinite(segments).all(axis=(1, 2)))
    seen = (
        np.full(len(row), True) if not len(recording.frames) else recording.image_valid[detections.frame[row]]
    )
    sound = posed & seen
    if not sound.any():
        raise InputError(
            f"{recording.name}: none of the {len(detections)} detections of {detections.source} is in a frame with "
            "valid poses and image; see sonocal info for what is wrong"
        )
    names = np.array([one.name for one in lines])
    table = _rows(detections, row[sound], names[line[sound]], segments[sound])
    table = with_origin(_timed(table, recording.times), detections, row[sound])
    if recording.image is not None:
        table = table.with_sound(image_size_px=recording.image.size_px)
    by_lag = moved_out(recording)[detections.frame]
    return Sightings(table, *_left_out(len(detections), row, posed, seen, by_lag))


def _trials(lines: Sequence[Line], detections: Detections) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which detection (M,) is tried against which line (M,)."""
    names = [line.name for line in lines]
    target = (
        np.where(detections.target == "", names[0], detections.target)
        if len(names) == 1
        else detections.target
    )
    unknown = [str(name) for name in np.unique(target) if name not in ("", *names)]
    if unknown:
        raise InputError(
            f"{detections.source}: target {unknown[0]!r} is none of the lines {', '.join(names)[:200]}; name one"
        )
    any_line = np.flatnonzero(target == "")
    named = np.flatnonzero(target != "")
    own = np.array([names.index(str(name)) for name in target[named]], dtype=np.int64)
    row = np.concatenate([np.tile(any_line, len(names)), named])
    line = np.concatenate([np.repeat(np.arange(len(names)), len(any_line)), own])
    order = np.argsort(detections.frame[row] if len(any_line) else row, kind="stable")
    return row[order], line[order]


def _rows(
    detections: Detections, row: NDArray[np.int64], target: NDArray[np.str_], segments: Array
) -> Observations:
    """A row a point: of arrays that were checked when they were made."""
    each, sigma = detections.points_each, detections.sigma_px
    rank = detections.rank[row].astype(np.str_) if each > 1 else np.full(len(row), "")
    return Observations.of_sound(
        points_px=detections.points_px[row].reshape(-1, detections.dimension),
        segments_mm=np.repeat(segments, each, axis=0),
        frame=np.repeat(detections.frame[row], each),
        target=np.repeat(target, each),
        split=np.repeat(rank, each),
        sigma_px=None if sigma is None else sigma[row].reshape(-1),
        source=detections.source,
    )


def _timed(table: Observations, times: Array) -> Observations:
    """The table with when its images were taken, where the recording knows."""
    if not np.all(np.isfinite(times)):
        return table
    return table.with_sound(extra={"time_s": times[table.frame].astype(np.str_)})


def with_origin(table: Observations, detections: Detections, row: NDArray[np.int64]) -> Observations:
    """The table with who placed each of its points, where that is known of the detections (M,) that it is of."""
    if detections.origin is None:
        return table
    by = np.repeat(detections.origin[row], detections.points_each)
    return table.with_sound(extra={**table.extra, "origin": by})


def moved(probe_from_tool: Array, segment_mm: Array) -> Array:
    """(N, K, 3): points (K, 3), such as a segment's ends, carried by poses (N, 4, 4)."""
    rotation, place = probe_from_tool[:, :3, :3], probe_from_tool[:, None, :3, 3]
    return np.asarray(segment_mm @ np.swapaxes(rotation, 1, 2) + place)


def check_places(recording: Recording, detections: Detections) -> None:
    """Refuse detections of other images than the recording's."""
    if recording.image is not None and detections.dimension != recording.image.dimension:
        raise InputError(
            f"{detections.source}: holds points of {detections.dimension} coordinates where {recording.name} has "
            f"{recording.image.dimension}D images; give places in the images of this recording"
        )
    outside = np.flatnonzero((detections.frame < 0) | (detections.frame >= len(recording)))
    if len(outside):
        raise InputError(
            f"{detections.source}, point {outside[0]}: frame {detections.frame[outside[0]]} is not in "
            f"{recording.name}, which has frames 0 to {len(recording) - 1}"
        )


def _left_out(
    count: int,
    row: NDArray[np.int64],
    posed: NDArray[np.bool_],
    seen: NDArray[np.bool_],
    by_lag: NDArray[np.bool_],
) -> tuple[NDArray[np.bool_], tuple[Diagnostic, ...]]:
    """Which detections (count,) became rows, and why others did not: a detection with a pose of some line has one.

    Those that a latency takes beyond the recording's ends are no fault of the tracker.
    """
    some_pose, kept = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    some_pose[row[posed]], kept[row[posed & seen]] = True, True
    reasons = {
        "no-pose": (~some_pose, "have no valid pose", by_lag[~some_pose].all()),
        "no-image": (some_pose & ~kept, "lie in images marked invalid", False),
    }
    return kept, tuple(
        Diagnostic(
            code=code,
            severity="info" if expected else "warning",
            message=f"{rows.sum()} of {count} detections {what} and were left out",
            advice="keep the markers in the tracker's view; sonocal info lists the frames' faults",
        )
        for code, (rows, what, expected) in reasons.items()
        if rows.any()
    )
