"""From a recording to the table of sightings: points found in its images, lines known in a tool's frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.detection import (
    Candidates,
    LineCandidates,
)
from sonocal.errors import InputError, NoConsensusError
from sonocal.findings import Diagnostic
from sonocal.observations import Observations, stacked
from sonocal.recording import (
    Recording,
    with_latency,
)
from sonocal.recording.poses import OnInvalid
from sonocal.sweep.detections import Detections
from sonocal.targets import Line, check_lines

__all__ = [
    "Fixed",
    "Sightings",
    "candidate_observations",
    "expected_observations",
    "line_observations",
    "no_candidates",
    "observations_from_recording",
]


@dataclass(frozen=True, eq=False)
class Sightings:
    """The table, and what was left out of it.

    Attributes:
        observations: one row a detection whose pose is known.
        kept: (N,) of the detections: which of them became rows.
        diagnostics: why others did not.
    """

    observations: Observations
    kept: NDArray[np.bool_]
    diagnostics: tuple[Diagnostic, ...]


def observations_from_recording(
    recording: Recording,
    lines: Sequence[Line],
    detections: Detections,
    *,
    probe: str = "Probe",
    fixed: Mapping[tuple[str, str], ArrayLike] | None = None,
    latency_s: float = 0.0,
    on_invalid: OnInvalid = "raise",
) -> Sightings:
    """The table of sightings: every detected point against its line in the probe marker's frame.

        segment_probe = probe_from_tracker @ tracker_from_tool @ segment_tool

    Args:
        recording: where the images and poses come from.
        lines: the needles and wires.
        detections: what was found in the images.
        probe: the tool that the probe's marker is called.
        fixed: constant ``(target, source) -> (4, 4)``, such as a device set's.
        latency_s: how much later the tracker stamps an instant than the images do.
        on_invalid: what to do with poses marked valid that are not rigid: "raise" or "skip".

    Returns:
        The table; detections in frames without a valid pose or image are left out and reported.

    Raises:
        InputError: a detection names no line or no frame of the recording, no chain of transforms leads
            from a line to the probe, or nothing is left.
    """
    check_lines(recording.name, lines)
    target = _targets(lines, detections)
    _check_frames(recording, detections)
    timed = with_latency(recording, latency_s, on_invalid=on_invalid)
    segments = np.full((len(target), 2, 3), np.nan)
    for line in lines:
        rows = np.flatnonzero(target == line.name)
        probe_from_tool = timed.between(probe, line.frame, fixed, on_invalid).matrices[detections.frame[rows]]
        segments[rows] = (
            line.segment_mm @ np.swapaxes(probe_from_tool[:, :3, :3], 1, 2) + probe_from_tool[:, None, :3, 3]
        )
    posed = np.isfinite(segments).all(axis=(1, 2))
    seen = (
        recording.image_valid[detections.frame] if len(recording.frames) else np.ones(len(target), dtype=bool)
    )
    kept = posed & seen
    if not kept.any():
        raise InputError(
            f"{recording.name}: none of the {len(kept)} detections of {detections.source} is in a frame with valid "
            "poses and image; see sonocal info for what is wrong"
        )
    table = Observations(
        points_px=detections.points_px[kept],
        segments_mm=segments[kept],
        frame=detections.frame[kept],
        target=target[kept],
        sigma_px=None if detections.sigma_px is None else detections.sigma_px[kept],
        source=detections.source,
    )
    return Sightings(table, kept, tuple(_left_out(posed, seen)))


def _targets(lines: Sequence[Line], detections: Detections) -> NDArray[np.str_]:
    names = [line.name for line in lines]
    target = detections.target
    if len(names) == 1:
        target = np.where(target == "", names[0], target)
    unknown = [str(t) for t in np.unique(target) if t not in names]
    if unknown:
        raise InputError(
            f"{detections.source}: target {unknown[0]!r} is none of the lines {', '.join(names)[:200]}; name one"
        )
    return target


def _check_frames(recording: Recording, detections: Detections) -> None:
    outside = np.flatnonzero((detections.frame < 0) | (detections.frame >= len(recording)))
    if len(outside):
        raise InputError(
            f"{detections.source}, point {outside[0]}: frame {detections.frame[outside[0]]} is not in "
            f"{recording.name}, which has frames 0 to {len(recording) - 1}"
        )


def _left_out(posed: NDArray[np.bool_], seen: NDArray[np.bool_]) -> list[Diagnostic]:
    reasons = {
        "no-pose": (~posed, "have no valid pose"),
        "no-image": (posed & ~seen, "lie in images marked invalid"),
    }
    return [
        Diagnostic(
            code=code,
            severity="warning",
            message=f"{rows.sum()} of {len(rows)} detections {what} and were left out",
            advice="keep the markers in the tracker's view; sonocal info lists the frames' faults",
        )
        for code, (rows, what) in reasons.items()
        if rows.any()
    ]


Fixed = Mapping[tuple[str, str], ArrayLike] | None


def candidate_observations(
    recording: Recording,
    lines: Sequence[Line],
    candidates: Candidates,
    *,
    probe: str = "Probe",
    fixed: Fixed = None,
    latency_s: float = 0.0,
    on_invalid: OnInvalid = "raise",
) -> Observations:
    """Every candidate against every line it may be, one row each.

    Raises:
        InputError: there is no candidate, or no pose.
    """
    if len(candidates) == 0:
        raise no_candidates(recording.name, candidates.frames)
    tables = [
        observations_from_recording(
            recording,
            lines,
            Detections(
                candidates.frame,
                candidates.points_px,
                np.full(len(candidates), line.name),
                candidates.sigma_px,
                recording.name,
            ),
            probe=probe,
            fixed=fixed,
            latency_s=latency_s,
            on_invalid=on_invalid,
        ).observations
        for line in lines
    ]
    return tables[0] if len(tables) == 1 else stacked(tables)


def line_observations(
    recording: Recording,
    lines: Sequence[Line],
    candidates: LineCandidates,
    *,
    probe: str = "Probe",
    fixed: Fixed = None,
    latency_s: float = 0.0,
    on_invalid: OnInvalid = "raise",
) -> Observations:
    """Every line found in a volume against every needle it may be: two rows, its ends; `split` is its rank.

    Raises:
        NoConsensusError: no volume holds a line.
        InputError: there is no pose.
    """
    if len(candidates) == 0:
        raise no_candidates(recording.name, candidates.frames)
    frame, rank = np.repeat(candidates.frame, 2), np.repeat(candidates.rank, 2).astype(np.str_)
    points = np.concatenate([line.ends_px for line in candidates.lines])
    sigma = np.concatenate([line.sigma_px for line in candidates.lines])
    tables = []
    for needle in lines:
        sightings = observations_from_recording(
            recording,
            lines,
            Detections(frame, points, np.full(len(frame), needle.name), sigma, recording.name),
            probe=probe,
            fixed=fixed,
            latency_s=latency_s,
            on_invalid=on_invalid,
        )
        tables.append(replace(sightings.observations, split=rank[sightings.kept]))
    return tables[0] if len(tables) == 1 else stacked(tables)


def no_candidates(name: str, images: int) -> NoConsensusError:
    """What to say where detection found nothing at all."""
    return NoConsensusError(
        f"{name}: no candidate was found in {images} images; nothing in them stands out as a needle does: check in "
        "the contact sheet that it is visible",
        best_count=0,
    )


def expected_observations(recording: Recording, lines: Sequence[Line], **how: Any) -> Observations:
    """A row for every image and needle with a pose: where it must be, whatever was found there."""
    assert recording.image is not None
    frame = np.repeat(np.flatnonzero(recording.image_valid), len(lines))
    names = np.tile([line.name for line in lines], len(frame) // len(lines))
    nowhere = np.zeros((len(frame), recording.image.dimension))
    return observations_from_recording(
        recording, lines, Detections(frame, nowhere, names), **how
    ).observations
