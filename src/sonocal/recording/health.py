"""What is wrong with a recording, before it is used: each finding with numbers and a remedy."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import require
from sonocal.findings import Diagnostic
from sonocal.geometry.shown import brief
from sonocal.recording.health_of_stamps import stamp_findings
from sonocal.recording.lengths import unit_findings
from sonocal.recording.model import ImageGeometry, Recording
from sonocal.recording.poses import (
    FROZEN_RUN,
    RIGID_TOLERANCE,
    Poses,
    determinant,
    is_transposed,
    longest_run,
    rigidity_error,
    travel_mm,
)

__all__ = ["Summary", "ToolSummary", "health", "summarize"]

Progress = Callable[[int, int], None]

# A tool that moves less than this is at rest: trackers jitter by a few tenths.
STATIC_MM, STATIC_RAD = 0.5, 0.005
MANY_INVALID = 0.1
# What no tool moves between two poses.
LEAP_MM = 30.0


@dataclass(frozen=True)
class ToolSummary:
    """One tracked tool.

    Attributes:
        name: such as "ProbeToTracker".
        poses, valid: how many there are, and how many of them hold.
        longest_loss: invalid poses in a row, at most.
        travel_mm: how far it moved from its median place.
    """

    name: str
    poses: int
    valid: int
    longest_loss: int
    travel_mm: float

    __repr__ = brief


@dataclass(frozen=True)
class Summary:
    """A recording in a few numbers, for people and programs.

    Attributes:
        name, format: of the file.
        items: on the time line.
        duration_s, rate_hz: None without times.
        image: what the images are; None without images.
        tools: what is tracked.
        diagnostics: what to know before use.
    """

    name: str
    format: str
    items: int
    duration_s: float | None
    rate_hz: float | None
    image: ImageGeometry | None
    tools: tuple[ToolSummary, ...]
    diagnostics: tuple[Diagnostic, ...]

    __repr__ = brief


def summarize(recording: Recording, look_at_images: bool = True, progress: Progress | None = None) -> Summary:
    """What is in a recording, and what is wrong with it: see `health`."""
    require("recording", recording, Recording)
    times = recording.times
    timed = len(times) > 1 and bool(np.isfinite(times).all())
    duration = float(times.max() - times.min()) if timed else None
    return Summary(
        name=recording.name,
        format=recording.provenance.format,
        items=len(recording),
        duration_s=duration,
        rate_hz=(len(times) - 1) / duration if duration else None,
        image=recording.image,
        tools=tuple(_tool(poses) for poses in recording.poses.values()),
        diagnostics=health(recording, look_at_images, progress),
    )


def health(
    recording: Recording, look_at_images: bool = True, progress: Progress | None = None
) -> tuple[Diagnostic, ...]:
    """What to know about a recording before using it.

    Args:
        recording: what to look at.
        look_at_images: decode every image to find repeated ones.
        progress: called with how many images are done and how many there are.

    Returns:
        What the reader noticed, then stamps, poses tool by tool, and images.
    """
    found = [*recording.diagnostics, *stamp_findings(recording.times)]
    for poses in recording.poses.values():
        found += _poses(poses, recording)
    found += unit_findings(recording)
    if recording.image is not None:
        found += _image_status(recording)
        if look_at_images:
            found += _repeated_images(recording, progress)
    return tuple(found)


def _poses(poses: Poses, recording: Recording) -> Iterator[Diagnostic]:
    name, n = poses.plus_name, len(poses)
    invalid = n - int(poses.valid.sum())
    if invalid:
        runs, moved = longest_run(~poses.valid), int(np.sum(~poses.valid & moved_out(recording)))
        because = (
            f", {moved} of them since the latency takes their images out of the recording" if moved else ""
        )
        advice = (
            "keep the marker in the tracker's view"
            if moved < invalid
            else "the latency is in seconds: check it"
        )
        yield Diagnostic(
            code="invalid-poses",
            severity="warning" if invalid > MANY_INVALID * n else "info",
            message=f"{name}: {invalid} of {n} poses are invalid ({100 * invalid / n:.0f} %), {runs} in a row at "
            f"most{because}",
            advice=f"such frames are left out; {advice}",
        )
    error = rigidity_error(poses.matrices)
    bent = poses.valid & ~(error <= RIGID_TOLERANCE)
    if bent.any() and "Image" not in (poses.source, poses.target):
        i = int(np.flatnonzero(bent)[0])
        if is_transposed(poses.matrices[i]):
            yield _warning(
                "non-rigid-poses",
                f"{name}: {bent.sum()} poses are transposed, first at frame {i}: their places stand in the last row",
                "write matrices row by row, with the place in the last column",
            )
            return
        yield _warning(
            "non-rigid-poses",
            f"{name}: {bent.sum()} poses marked valid are not rigid, first at frame {i} "
            f"(det R = {determinant(poses.matrices[i]):.3g})",
            "leave such frames out with --on-invalid skip; find what wrote scale or shear into a pose",
        )
    yield from _identities(name, poses)
    yield from _stillness(name, poses)


def moved_out(recording: Recording) -> NDArray[np.bool_]:
    """(N,): images whose poses a latency takes from before or after the recording, where there are none."""
    at = recording.times + recording.latency_s
    return np.asarray((at < recording.times.min()) | (at > recording.times.max()))


def _identities(name: str, poses: Poses) -> Iterator[Diagnostic]:
    """Poses that turn and move nothing, from which the tool leaps away: no measurement is that to the last digit."""
    blank = poses.valid & (poses.matrices == np.eye(4)).all(axis=(1, 2))
    others = np.flatnonzero(poses.valid & ~blank)
    if not blank.any() or not len(others):
        return
    frames = np.flatnonzero(blank)
    after = np.searchsorted(others, frames)
    beside = np.stack([others[np.maximum(after - 1, 0)], others[np.minimum(after, len(others) - 1)]])
    leaps = np.linalg.norm(poses.matrices[beside][..., :3, 3], axis=2).min(axis=0)
    if (leaps > LEAP_MM).any():
        yield _warning(
            "identity-poses",
            f"{name}: {len(frames)} poses marked valid are the identity, first at frame {frames[0]}, and the poses "
            f"beside them are up to {leaps.max():.0f} mm away",
            "many programs write that where a tool is not seen: mark such poses invalid, or leave them out",
        )


def _stillness(name: str, poses: Poses) -> Iterator[Diagnostic]:
    seen = poses.matrices[poses.valid]
    if len(seen) < 2:
        return
    same = (seen[1:] == seen[:-1]).all(axis=(1, 2))
    travel, turn = travel_mm(seen), np.abs(seen[:, :3, :3] - seen[0, :3, :3]).max()
    if travel < STATIC_MM and turn < STATIC_RAD:
        yield Diagnostic(
            code="static-tool",
            severity="info",
            message=f"{name}: does not move, {travel:.3f} mm over {len(seen)} poses",
            advice="expected of a reference marker; a probe or needle must move to be calibrated",
        )
    elif (run := longest_run(same)) >= FROZEN_RUN:
        yield _warning(
            "frozen-poses",
            f"{name}: repeats a pose to the last digit up to {run + 1} times in a row",
            "the tracker or recorder stalled there; leave that stretch out",
        )


def _image_status(recording: Recording) -> Iterator[Diagnostic]:
    bad = len(recording) - int(recording.image_valid.sum())
    if bad:
        yield _warning(
            "invalid-images",
            f"{bad} of {len(recording)} images are marked invalid",
            "such frames are left out",
        )


def _repeated_images(recording: Recording, progress: Progress | None) -> Iterator[Diagnostic]:
    digests = []
    for frame in recording.frames:
        digests.append(hashlib.blake2b(np.ascontiguousarray(frame).data, digest_size=16).digest())
        if progress is not None:
            progress(len(digests), len(recording.frames))
    repeats = np.array([a == b for a, b in pairwise(digests)], dtype=bool)
    if repeats.any():
        run, first = longest_run(repeats), int(np.flatnonzero(repeats)[0]) + 1
        yield _warning(
            "frozen-images" if run >= FROZEN_RUN else "duplicated-images",
            f"{repeats.sum()} of {len(digests)} images repeat the one before them, first at frame {first}, up to "
            f"{run} in a row",
            "the scanner was frozen or the grabber faster than it; such pairs hold one measurement, not two",
        )


def _tool(poses: Poses) -> ToolSummary:
    return ToolSummary(
        name=poses.plus_name,
        poses=len(poses),
        valid=int(poses.valid.sum()),
        longest_loss=longest_run(~poses.valid),
        travel_mm=travel_mm(poses.matrices[poses.valid]),
    )


def _warning(code: str, message: str, advice: str) -> Diagnostic:
    return Diagnostic(code=code, severity="warning", message=message, advice=advice)
