"""A recording in whose images points of points, lines and planes were found: to a calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, calibrate
from sonocal.detection import Detections
from sonocal.errors import InputError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.recording import Recording
from sonocal.sweep.options import PointsOptions, of_calibrate
from sonocal.sweep.tabulate import Posing, check_places, moved, with_origin
from sonocal.targets import Line, Plane, Point, Target, Unplaced, check_lines

__all__ = ["calibrate_targets", "named_targets", "require_posed", "spanning_mm", "tabulate_targets"]


def calibrate_targets(
    recording: Recording, targets: Sequence[Target], detections: Detections, options: PointsOptions
) -> tuple[Calibration, Observations]:
    """Calibrate a probe from a recording and points found in its images of whatever targets.

    Args:
        recording: poses, with any latency undone, and images that need not be decoded.
        targets: points, lines and planes, each in the frame of something tracked.
        detections: the points, each with the name of its target; two or more points of one frame and target are of a
            plane, or in a volume of a line.
        options: how.

    Returns:
        The calibration, and the table of sightings that it was fitted to.

    Raises:
        InputError: a point names no target or no frame, or nothing connects a target to the probe.
        DegenerateGeometryError, NoConsensusError: as `sonocal.calibrate`.
    """
    table, findings = tabulate_targets(recording, targets, detections, options.posing)
    found = calibrate(table, **of_calibrate(options)).with_findings(findings)
    return replace(found, latency_s=recording.latency_s or None), table


def tabulate_targets(
    recording: Recording, targets: Sequence[Target], detections: Detections, posing: Posing
) -> tuple[Observations, list[Diagnostic]]:
    """The table of sightings, with what was left out of it for want of a pose.

    Raises:
        InputError: a point names no target or no frame, nothing connects a target to the probe, or nothing is left.
    """
    for target in targets:
        if not isinstance(target, (Line, Plane, Point)):
            raise InputError(f"targets must be points, lines and planes; got {target!r}"[:200])
    check_lines(recording.name, targets, "targets")
    which = named_targets(targets, detections)
    check_places(recording, detections)
    used = [targets[i] for i in np.unique(which)]
    place = np.searchsorted(np.unique(which), which)
    spanning = spanning_mm(recording, used, posing)[detections.frame, place]
    posed = np.asarray(np.isfinite(spanning[:, 0]).all(axis=1))
    require_posed(recording, detections, posed)
    each = detections.points_each
    table = Observations.of_targets(
        detections.points_px[posed].reshape(-1, detections.dimension),
        np.repeat(spanning[posed], each, axis=0),
        frame=np.repeat(detections.frame[posed], each),
        target=np.repeat(np.array([target.name for target in used])[place[posed]], each),
        sigma_px=None if detections.sigma_px is None else detections.sigma_px[posed].reshape(-1),
        image_size_px=None if recording.image is None else recording.image.size_px,
        source=detections.source,
    )
    table = with_origin(table, detections, np.flatnonzero(posed))
    return table, _without_pose(int(np.sum(~posed)), len(posed))


def named_targets(targets: Sequence[Target | Unplaced], detections: Detections) -> NDArray[np.int64]:
    """(N,): which target each detection is of; one without a name is of the only target.

    Raises:
        InputError: one names no target.
    """
    names = [target.name for target in targets]
    found = (
        np.where(detections.target == "", names[0], detections.target)
        if len(names) == 1
        else detections.target
    )
    unknown = [str(name) for name in np.unique(found) if name not in names]
    if unknown:
        raise InputError(
            f"{detections.source}: target {unknown[0]!r} is none of the targets {', '.join(names)[:200]}; name one"
        )
    return np.array([names.index(str(name)) for name in found], dtype=np.int64)


def require_posed(recording: Recording, detections: Detections, posed: NDArray[np.bool_]) -> None:
    """Refuse points of which none (N,) is in a frame whose poses connect its target to the probe."""
    if not posed.any():
        raise InputError(
            f"{recording.name}: none of the {len(detections)} points of {detections.source} is in a frame with valid "
            "poses; see sonocal info for what is wrong"
        )


def spanning_mm(recording: Recording, targets: Sequence[Target], posing: Posing) -> Array:
    """(F, T, 3, 3): what spans each target, in the probe marker's frame, in every item; NaN without a valid pose."""
    spanning = np.full((len(recording), len(targets), 3, 3), np.nan)
    for i, target in enumerate(targets):
        poses = recording.between(posing.probe, target.frame, posing.fixed, posing.on_invalid).matrices
        points = moved(poses, target.spanning_mm)
        spanning[:, i, : points.shape[1]] = points
    return spanning


def _without_pose(left_out: int, count: int) -> list[Diagnostic]:
    if not left_out:
        return []
    return [
        Diagnostic(
            code="no-pose",
            severity="warning",
            message=f"{left_out} of {count} points have no valid pose and were left out",
            advice="keep the markers in the tracker's view; sonocal info lists the frames' faults",
        )
    ]
