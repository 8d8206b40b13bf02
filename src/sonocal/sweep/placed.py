"""The table of points of a recording against targets, of some of which nobody knows the place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.detection import Detections
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.observations.poses import pose_cells
from sonocal.recording import Recording
from sonocal.sweep.mixed import named_targets, require_posed
from sonocal.sweep.tabulate import Posing, check_places
from sonocal.targets import Target, Unplaced, check_lines

__all__ = ["placed_rows"]


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
