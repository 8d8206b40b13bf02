"""Writing tables of poses: a row an instant, a pose a cell, to the last digit."""

from __future__ import annotations

import csv
import io
import math
import re
from pathlib import Path

import numpy as np

from sonocal.errors import InputError
from sonocal.files import write_atomically
from sonocal.recording.formats.parts.item_lines import check_times
from sonocal.recording.formats.parts.sequence_fields import TRANSFORM
from sonocal.recording.formats.parts.written import check_field
from sonocal.recording.model import Recording
from sonocal.recording.poses import Poses

__all__ = ["pose_table", "write_pose_csv"]

# What a column may be called so that it is read as itself: no comment, no blank or quote at its ends.
COLUMN = re.compile(r"[^\s#\"',;\0](.*[^\s\"'\0])?")


def write_pose_csv(recording: Recording, path: str | Path, compress: bool = True) -> None:
    """Write the poses of a recording of a tracker alone: reading them again gives the same times, poses and statuses.

    Args:
        recording: what to write; its other fields have no place in a table.
        path: ``.csv``.
        compress: of no meaning here.

    Raises:
        InputError: it holds images or no poses, or a name could not be read again; nothing is written.
    """
    if recording.image is not None:
        raise InputError(
            f"{recording.name}: holds images, which a table of poses cannot; leave them out, or choose .mha"
        )
    write_atomically(path, pose_table(recording))


def pose_table(recording: Recording) -> bytes:
    """The table of a recording's poses.

    Raises:
        InputError: there are none, or a name or time could not be read again.
    """
    if not recording.poses:
        raise InputError(f"{recording.name}: holds no poses, of which a table of poses is made; choose .mha")
    check_times(recording)
    columns: dict[str, list[str]] = {}
    if np.isfinite(recording.times).any():
        columns["Timestamp"] = list(map(repr, recording.times.tolist()))
    for poses in recording.poses.values():
        _check_name(recording, poses)
        columns[f"{poses.plus_name}Transform"] = [
            _cell(matrix) for matrix in poses.matrices.reshape(-1, 16).tolist()
        ]
        finite = np.isfinite(poses.matrices).all(axis=(1, 2))
        if any(poses.status or ()) or (finite & ~poses.valid).any():
            columns[f"{poses.plus_name}TransformStatus"] = _statuses(poses)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return text.getvalue().encode()


def _cell(matrix: list[float]) -> str:
    """16 numbers; blank of an item without the pose."""
    return "" if all(map(math.isnan, matrix)) else " ".join(map(repr, matrix))


def _statuses(poses: Poses) -> list[str]:
    """As they were said, where that is read as what the recording holds to be valid."""
    finite = np.asarray(np.isfinite(poses.matrices).all(axis=(1, 2)))
    return [
        text if text is not None and (not whole or (text == "OK") == valid) else "OK" if valid else "INVALID"
        for text, valid, whole in zip(poses.status or (None,) * len(poses), poses.valid, finite, strict=True)
    ]


def _check_name(recording: Recording, poses: Poses) -> None:
    match = TRANSFORM.fullmatch(f"{poses.plus_name}Transform")
    if match is None or match.groups() != (poses.source, poses.target):
        raise InputError(
            f"{recording.name}: the transform {poses.plus_name!r} would not be read as {poses.source!r} to "
            f"{poses.target!r} again; frames have names such as Probe, Needle2 and Tracker"
        )
    check_field(recording, poses.plus_name, "".join(filter(None, poses.status or ())), COLUMN)
