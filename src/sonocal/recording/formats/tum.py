"""Trajectories of the TUM benchmarks, as evo and most odometry writes them: a line a pose, and nothing but numbers.

    timestamp tx ty tz qx qy qz qw

Seconds, metres, blanks between numbers, lines of ``#`` are comments. The tool is called as the file is.
Source: the file formats of the TUM RGB-D benchmark.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.files import read_text
from sonocal.files.kinds import Format, Head
from sonocal.files.separators import DECIMAL_COMMA
from sonocal.files.tables import is_number
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.recording.formats.parts.pose_columns import in_mm
from sonocal.recording.formats.parts.stamps import PER_SECOND, UNIT_NAMES, unit_by_size
from sonocal.recording.model import Provenance, Recording
from sonocal.recording.poses import by_name, poses_from_quaternions

__all__ = ["FORMAT", "read_tum"]

NUMBERS = 8
MM = 1000.0


def read_tum(path: Path) -> Recording:
    """Read a trajectory: one tool, in metres.

    Raises:
        FormatError: a line is not eight numbers.
        InputError: it holds no pose, or a time is not finite.
    """
    table = _table(path.name, read_text(path, "a trajectory"))
    if not len(table):
        raise InputError(f"{path.name}: holds no poses; record it again")
    if not np.isfinite(table[:, 0]).all():
        raise InputError(f"{path.name}: a time is not finite; write seconds")
    quaternions = np.roll(table[:, 4:], 1, axis=1)
    poses = poses_from_quaternions(quaternions, in_mm(table[:, 1:4], MM), path.stem, "Tracker", path.name)
    unit, why = unit_by_size(table[:, 0])
    return Recording(
        times=table[:, 0] / PER_SECOND[unit],
        poses=by_name([poses], path.name),
        provenance=Provenance(path.name, "TUM trajectory", (str(path),), "metres"),
        diagnostics=() if unit == "s" else (_note(unit, why),),
    )


def _note(unit: str, why: str) -> Diagnostic:
    return Diagnostic(
        code="time-unit",
        severity="info",
        message=f"times: they were read as {UNIT_NAMES[unit]}, {why}, where a TUM trajectory has seconds",
        advice="if that is not so, write seconds",
    )


def _table(name: str, text: str) -> Array:
    """(N, 8): the numbers of lines that are no comments."""
    numbers: list[float] = []
    for line, content in enumerate(text.splitlines(), 1):
        words = _words(content)
        if not words or words[0].startswith("#"):
            continue
        if len(words) == NUMBERS and all(map(is_number, words)):
            numbers.extend(map(float, words))
        else:
            raise FormatError(
                f"{name}, line {line}: is not eight numbers; a TUM trajectory has 'timestamp tx ty tz qx qy qz qw'"
            )
    return np.array(numbers, dtype=float).reshape(-1, NUMBERS)


def _words(line: str) -> list[str]:
    """The numbers of a line, with points for decimal commas."""
    return (line if "." in line else DECIMAL_COMMA.sub(".", line)).split()


def _sniff(head: Head) -> bool:
    # Commas make a table, whose header is missed; and the head may end within its first line.
    words = _words(head.header_line)
    return b"\0" not in head.text and len(words) == NUMBERS and all(map(is_number, words))


FORMAT = Format(
    name="TUM trajectory",
    kind="recording",
    suffixes=(".txt", ".tum"),
    header="eight numbers between blanks",
    sniff=_sniff,
    read=read_tum,
    holds="one tool, called as the file; metres",
)
