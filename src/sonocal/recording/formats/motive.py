"""OptiTrack Motive's CSV export: rigid bodies as quaternions, blank cells where one was occluded.

Its world has Y up and its lengths are metres unless it says millimetres. Poses are brought to mm; the
world is kept as it is, for only how tools lie to each other matters here.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from sonocal.errors import FormatError, InputError, UnsupportedError
from sonocal.files import read_text
from sonocal.files.kinds import TABLE_SUFFIXES, Format
from sonocal.files.separators import decimal_points, other_width, separator_of
from sonocal.files.tables import cells_to_numbers, csv_lines
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.recording.formats.parts.pose_columns import in_mm
from sonocal.recording.model import Provenance, Recording
from sonocal.recording.poses import Poses, by_name, poses_from_quaternions

__all__ = ["FORMAT", "read_motive"]

MM_PER_UNIT = {
    "meters": 1000.0,
    "metres": 1000.0,
    "centimeters": 10.0,
    "millimeters": 1.0,
    "millimetres": 1.0,
}
READ_AS = {1000.0: "metres", 10.0: "centimetres", 1.0: "millimetres"}
AXES = {"Rotation": ("X", "Y", "Z", "W"), "Position": ("X", "Y", "Z")}


def read_motive(path: Path) -> Recording:
    """Read Motive's export.

    Raises:
        FormatError: the header rows are not Motive's.
        UnsupportedError: rotations are not quaternions.
        InputError: it holds no rigid body, or a cell is wrong.
    """
    text = read_text(path, "a table of poses")
    separator = separator_of(text)
    found = [*csv_lines(path.name, text, separator)]
    rows, lines = [row for row, _ in found], [line for _, line in found]
    about = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    top = next(
        (i for i, row in enumerate(rows) if [c.strip() for c in row[:2]] == ["Frame", "Time (Seconds)"]), None
    )
    if top is None or top + 1 >= len(rows):
        raise FormatError(
            f"{path.name}: has no row 'Frame,Time (Seconds),...' with data below it; export it again"
        )
    _check_rotation(path.name, about)
    body, body_lines = _body(path.name, found[top + 1 :], len(rows[top]), separator), lines[top + 1 :]
    header = _header_rows(path.name, rows[1:top], rows[top])
    scale = _scale(path.name, about)
    poses = by_name(list(_bodies(path.name, header, body, body_lines, scale)), path.name)
    if not poses:
        raise InputError(
            f"{path.name}: holds no rigid body; export rigid bodies with their rotations as quaternions"
        )
    times = cells_to_numbers(path.name, "Time (Seconds)", [row[1] for row in body], body_lines)
    if not np.isfinite(times).all():
        raise InputError(f"{path.name}: a time is not finite; export it again")
    return Recording(
        times=times,
        poses=poses,
        fields={key: value for key, value in about.items() if key},
        provenance=Provenance(path.name, "OptiTrack Motive CSV", (str(path),), READ_AS[scale]),
        diagnostics=(_about_axes(about, scale),),
    )


def _body(name: str, rows: list[tuple[list[str], int]], width: int, separator: str) -> list[list[str]]:
    """The cells of the rows of numbers, as many as the header has, with decimal points."""
    for row, line in rows:
        if any(map(str.strip, row[width:])):
            raise other_width(f"{name}, line {line}", row, width, separator)
    columns = [[row[i] if i < len(row) else "" for row, _ in rows] for i in range(width)]
    if separator != ",":
        columns = [decimal_points(f"{name}, column {i}", cells) for i, cells in enumerate(columns, 1)]
    return [*map(list, zip(*columns, strict=True))]


def _check_rotation(name: str, about: dict[str, str]) -> None:
    kind = about.get("Rotation Type", "Quaternion")
    if kind != "Quaternion":
        raise UnsupportedError(
            f"{name}: its rotations are {kind[:40]!r}; export them from Motive as Quaternion"
        )


def _scale(name: str, about: dict[str, str]) -> float:
    unit = about.get("Length Units", "Meters")
    if unit.lower() not in MM_PER_UNIT:
        raise InputError(f"{name}: its Length Units are {unit[:40]!r}; export metres or millimetres")
    return MM_PER_UNIT[unit.lower()]


def _header_rows(
    name: str, rows: Sequence[Sequence[str]], axes: Sequence[str]
) -> list[tuple[str, str, str, str]]:
    """(type, name, Rotation or Position, axis) of every column."""
    kinds = next((i for i, row in enumerate(rows) if "Rigid Body" in row or row[1:2] == ["Type"]), None)
    quantities = next((row for row in rows if "Rotation" in row), None)
    if kinds is None or kinds + 1 >= len(rows) or quantities is None:
        raise FormatError(
            f"{name}: lacks the rows of types, names and quantities above the data; export it again"
        )
    # Versions until 1.22 leave the rows' own names out: those of bodies follow their types.
    types, names = rows[kinds], next((row for row in rows if row[1:2] == ["Name"]), rows[kinds + 1])
    columns = []
    for i, axis in enumerate(axes):
        cells = [row[i].strip() if i < len(row) else "" for row in (types, names, quantities)]
        columns.append((cells[0], cells[1], cells[2], axis.strip()))
    return columns


def _bodies(
    name: str, header: list[tuple[str, str, str, str]], body: list[list[str]], lines: list[int], scale: float
) -> Iterator[Poses]:
    tools = dict.fromkeys(
        tool for kind, tool, quantity, _ in header if kind == "Rigid Body" and quantity == "Rotation"
    )
    places = {column: i for i, column in reversed([*enumerate(header)])}
    for tool in tools:
        parts: dict[str, Array] = {}
        for quantity, axes in AXES.items():
            columns = [_column(name, places, tool, quantity, axis) for axis in axes]
            parts[quantity] = np.column_stack(
                [
                    cells_to_numbers(name, f"{tool} {quantity} {axis}", [r[i] for r in body], lines, np.nan)
                    for i, axis in zip(columns, axes, strict=True)
                ]
            )
        quaternions = np.roll(parts["Rotation"], 1, axis=1)
        yield poses_from_quaternions(quaternions, in_mm(parts["Position"], scale), tool, "Tracker", name)


def _column(
    name: str, places: Mapping[tuple[str, str, str, str], int], tool: str, quantity: str, axis: str
) -> int:
    try:
        return places["Rigid Body", tool, quantity, axis]
    except KeyError:
        raise FormatError(
            f"{name}: rigid body {tool!r} lacks its column {quantity} {axis}; export it again"
        ) from None


def _about_axes(about: dict[str, str], scale: float) -> Diagnostic:
    return Diagnostic(
        code="motive-axes",
        severity="info",
        message=(
            f"Motive's world has Y up and is kept; its lengths ({about.get('Length Units', 'Meters')}) were multiplied "
            f"by {scale:g} to mm"
        ),
        advice="calibrations use poses of tools to each other, in which the world cancels",
    )


FORMAT = Format(
    name="OptiTrack Motive CSV",
    kind="recording",
    suffixes=TABLE_SUFFIXES,
    header="Format Version in its first cell",
    sniff=lambda head: head.columns[:1] == ("Format Version",),
    read=read_motive,
    holds="rigid bodies as quaternions; metres, centimetres, millimetres",
)
