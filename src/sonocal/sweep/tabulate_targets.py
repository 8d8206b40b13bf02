"""The table of what may be points, lines and planes in a recording's images."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from sonocal.detection import Detections
from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.recording import Recording
from sonocal.sweep.mixed import spanning_mm
from sonocal.sweep.tabulate import Posing, check_places
from sonocal.targets import Plane, Target

__all__ = ["tabulate_candidates"]


def tabulate_candidates(
    recording: Recording, targets: Sequence[Target], detections: Sequence[Detections], posing: Posing
) -> Observations:
    """The table of candidates: each point against every point and line, each wall against every plane.

    Args:
        recording: where images and poses come from; any latency is in its poses already.
        targets: points, lines and planes.
        detections: of one kind each.
        posing: which tool the probe's marker is, and what connects the targets to it.

    Returns:
        The table; a candidate's number within its image is its `split`. Those in frames without a valid pose are left
        out.

    Raises:
        InputError: nothing is left.
    """
    spanning = spanning_mm(recording, targets, posing)
    parts = [_trials(one, _of_kind(recording, targets, one), spanning) for one in detections if len(one)]
    for one in detections:
        check_places(recording, one)
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    if not parts or not len(columns[0]):
        raise InputError(
            f"{recording.name}: none of what was found is in a frame with valid poses; see sonocal info for what is "
            "wrong"
        )
    points, span, frame, which, rank = columns
    order = np.argsort(frame, kind="stable")
    return Observations.of_targets(
        points[order],
        span[order],
        frame=frame[order],
        target=np.array([target.name for target in targets])[which[order]],
        split=rank[order].astype(np.str_),
        image_size_px=None if recording.image is None else recording.image.size_px,
        source=detections[0].source,
    )


def _of_kind(recording: Recording, targets: Sequence[Target], detections: Detections) -> list[int]:
    """Which targets detections may be of: by how many points each has."""
    assert recording.image is not None
    planes = detections.points_each == recording.image.dimension
    return [i for i, one in enumerate(targets) if isinstance(one, Plane) == planes]


def _trials(detections: Detections, which: list[int], spanning: Array) -> tuple[Any, ...]:
    """A row a point of every detection against every target of its kind that has a pose in its frame."""
    each, count = detections.points_each, len(which)
    row, target = np.repeat(np.arange(len(detections)), count), np.tile(which, len(detections))
    span = spanning[detections.frame[row], target]
    posed = np.isfinite(span[:, 0]).all(axis=1)
    row, target, span = row[posed], target[posed], span[posed]
    return (
        detections.points_px[row].reshape(-1, detections.dimension),
        np.repeat(span, each, axis=0),
        np.repeat(detections.frame[row], each),
        np.repeat(target, each),
        np.repeat(detections.rank[row], each),
    )
