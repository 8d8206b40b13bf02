"""Poses in a CSV table, one row an instant: a tracker's own export.

A time column (``Timestamp``, ``time_s``, ...) and for every tool one of

    ProbeToTrackerTransform                   16 numbers in one cell, as PLUS writes them
    Probe_m00 ... Probe_m33                   a 4 x 4 matrix (the last row may be left out)
    Probe_qw,qx,qy,qz and Probe_x,y,z         a quaternion and a place; the names tell which is which

with the place in mm, or in ``Probe_x_m`` ... metres. A blank pose is an invalid one, and so is one whose
``ProbeToTrackerTransformStatus`` or ``Probe_status`` is not OK. The target frame is ``Tracker`` where the
names do not say. OptiTrack Motive's export has its own module.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.files import read_text
from sonocal.files.kinds import TABLE_SUFFIXES, Format
from sonocal.files.tables import (
    Table,
    parse_table,
)
from sonocal.geometry import Array
from sonocal.recording.formats.parts.pose_csv_write import write_pose_csv
from sonocal.recording.formats.parts.sequence_fields import TRANSFORM
from sonocal.recording.model import Provenance, Recording
from sonocal.recording.poses import Poses, by_name, poses_from_quaternions

__all__ = ["FORMAT", "TIME_COLUMNS", "read_pose_csv"]

TIME_COLUMNS = ("Timestamp", "timestamp", "time_s", "Time (Seconds)", "time", "t")

QUATERNION = ("qw", "qx", "qy", "qz")
MATRIX = tuple(f"m{i}{j}" for i in range(4) for j in range(4))
NO_TOOL = "Tool"
POSE_COLUMN = re.compile(rf"(.*_)?(qw|m00)|{TRANSFORM.pattern}")


def read_pose_csv(path: Path) -> Recording:
    """Read a table of poses: a recording of a tracker alone.

    Raises:
        FormatError: the file is not CSV, or no table of poses.
        InputError: a cell is wrong; the sentence names file, line and column.
    """
    table = parse_table(path.name, read_text(path, "a table of poses"))
    table.need_rows("write one row an instant")
    poses = by_name(_tools(table), path.name)
    if not poses:
        raise FormatError(
            f"{path.name}: has no columns of poses; name them ProbeToTrackerTransform, Probe_m00 to Probe_m33, "
            "or Probe_qw, Probe_qx, Probe_qy, Probe_qz, Probe_x, Probe_y, Probe_z"
        )
    return Recording(
        times=_times(table), poses=poses, provenance=Provenance(path.name, "CSV of poses", (str(path),))
    )


def _times(table: Table) -> Array:
    column = table.first_of(TIME_COLUMNS)
    if column is None:
        return np.full(len(table.lines), np.nan)
    times = table.numbers(column)
    if not np.isfinite(times).all():
        row = int(np.flatnonzero(~np.isfinite(times))[0])
        raise InputError(
            f"{table.name}, line {table.lines[row]}, column {column}: {times[row]} is not a time"
        )
    return times


def _tools(table: Table) -> Iterator[Poses]:
    for column in table.header:
        if match := TRANSFORM.fullmatch(column):
            yield _from_cells(table, column, match[1], match[2])
        elif column == "m00" or column.endswith("_m00"):
            yield _from_matrix_columns(table, column.removesuffix("m00"))
        elif column == "qw" or column.endswith("_qw"):
            yield _from_quaternion_columns(table, column.removesuffix("qw"))


def _from_cells(table: Table, column: str, source: str, target: str) -> Poses:
    matrices = np.full((len(table.lines), 4, 4), np.nan)
    for row, cell in enumerate(table.columns[column]):
        if not cell.strip():
            continue
        words = re.split(r"[\s;,]+", cell.strip())
        try:
            matrices[row] = np.array([float(word) for word in words]).reshape(4, 4)
        except ValueError:
            raise InputError(
                f"{table.name}, line {table.lines[row]}, column {column}: {cell.strip()[:40]!r} is not 16 numbers"
            ) from None
    return _with_status(table, Poses.of(source, target, matrices), column + "Status")


def _from_matrix_columns(table: Table, prefix: str) -> Poses:
    wanted = MATRIX if f"{prefix}m30" in table.columns else MATRIX[:12]
    columns = _columns(table, prefix, wanted)
    matrices = np.full((len(table.lines), 16), np.nan)
    matrices[:, : len(wanted)] = columns
    if len(wanted) == 12:
        matrices[:, 12:] = np.where(
            np.isfinite(columns).all(axis=1, keepdims=True), [0.0, 0.0, 0.0, 1.0], np.nan
        )
    source, target = _names(prefix)
    return _with_status(table, Poses.of(source, target, matrices.reshape(-1, 4, 4)), f"{prefix}status")


def _from_quaternion_columns(table: Table, prefix: str) -> Poses:
    scale, unit = next(
        ((s, u) for s, u in ((1.0, ""), (1.0, "_mm"), (1000.0, "_m")) if f"{prefix}x{u}" in table.columns),
        (1.0, ""),
    )
    quaternions = _columns(table, prefix, QUATERNION)
    places = _columns(table, prefix, tuple(f"{axis}{unit}" for axis in "xyz")) * scale
    source, target = _names(prefix)
    return _with_status(
        table, poses_from_quaternions(quaternions, places, source, target, table.name), f"{prefix}status"
    )


def _columns(table: Table, prefix: str, names: tuple[str, ...]) -> Array:
    if missing := [prefix + name for name in names if prefix + name not in table.columns]:
        raise InputError(f"{table.name}, line 1: lacks the column {missing[0]} beside {prefix + names[0]}")
    return np.column_stack([table.numbers(prefix + name, blank=np.nan) for name in names])


def _names(prefix: str) -> tuple[str, str]:
    tool = prefix.rstrip("_") or NO_TOOL
    match = re.fullmatch(r"(.+?)To([A-Z0-9_].*)", tool)
    return (match[1], match[2]) if match else (tool, "Tracker")


def _with_status(table: Table, poses: Poses, column: str) -> Poses:
    if column not in table.columns:
        return poses
    status = tuple(map(str, table.text(column)))
    good = np.array([text in ("OK", "ok", "1", "true", "True") for text in status])
    return Poses(poses.source, poses.target, poses.matrices, poses.valid & good, status)


FORMAT = Format(
    name="CSV of poses",
    kind="recording",
    suffixes=TABLE_SUFFIXES,
    header="columns such as Probe_qw, Probe_m00 or ProbeToTrackerTransform",
    sniff=lambda head: any(POSE_COLUMN.fullmatch(column) for column in head.columns),
    read=read_pose_csv,
    holds="a 4 x 4 matrix in one cell or in columns, or quaternion and place",
    write=write_pose_csv,
    writes=(".csv",),
)
