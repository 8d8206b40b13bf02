"""Images joined with the poses of trackers that were recorded beside them.

``latency_s > 0``: the tracker's stamps are later than the image's for the same instant; see `sonocal.recording.timing`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sonocal.errors import InputError, require
from sonocal.recording.model import Recording
from sonocal.recording.poses import OnInvalid
from sonocal.recording.timing import MAX_GAP_S, interpolate_poses

__all__ = ["join", "join_several", "with_latency"]


def join(
    images: Recording,
    tracker: Recording,
    latency_s: float = 0.0,
    max_gap_s: float = MAX_GAP_S,
    on_invalid: OnInvalid = "raise",
) -> Recording:
    """Images with the poses of a tracker that was recorded beside them, both stamped in one clock.

    Args:
        images: what to find poses for.
        tracker: the poses.
        latency_s: how much later the tracker stamps an instant than the images do; the recording remembers it.
        max_gap_s: longest stretch between two poses to bridge.
        on_invalid: what to do with poses marked valid that are not rigid.

    Raises:
        InputError: one of the two has no times, they do not overlap, or the poses were moved by a latency before.
    """
    require("images", images, Recording)
    require("tracker", tracker, Recording)
    _check_latency(tracker, latency_s)
    for part in (images, tracker):
        if np.isnan(part.times).any():
            raise InputError(
                f"{part.name}: its items have no times, so poses cannot be joined to images; add stamps"
            )
    at = images.times + latency_s
    if at[0] > tracker.times.max() or at[-1] < tracker.times.min():
        moved = f" after a latency of {latency_s:g} s, which is in seconds" if latency_s else ""
        raise InputError(
            f"{images.name} spans {at.min():.3f} to {at.max():.3f} s and {tracker.name} {tracker.times.min():.3f} to "
            f"{tracker.times.max():.3f} s: they do not overlap{moved}; bring both to one clock"
        )
    poses = {
        name: interpolate_poses(
            one, tracker.times, at, max_gap_s=max_gap_s, source=tracker.name, on_invalid=on_invalid
        )
        for name, one in tracker.poses.items()
    }
    provenance = replace(
        images.provenance,
        format=f"{images.provenance.format} + {tracker.provenance.format}",
        paths=images.provenance.paths + tracker.provenance.paths,
        lengths=tracker.provenance.lengths,
    )
    diagnostics = images.diagnostics + tracker.diagnostics
    return replace(
        images,
        poses=poses,
        provenance=provenance,
        diagnostics=diagnostics,
        latency_s=latency_s or tracker.latency_s,
    )


def join_several(
    images: Recording,
    trackers: Sequence[Recording],
    latency_s: float = 0.0,
    max_gap_s: float = MAX_GAP_S,
    on_invalid: OnInvalid = "raise",
) -> Recording:
    """Images with the poses of several recordings of trackers, each of other tools, beside those of their own.

    The first recording may be a tracker's: the others' poses are then taken at its times.

    Args:
        images: what to find poses for.
        trackers: the poses; see `join`.
        latency_s: how much later the trackers stamp an instant than the images do.
        max_gap_s: longest stretch between two poses to bridge.
        on_invalid: what to do with poses marked valid that are not rigid.

    Raises:
        InputError: as of `join`, or two recordings hold the same tool.
    """
    whole = with_latency(images, latency_s, max_gap_s, on_invalid) if images.poses else images
    found, holders = dict(whole.poses), dict.fromkeys(whole.poses, images.name)
    for tracker in trackers:
        joined = join(images, tracker, latency_s, max_gap_s, on_invalid)
        if twice := [name for name in joined.poses if name in found]:
            raise InputError(
                f"{tracker.name}: holds {joined.poses[twice[0]].plus_name}, and so does {holders[twice[0]]}; rename "
                "one of the two tools, or leave the file out"
            )
        found |= joined.poses
        holders |= dict.fromkeys(joined.poses, tracker.name)
    sources = [one.provenance for one in (images, *trackers)]
    lengths = {one.provenance.lengths for one in (images, *trackers) if one.poses}
    provenance = replace(
        images.provenance,
        format=" + ".join(dict.fromkeys(source.format for source in sources)),
        paths=tuple(path for source in sources for path in source.paths),
        lengths=lengths.pop() if len(lengths) == 1 else "millimetres",
    )
    diagnostics = tuple(note for one in (images, *trackers) for note in one.diagnostics)
    return replace(joined if trackers else whole, poses=found, provenance=provenance, diagnostics=diagnostics)


def with_latency(
    recording: Recording, latency_s: float, max_gap_s: float = MAX_GAP_S, on_invalid: OnInvalid = "raise"
) -> Recording:
    """The recording with every pose taken where its image belongs: at ``t + latency_s``.

    The recording remembers the latency, and so do calibrations from it.

    Raises:
        InputError: it has no times, or its poses were moved by a latency before.
    """
    require("recording", recording, Recording)
    if latency_s == 0.0:
        return recording
    return join(replace(recording, diagnostics=()), recording, latency_s, max_gap_s, on_invalid)


def _check_latency(recording: Recording, latency_s: float) -> None:
    """Refuse a latency that is no number, and a second one."""
    number = isinstance(latency_s, (int, float, np.number)) and not isinstance(latency_s, bool)
    if not (number and np.isfinite(latency_s)):
        raise InputError(f"{recording.name}: latency_s must be a number of seconds; got {latency_s!r}")
    if latency_s != 0.0 and recording.latency_s != 0.0:
        raise InputError(
            f"{recording.name}: its poses were moved by a latency of {recording.latency_s:g} s before, and now "
            f"{latency_s:g} s are given; give it once, to the recording as it was read"
        )
