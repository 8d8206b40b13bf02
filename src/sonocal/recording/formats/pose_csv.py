"""Poses in a table, one row an instant: a tracker's own export.

A time column (``Timestamp``, ``time_s``, ``time_ms``, dates, ...) and for every tool one of

    ProbeToTrackerTransform                   16 numbers in one cell, as PLUS writes them
    Probe_m00 ... Probe_m33                   a 4 x 4 matrix (the last row may be left out)
    Probe_qw,qx,qy,qz and Probe_x,y,z         a quaternion and a place; the names tell which is which
    Probe_ZYX_rx_deg, ... and Probe_x,y,z     three angles, whose order the names state, or the option ``angles``

with the place in mm, or in ``Probe_x_m`` ... metres. A blank pose is an invalid one, and so is one whose
``ProbeToTrackerTransformStatus``, ``Probe_status`` or ``Probe_valid`` does not say that it holds. The target frame is
``Tracker`` where the names do not say, and the tool the file's stem, or what a column ``tool`` says row by row. Logs of
known trackers have modules of their own.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.files import read_text
from sonocal.files.kinds import TABLE_SUFFIXES, Format, Head
from sonocal.files.tables import (
    Table,
    parse_table,
)
from sonocal.geometry import Array
from sonocal.recording.formats.ndi import is_ndi
from sonocal.recording.formats.parts.angles import ANGLES, quaternions_from_angles, refuse_degrees
from sonocal.recording.formats.parts.pose_columns import (
    MM_PER_UNIT,
    Part,
    PoseColumn,
    in_mm,
    pose_column,
    tools_in,
)
from sonocal.recording.formats.parts.pose_csv_write import write_pose_csv
from sonocal.recording.formats.parts.pose_status import status_columns, with_status
from sonocal.recording.formats.parts.sequence_fields import TRANSFORM, sixteen_each
from sonocal.recording.formats.parts.stamps import times_of
from sonocal.recording.formats.parts.tool_rows import joined_in_time, rows_by_tool
from sonocal.recording.model import Provenance, Recording
from sonocal.recording.poses import Poses, by_name, poses_from_quaternions

__all__ = ["FORMAT", "example_header", "is_pose_column", "read_pose_csv"]

MATRIX = tuple(f"m{i}{j}" for i in range(4) for j in range(4))
READ_AS = {"m": "metres", "cm": "centimetres", "um": "micrometres", "in": "inches"}
Columns = Mapping[tuple[Part, str], PoseColumn]


def example_header(count: int) -> str:
    """A header for so many columns of one tool: of a matrix where that many are one, else of place and quaternion."""
    names = MATRIX[: count - 1] if count in (13, 17) else ("x", "y", "z", "qx", "qy", "qz", "qw")
    return ",".join(["time_s", *(f"Probe_{name}" for name in names)])


def read_pose_csv(path: Path, angles: str | None = None) -> Recording:
    """Read a table of poses: a recording of a tracker alone.

    Args:
        path: the file.
        angles: what three angles mean where the columns' names do not say: an order such as "ZYX", or "vector".

    Raises:
        FormatError: the file is not CSV, or no table of poses.
        InputError: a cell is wrong; the sentence names file, line and column.
    """
    table = parse_table(path.name, read_text(path, "a table of poses"))
    table.need_rows("write one row an instant")
    tools = tools_in(table.header)
    # Rows are of tools by name only where no column is of one.
    parts = rows_by_tool(table) if [*tools] == [""] else {}
    parts = parts or {path.stem: table}
    found = [(one, part) for stem, part in parts.items() for one in _tools(part, tools, stem, angles)]
    if not found:
        raise _without_poses(table)
    if len(parts) > 1:
        stamps = [times_of(part)[0] for _, part in found]
        poses, times = joined_in_time(path.name, [one for one, _ in found], stamps)
    else:
        poses, times = [one for one, _ in found], times_of(table)[0]
    units = {
        column.unit for columns in tools.values() for column in columns.values() if column.part == "place"
    }
    read_as = READ_AS.get(units.pop() if len(units) == 1 else "", "millimetres")
    return Recording(
        times=times,
        poses=by_name(poses, path.name),
        provenance=Provenance(path.name, "CSV of poses", (str(path),), read_as),
        diagnostics=times_of(table)[1],
    )


def _tools(table: Table, tools: Mapping[str, Columns], stem: str, angles: str | None) -> Iterator[Poses]:
    statuses = status_columns(table.header)
    for column in table.header:
        if match := TRANSFORM.fullmatch(column):
            cells = _from_cells(table, column, match[1], match[2])
            yield with_status(table, statuses, cells, column)
    for tool, columns in tools.items():
        poses = _tool(table, columns, _names(tool or stem), angles)
        if poses is not None:
            yield with_status(table, statuses, poses, tool, alone=len(tools) == 1)


def _tool(table: Table, columns: Columns, names: tuple[str, str], angles: str | None) -> Poses | None:
    """The poses of one tool; None where its columns turn nothing."""
    parts = {part for part, _ in columns}
    if "quaternion" in parts:
        numbers = _numbers(table, columns, "quaternion", "wxyz")
    elif "angle" in parts:
        numbers = _quaternions(table, columns, angles)
    else:
        return _from_matrix(table, columns, *names) if "matrix" in parts else None
    return poses_from_quaternions(numbers, _places(table, columns), *names, table.name)


def _without_poses(table: Table) -> FormatError:
    """That no column turns anything, and what to call those that do."""
    for column in table.header:
        if found := re.search(r"roll|pitch|yaw", column, re.IGNORECASE):
            return FormatError(
                f"{table.name}, line 1, column {column[:40]}: {found[0].lower()} is about another axis with every "
                "maker; name the angles by the axes that they turn about, such as Probe_ZYX_rx_deg"
            )
    return FormatError(
        f"{table.name}: has no columns of poses; name them ProbeToTrackerTransform, Probe_m00 to Probe_m33, "
        "or Probe_qw, Probe_qx, Probe_qy, Probe_qz, Probe_x, Probe_y, Probe_z"
    )


def _from_cells(table: Table, column: str, source: str, target: str) -> Poses:
    if (numbers := sixteen_each(table.columns[column])) is not None:
        return Poses.of(source, target, numbers.reshape(-1, 4, 4))
    matrices = np.full((len(table.lines), 4, 4), np.nan)
    for row, cell in enumerate(table.columns[column]):
        if not cell.strip():
            continue
        try:
            matrices[row] = np.array([float(word) for word in _words(cell)]).reshape(4, 4)
        except ValueError:
            raise InputError(
                f"{table.name}, line {table.lines[row]}, column {column}: {cell.strip()[:40]!r} is not 16 numbers"
            ) from None
    return Poses.of(source, target, matrices)


def _words(cell: str) -> list[str]:
    """The numbers in a cell; a comma between digits is a decimal one where blanks separate all of them."""
    words = [word.strip(",;") for word in cell.split()]
    if len(words) == 16 and "." not in cell:
        return [word.replace(",", ".") for word in words]
    return re.sub(r"[\s;,\[\]()]+", " ", cell).split()


def _from_matrix(table: Table, columns: Columns, source: str, target: str) -> Poses:
    wanted = [name[1:] for name in (MATRIX if ("matrix", "30") in columns else MATRIX[:12])]
    numbers = _numbers(table, columns, "matrix", wanted)
    matrices = np.full((len(table.lines), 16), np.nan)
    matrices[:, : len(wanted)] = numbers
    if len(wanted) == 12:
        matrices[:, 12:] = np.where(
            np.isfinite(numbers).all(axis=1, keepdims=True), [0.0, 0.0, 0.0, 1.0], np.nan
        )
    return Poses.of(source, target, matrices.reshape(-1, 4, 4))


def _quaternions(table: Table, columns: Columns, angles: str | None) -> Array:
    numbers = _numbers(table, columns, "angle", "xyz")
    first = columns["angle", "x"]
    meaning = first.angles or angles
    if angles and angles != meaning:
        raise InputError(
            f"{table.name}, line 1, column {first.name}: says that its angles are {meaning}, and {angles} was given; "
            "leave angles out, or rename the columns"
        )
    if not meaning or not first.unit:
        what = "order" if not meaning else "unit"
        example = f"{first.tool or 'Probe'}_{meaning or 'ZYX'}_rx_deg"
        option = f", or with --angles: {ANGLES}" if not meaning else ", or _rad"
        raise InputError(
            f"{table.name}, line 1, column {first.name}: is an angle about one of three axes whose {what} is not "
            f"stated; say it in the columns' names, such as {example}{option}"
        )
    if len(units := {columns["angle", axis].unit for axis in "xyz"}) > 1:
        raise InputError(f"{table.name}, line 1: its angles are in {' and '.join(sorted(units))}; write one")
    if first.unit == "rad":
        say = (
            f"call it {first.name.removesuffix('rad')}deg"
            if first.name.endswith("rad")
            else "say deg in the names"
        )
        refuse_degrees(numbers, f"{table.name}, line 1, column {first.name}", say)
    return quaternions_from_angles(np.deg2rad(numbers) if first.unit == "deg" else numbers, meaning)


def _places(table: Table, columns: Columns) -> Array:
    if all(part != "place" for part, _ in columns):
        beside = next(iter(columns.values()))
        raise InputError(
            f"{table.name}, line 1: lacks the column {_place_beside(beside)} beside {beside.name}"
        )
    numbers = _numbers(table, columns, "place", "xyz")
    return in_mm(numbers, [MM_PER_UNIT[columns["place", axis].unit] for axis in "xyz"])


def _place_beside(column: PoseColumn) -> str:
    return f"{column.tool}_x" if column.tool else "x"


def _numbers(table: Table, columns: Columns, part: Part, axes: Iterable[str]) -> Array:
    axes = tuple(axes)
    first = next(column for (of, _), column in columns.items() if of == part)
    if missing := [axis for axis in axes if (part, axis) not in columns]:
        raise InputError(
            f"{table.name}, line 1: lacks the column {first.beside(missing[0])} beside {first.name}"
        )
    return np.column_stack([table.numbers(columns[part, axis].name, blank=np.nan) for axis in axes])


def _names(tool: str) -> tuple[str, str]:
    match = re.fullmatch(r"(.+?)To([A-Z0-9_].*)", tool)
    return (match[1], match[2]) if match else (tool, "Tracker")


def is_pose_column(name: str) -> bool:
    """Whether a column makes a table one of poses: the first of a quaternion, of a matrix or of three angles."""
    found = pose_column(name)
    starts = ("quaternion", "w"), ("matrix", "00"), ("angle", "x")
    return bool(TRANSFORM.fullmatch(name)) or (found is not None and (found.part, found.axis) in starts)


def _sniff(head: Head) -> bool:
    return not is_ndi(head) and any(map(is_pose_column, head.columns))


FORMAT = Format(
    name="CSV of poses",
    kind="recording",
    suffixes=TABLE_SUFFIXES,
    header="columns such as Probe_qw or ProbeToTrackerTransform",
    sniff=_sniff,
    read=read_pose_csv,
    options=("angles",),
    holds="a 4 x 4 matrix in one cell or in columns; quaternion or angles of a stated order, and place",
    write=write_pose_csv,
    writes=(".csv",),
)
