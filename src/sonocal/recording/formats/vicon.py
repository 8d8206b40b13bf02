"""Vicon's CSV (Nexus, Tracker): rigid bodies in the section Objects or Segments, else markers in Trajectories.

    Objects                                             or Segments, Trajectories
    100                                                 frames a second
    ,,Probe:Probe,,,,,,                                 a name above the first column of each
    Frame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ                or without RW; of markers X,Y,Z
    ,,,,,,mm,mm,mm                                      units
    1,0,...

Four numbers of a rotation are a quaternion. What three mean depends on the program and its version, so that the user
must say it (the option ``angles``). Markers become rigid bodies: see `sonocal.recording.markers`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.files import read_text
from sonocal.files.kinds import TABLE_SUFFIXES, Format, Head
from sonocal.files.separators import decimal_points, other_width, separator_of
from sonocal.files.tables import cells_to_numbers, csv_lines, is_number
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.recording.formats.parts.angles import ANGLES, quaternions_from_angles, refuse_degrees
from sonocal.recording.formats.parts.pose_columns import in_mm
from sonocal.recording.markers import Markers, bodies_from_markers
from sonocal.recording.model import Provenance, Recording
from sonocal.recording.poses import Poses, by_name, poses_from_quaternions

__all__ = ["FORMAT", "read_vicon"]

BODIES, MARKERS = ("Objects", "Segments"), "Trajectories"
MM_PER_UNIT = {"mm": 1.0, "cm": 10.0, "m": 1000.0}
RAD_PER_UNIT = {"deg": np.pi / 180, "rad": 1.0}
NO_NOTES: list[Diagnostic] = []
# Lines above the numbers: title, rate, names, axes, units.
ABOVE = 5
PLACE, QUATERNION, THREE = ("TX", "TY", "TZ"), ("RW", "RX", "RY", "RZ"), ("RX", "RY", "RZ")


@dataclass(frozen=True)
class _Section:
    """One table of the file.

    Attributes:
        name: of the file.
        rate: frames a second.
        columns: of each name and axis, where it is and its unit.
        rows, lines: of numbers.
        separator: of cells.
    """

    name: str
    rate: float
    columns: dict[tuple[str, str], tuple[int, str]]
    rows: list[list[str]]
    lines: list[int]
    separator: str

    @property
    def names(self) -> tuple[str, ...]:
        """What has columns."""
        return tuple(dict.fromkeys(name for name, _ in self.columns))

    def numbers(self, index: int, column: str) -> Array:
        """A column; blank cells are NaN."""
        cells = [row[index] if index < len(row) else "" for row in self.rows]
        if self.separator != ",":
            cells = decimal_points(f"{self.name}, column {column}", cells)
        return cells_to_numbers(self.name, column, cells, self.lines, np.nan)

    def part(self, name: str, axes: Sequence[str]) -> Array:
        """(N, k): some axes of a name.

        Raises:
            FormatError: it lacks one.
        """
        if missing := [axis for axis in axes if (name, axis) not in self.columns]:
            raise FormatError(f"{self.name}: {name!r} lacks its column {missing[0]}; export it again")
        return np.column_stack([self.numbers(self.columns[name, axis][0], f"{name} {axis}") for axis in axes])

    def places(self, name: str, axes: Sequence[str]) -> Array:
        """(N, 3) mm: the axes of a place.

        Raises:
            InputError: its unit is none of a length.
        """
        numbers = self.part(name, axes)
        unit = self.columns[name, axes[0]][1].lower()
        if unit not in MM_PER_UNIT:
            raise InputError(
                f"{self.name}: the unit of {name} {axes[0]} is {unit[:40]!r}; export mm, cm or m"
            )
        return in_mm(numbers, MM_PER_UNIT[unit])

    def rad_per_unit(self, name: str) -> float:
        """Of the angles of a name.

        Raises:
            InputError: their unit is none of an angle.
        """
        unit = self.columns[name, THREE[0]][1].lower()
        if unit not in RAD_PER_UNIT:
            raise InputError(
                f"{self.name}: the unit of {name} {THREE[0]} is {unit[:40]!r}, and its angles may be degrees or "
                "radians; export deg or rad"
            )
        return RAD_PER_UNIT[unit]


def read_vicon(path: Path, angles: str | None = None, markers: Markers = ()) -> Recording:
    """Read Vicon's export.

    Args:
        path: the file.
        angles: what three numbers of a rotation mean: an order such as "XYZ", or "vector".
        markers: where markers are in their tools' frames, where the file holds no bodies.

    Raises:
        FormatError: a section lacks its header.
        InputError: a cell is wrong, or it is not known what three angles mean.
    """
    sections = dict(_sections(path.name, read_text(path, "an export of poses")))
    bodies = next((sections[title] for title in BODIES if title in sections), None)
    section = bodies or sections.get(MARKERS)
    if section is None or not section.rows:
        raise InputError(f"{path.name}: holds no rows of {', '.join((*BODIES, MARKERS))}; export one of them")
    if bodies is not None:
        poses, notes = [*_bodies(bodies, angles)], NO_NOTES
    else:
        places = {name: section.places(name, ("X", "Y", "Z")) for name in section.names}
        poses, notes = bodies_from_markers(places, markers, path.name)
    frames = section.numbers(0, "Frame")
    return Recording(
        times=(frames - 1) / section.rate,
        poses=by_name(poses, path.name),
        provenance=Provenance(path.name, "Vicon CSV", (str(path),)),
        diagnostics=tuple(notes),
    )


def _sections(name: str, text: str) -> Iterator[tuple[str, _Section]]:
    """The tables of poses and markers by title: each ends where no frame's number stands first."""
    separator = _separator(text)
    lines = [*csv_lines(name, text, separator)]
    at = 0
    while at < len(lines):
        title = lines[at][0][0].strip()
        if title not in (*BODIES, MARKERS):
            at += 1
            continue
        top = lines[at : at + ABOVE]
        if len(top) < ABOVE or not is_number(_rate(top[1][0])) or top[3][0][0].strip() != "Frame":
            raise FormatError(
                f"{name}, line {lines[at][1]}: lacks the rate, names, axes or units of its {title}; export it again"
            )
        rate = float(_rate(top[1][0]))
        if not 0 < rate < np.inf:
            raise InputError(
                f"{name}, line {top[1][1]}: {rate:g} frames a second is no rate; export it again"
            )
        end = at + ABOVE
        while end < len(lines) and is_number(lines[end][0][0]):
            end += 1
        columns = _columns(*(row for row, _ in top[2:]))
        data = lines[at + ABOVE : end]
        width = len(top[3][0])
        for row, line in data:
            if any(map(str.strip, row[width:])):
                raise other_width(f"{name}, line {line}", row, width, separator)
        rows, numbers = [row for row, _ in data], [line for _, line in data]
        yield title, _Section(name, rate, columns, rows, numbers, separator)
        at = end


