"""A recording of a thread, or of a needle, whose place nobody knows: it is found with the calibration.

The best-ranked candidates give a first calibration and a first place. With that the thread is a line like any other:
candidates are chosen by it, and fainter ones looked for. What was chosen is calibrated once more, its place unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, calibrate, placed_by
from sonocal.detection import Detections
from sonocal.errors import (
    UnsupportedError,
)
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.observations.poses import pose_cells, with_poses
from sonocal.recording import Recording
from sonocal.sweep.mixed import named_targets, require_posed
from sonocal.sweep.options import PointsOptions, of_calibrate
from sonocal.sweep.tabulate import Posing, check_places
from sonocal.targets import Line, Target, Unplaced, check_lines

__all__ = [
    "line_at",
    "placed_rows",
    "require_findable",
    "threshold_of",
    "with_own_places",
]


def require_findable(lines: Sequence[Line | Unplaced]) -> None:
    """Refuse targets that are not looked for in images, or cannot be told apart there.

    Raises:
        UnsupportedError: one is a point or a plane, or there are several lines.
    """
    for one in lines:
        if isinstance(one, Unplaced) and one.kind != "line":
            raise UnsupportedError(
                f"{one.kind} {one.name!r}: its place is unknown, and in images lines alone are looked for; give its "
                "points with --points (in Python: calibrate_points)"
            )
    if len(lines) > 1:
        raise UnsupportedError(
            f"the places of some of {len(lines)} lines are unknown, and in images they cannot be told apart; scan one "
            "at a time, or give their points with --points"
        )


def line_at(line: Line | Unplaced, found: Calibration) -> Line:
    """A line where a calibration found it."""
    if isinstance(line, Line):
        return line
    return Line(line.name, line.frame, np.array(found.targets[line.name].spanning_mm))


def placed_rows(
    recording: Recording, targets: Sequence[Target | Unplaced], detections: Detections, posing: Posing
) -> Observations:
    """Points against targets, of those whose place is asked for with the pose of their frame.

    Raises:
        InputError: a point names no target or no frame, nothing connects a target to the probe, or nothing is left.
    """
    check_lines(recording.name, targets, "targets")
    check_places(recording, detections)
    which = named_targets(targets, detections)
    poses = np.stack(
        [
            recording.between(posing.probe, one.frame, posing.fixed, posing.on_invalid).matrices
            for one in targets
        ]
    )[which, detections.frame]
    posed = np.asarray(np.isfinite(poses).all(axis=(1, 2)))
    if len(recording.frames):
        posed &= recording.image_valid[detections.frame]
    require_posed(recording, detections, posed)
    poses, which, frame = poses[posed], which[posed], detections.frame[posed]
    spanning: Array = np.full((len(which), 3, 3), np.nan)
    for i, one in enumerate(targets):
        if not isinstance(one, Unplaced):
            mine = which == i
            points = one.spanning_mm @ np.swapaxes(poses[mine, :3, :3], 1, 2) + poses[mine, None, :3, 3]
            spanning[mine, : points.shape[1]] = points
            poses[mine] = np.nan
    names = np.array([one.name for one in targets])[which]
    return _table(recording, detections, posed, _Posed(names, frame, spanning, poses))


class _Posed(NamedTuple):
    """Detections that have a pose.

    Attributes:
        names: (M,): of each one's target.
        frame: (M,).
        spanning_mm: (M, 3, 3): of targets whose place is known, in the probe marker's frame; else NaN.
        poses: (M, 4, 4): of the others' frames; else NaN.
    """

    names: NDArray[np.str_]
    frame: NDArray[np.int64]
    spanning_mm: Array
    poses: Array


def _table(
    recording: Recording, detections: Detections, posed: NDArray[np.bool_], rows: _Posed
) -> Observations:
    each = detections.points_each
    rank = detections.rank[posed].astype(np.str_) if each > 1 else np.full(len(rows.names), "")
    extra = pose_cells(np.repeat(rows.poses[:, :3], each, axis=0))
    if np.isfinite(recording.times).all():
        extra["time_s"] = np.repeat(recording.times[rows.frame], each).astype(np.str_)
    return Observations.of_targets(
        detections.points_px[posed].reshape(-1, detections.dimension),
        np.repeat(rows.spanning_mm, each, axis=0),
        frame=np.repeat(rows.frame, each),
        target=np.repeat(rows.names, each),
        split=np.repeat(rank, each),
        extra=extra,
        image_size_px=None if recording.image is None else recording.image.size_px,
        source=detections.source,
    )


def with_own_places(
    chosen: Observations, recording: Recording, lines: Sequence[Line | Unplaced], options: PointsOptions
) -> tuple[Calibration, Observations]:
    """What was chosen, calibrated with places unknown again.

    Args:
        chosen: rows of the lines as they were found first.
        recording: with its poses as they are stamped.
        lines: as they were given.
        options: how to calibrate.

    Returns:
        The calibration, and the rows with their lines where it found them.
    """
    asked = {one.name: one for one in lines if isinstance(one, Unplaced)}
    mine = np.isin(chosen.target, list(asked))
    spanning = np.concatenate([chosen.segments_mm, np.full((len(chosen), 1, 3), np.nan)], axis=1)
    spanning[mine] = np.nan
    poses = np.full((len(chosen), 3, 4), np.nan)
    for name, one in asked.items():
        here = chosen.target == name
        known = recording.between(options.probe, one.frame, options.fixed, options.on_invalid).matrices
        poses[here] = known[chosen.frame[here], :3]
    kept = np.isfinite(spanning[:, 0, 0]) | np.isfinite(poses[:, 0, 0])
    columns = {"spanning_mm": spanning, "segments_mm": spanning[:, :2], "split": np.full(len(chosen), "")}
    rows = with_poses(chosen.with_sound(**columns), poses).select(kept)
    found = calibrate(rows, **of_calibrate(options, targets=tuple(lines), threshold_mm=threshold_of(options)))
    return found, placed_by(found, rows)


def threshold_of(options: PointsOptions) -> float:
    """The distance, mm, within which rows agree; where the noise would tell it, the most."""
    return 5.0 if options.threshold_mm == "auto" else float(options.threshold_mm)
