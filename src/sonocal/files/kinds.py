"""What kind of file a path names, by what is in it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

from sonocal.files.disk import read_at

__all__ = ["Kind", "kind_of"]

Kind = Literal[
    "calibration", "device set", "known points", "lines", "observations", "points", "recording", "table"
]

HEAD = 4096
POSE_COLUMN = re.compile(r"(.*_)?(qw|m00)|.+To[A-Z0-9_].*Transform|Format Version")


def kind_of(path: Path) -> Kind:
    """The kind of a file that sonocal may read.

    Returns:
        "observations", "points" (found in images) and "known points" (whose place or pose is known) are tables known by
        their columns, "table" is other text. What is none of the
        others is taken for a recording, whose reader says what it is not.

    Raises:
        InputError: the file cannot be opened.
    """
    if path.is_dir():
        return "recording"
    head = read_at(path, 0, HEAD).removeprefix(b"\xef\xbb\xbf").lstrip()
    if head.startswith(b"{"):
        return "calibration"
    if head.startswith(b"<"):
        return "device set"
    if path.suffix.lower() == ".toml" or head.startswith((b"[[line]]", b"[[point]]")):
        return "lines"
    if b"\0" in head or head.startswith(b"NRRD") or re.match(rb"\w+[ \t]*=", head):
        return "recording"
    return _kind_of_table(head.partition(b"\n")[0].decode("utf-8", "replace"))


def _kind_of_table(first_line: str) -> Kind:
    header = [cell.strip().strip('"') for cell in first_line.split(",")]
    if "x0_mm" in header:
        return "observations"
    if "u_px" in header:
        return "known points" if {"x_mm", "probe_00"} & set(header) else "points"
    return "recording" if any(POSE_COLUMN.fullmatch(cell) for cell in header) else "table"
