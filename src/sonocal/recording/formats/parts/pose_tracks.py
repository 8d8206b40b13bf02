"""Poses in the text tracks of a video: PLUS's ``.mkv`` has a track named for every field of its items.

A track ``ProbeToTrackerTransform`` holds 16 numbers at each instant, ``ProbeToTrackerTransformStatus`` an ``OK``.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from sonocal.errors import FormatError
from sonocal.geometry import Array
from sonocal.recording.formats.parts.at_times import at_times
from sonocal.recording.formats.parts.sequence_fields import TRANSFORM, ItemFields, interpret
from sonocal.recording.poses import Poses, by_name

__all__ = ["poses_in_tracks"]

LONGEST_TEXT = 4096
# Names of tracks: Matroska has titles, QuickTime the names of handlers.
NAMES = ("title", "handler_name")

Texts = dict[float, str]


def poses_in_tracks(container: Any, times: Array, name: str) -> dict[str, Poses]:
    """The poses of an open video at the times of its frames, by name.

    Args:
        container: of PyAV.
        times: (N,) s, of the frames.
        name: of the file, for messages.

    Raises:
        FormatError: a text is no pose.
    """
    tracks = {track.index: title for track in container.streams.subtitles if (title := _transform(track))}
    texts: dict[str, Texts] = {title: {} for title in tracks.values()}
    if not tracks:
        return {}
    for packet in container.demux([container.streams[index] for index in tracks]):
        if packet.pts is None or not packet.size:
            continue
        if packet.size > LONGEST_TEXT:
            raise FormatError(f"{name}: a text of {packet.size} bytes in a track of poses is none")
        title = tracks[packet.stream.index]
        text = bytes(packet).decode("utf-8", "replace").strip("\0 \r\n")
        texts[title][packet.pts * float(packet.time_base)] = text
    return by_name(_at(texts, times, name), name)


def _transform(track: Any) -> str | None:
    """The name of a track, where it is one of transforms or of their status."""
    title = next((track.metadata[key] for key in NAMES if key in track.metadata), "")
    return title if TRANSFORM.fullmatch(title.removesuffix("Status")) else None


def _at(texts: dict[str, Texts], times: Array, name: str) -> Iterator[Poses]:
    for title, column in texts.items():
        if title.endswith("Status") or not column:
            continue
        stamps = sorted(column)
        status = texts.get(f"{title}Status", {})
        columns = {title: {i: column[stamp] for i, stamp in enumerate(stamps)}}
        if known := {i: status[stamp] for i, stamp in enumerate(stamps) if stamp in status}:
            columns[f"{title}Status"] = known
        for one in interpret(ItemFields(name, columns), len(stamps)).poses.values():
            yield at_times(one, np.array(stamps), times, name)