def _columns(names: list[str], axes: list[str], units: list[str]) -> dict[tuple[str, str], tuple[int, str]]:
    """Where each axis of each name is, and its unit; a name stands above its first column."""
    found: dict[tuple[str, str], tuple[int, str]] = {}
    current = ""
    for i, axis in enumerate(axes[2:], 2):
        current = (names[i].strip() if i < len(names) else "") or current
        unit = units[i].strip() if i < len(units) else ""
        found.setdefault((current, axis.strip()), (i, unit))
    return found


def _bodies(section: _Section, angles: str | None) -> Iterator[Poses]:
    short = Counter(_tool(name)[-1] for name in section.names)
    for name in section.names:
        places = section.places(name, PLACE)
        if (name, "RW") in section.columns:
            turns = section.part(name, QUATERNION)
        elif angles is None:
            raise InputError(
                f"{section.name}: the rotation of {name} is three numbers, RX, RY, RZ, whose meaning the file does not "
                f"say; export quaternions, or say it with --angles: {ANGLES}"
            )
        else:
            numbers = section.part(name, THREE)
            scale = section.rad_per_unit(name)
            if scale == 1.0:
                refuse_degrees(numbers, f"{section.name}: the rotation of {name}", "write deg as their unit")
            turns = quaternions_from_angles(scale * numbers, angles)
        subject, body = _tool(name)
        tool = body if short[body] == 1 else subject + body
        yield poses_from_quaternions(turns, places, tool, "Tracker", section.name)


def _tool(name: str) -> tuple[str, str]:
    """Subject and segment of ``Subject:Segment``."""
    subject, _, body = name.partition(":")
    return subject, body or subject


def _rate(row: list[str]) -> str:
    """The cell of a rate, with a point for its decimal comma."""
    return row[0].replace(",", ".")


def _separator(text: str) -> str:
    """By the line of axes: the line of names above it may have one name between blank cells."""
    fourth = text.split("\n", 4)[3:4]
    return separator_of(fourth[0]) if fourth else ","


def _sniff(head: Head) -> bool:
    lines = [line.strip(b" \t\r,;") for line in head.text.split(b"\n", 2)[:2]]
    known = [title.encode() for title in (*BODIES, MARKERS)]
    return len(lines) == 2 and lines[0] in known and is_number(_rate([lines[1].decode("latin-1")]))


FORMAT = Format(
    name="Vicon CSV",
    kind="recording",
    suffixes=TABLE_SUFFIXES,
    header="Objects, Segments or Trajectories, and a rate below it",
    sniff=_sniff,
    read=read_vicon,
    options=("angles", "markers"),
    holds="bodies with quaternions, or with three angles and `--angles`; markers of rigid bodies, with `--markers` or "
    "labelled `Tool:marker`",
)
