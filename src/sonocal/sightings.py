"""From a recording to the table of sightings: points found in its images, lines known in a tool's frame."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError
from sonocal.files import read_text
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.recording import Diagnostic, Line, Recording, with_latency
from sonocal.recording.lines import check_lines
from sonocal.recording.poses import OnInvalid
from sonocal.tables import parse_table

__all__ = ["Detections", "Sightings", "observations_from_recording", "read_detections"]


@dataclass(frozen=True, eq=False)
class Detections:
    """Points found in the images of a recording; all arrays have one entry a point.

    Attributes:
        frame: (N,) index of the image in the recording.
        points_px: (N, 2) or (N, 3), in the MF-oriented image.
        target: (N,) name of the line; "" where there is only one to choose.
        sigma_px: (N,) standard deviations, or None.
        source: the name that messages give it.
    """

    frame: NDArray[np.int64]
    points_px: Array
    target: NDArray[np.str_]
    sigma_px: Array | None = None
    source: str = "detections"


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


def read_detections(path: str | Path) -> Detections:
    """Read points found in images: a CSV with ``frame, u_px, v_px[, w_px][, target][, sigma_px]``.

    Raises:
        InputError: a column is missing or a value is wrong; the sentence names file, line and column.
        FormatError: the file is not CSV.
    """
    path = Path(path)
    table = parse_table(path.name, read_text(path, "a table of points"))
    table.need_rows("write one row a point")
    if missing := [column for column in ("frame", "u_px", "v_px") if column not in table.columns]:
        raise InputError(
            f"{path.name}, line {table.lines[0] - 1}: lacks the column {missing[0]}; "
            "a table of points has frame, u_px, v_px and perhaps w_px, target, sigma_px"
        )
    coordinates = [table.numbers(column) for column in ("u_px", "v_px", "w_px") if column in table.columns]
    frames = table.numbers("frame")
    if not (np.abs(frames) < 2**53).all() or not np.array_equal(frames, np.round(frames)):
        raise InputError(f"{path.name}, column frame: holds a number that is not whole; count images from 0")
    return Detections(
        frame=frames.astype(np.int64),
        points_px=np.column_stack(coordinates),
        target=table.text("target") if "target" in table.columns else np.full(len(frames), ""),
        sigma_px=table.numbers("sigma_px") if "sigma_px" in table.columns else None,
        source=path.name,
    )


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
