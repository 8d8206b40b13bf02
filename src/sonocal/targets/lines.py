"""Straight things whose place is known: needles and wires, points of tools, and their ``.toml`` file.

[[line]]
name = "needle"
frame = "Needle"            # a tracked tool of the recording, or Probe
from_mm = [0.0, 0.0, 0.0]
to_mm = [0.0, 0.0, -333.0]

[[point]]
name = "tip"
frame = "Stylus"
at_mm = [0.0, 0.0, -150.0]
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.files import read_text, write_atomically
from sonocal.geometry import Array

__all__ = ["Line", "Point", "check_lines", "lines_toml", "read_lines_toml", "read_points_toml", "write_lines"]

KEYS = ("name", "frame", "from_mm", "to_mm")
POINT_KEYS = ("name", "frame", "at_mm")


@dataclass(frozen=True, eq=False)
class Line:
    """A segment in the frame of something tracked.

    Attributes:
        name: what detections call it.
        frame: in whose frame its ends are, such as "Needle".
        segment_mm: (2, 3): its ends.
    """

    name: str
    frame: str
    segment_mm: Array

    def __post_init__(self) -> None:
        segment = np.asarray(self.segment_mm, dtype=float)
        if segment.shape != (2, 3) or not np.isfinite(segment).all():
            raise InputError(f"line {self.name!r}: needs two ends of three finite numbers, mm")
        if np.array_equal(segment[0], segment[1]):
            raise InputError(f"line {self.name!r}: has zero length; give two different points of it")
        if not self.name or not self.frame:
            raise InputError(f"line {self.name!r}: needs a name and the frame its ends are in")
        object.__setattr__(self, "segment_mm", segment)


@dataclass(frozen=True, eq=False)
class Point:
    """A point of something tracked, such as the tip of a stylus.

    Attributes:
        name: such as "tip".
        frame: in whose frame it is, such as "Stylus".
        place_mm: (3,).
    """

    name: str
    frame: str
    place_mm: Array


def read_lines_toml(path: str | Path) -> tuple[Line, ...]:
    """Read needles and wires.

    Raises:
        FormatError: the file is not TOML.
        InputError: a line lacks something, or a name stands twice.
    """
    path = Path(path)
    tables = _tables(path, "line")
    if not tables:
        raise InputError(f"{path.name}: has no [[line]] table; write one a needle or wire: {', '.join(KEYS)}")
    lines = tuple(_line(path.name, number, table) for number, table in enumerate(tables, 1))
    check_lines(path.name, lines)
    return lines


def read_points_toml(path: str | Path) -> tuple[Point, ...]:
    """Read the points of tools; none, where the file has no ``[[point]]``.

    Raises:
        FormatError: the file is not TOML.
        InputError: a point lacks something.
    """
    path = Path(path)
    points = []
    for number, table in enumerate(_tables(path, "point"), 1):
        where = f"{path.name}, point table {number}"
        _check_keys(where, table, POINT_KEYS)
        points.append(
            Point(table["name"], table["frame"], np.array(list(_numbers(where, "at_mm", table["at_mm"]))))
        )
    return tuple(points)


def write_lines(lines: Sequence[Line], path: str | Path) -> None:
    """Write needles and wires; reading them again gives the same numbers to the last bit."""
    write_atomically(path, lines_toml(str(path), lines))


def lines_toml(
    name: str, lines: Sequence[Line], points: Sequence[Point] = (), remarks: Sequence[str] = ()
) -> bytes:
    """Needles, wires and points as the text of their file, with remarks (of one line each) above them."""
    check_lines(name, lines)
    head = ["".join(f"# {remark}\n" for remark in remarks)] if remarks else []
    return "\n".join([*head, *map(_table, lines), *map(_point_table, points)]).encode()


def check_lines(name: str, lines: Sequence[Line]) -> None:
    """Refuse two lines of one name, which no detection could tell apart."""
    seen: set[str] = set()
    for line in lines:
        if line.name in seen:
            raise InputError(f"{name}: two lines are called {line.name!r}; give each its own name")
        seen.add(line.name)


def _line(name: str, number: int, table: dict[str, Any]) -> Line:
    where = f"{name}, line table {number}"
    _check_keys(where, table, KEYS)
    ends = [list(_numbers(where, key, table[key])) for key in ("from_mm", "to_mm")]
    try:
        return Line(table["name"], table["frame"], np.array(ends))
    except InputError as error:
        raise InputError(f"{name}, {error}") from None


def _tables(path: Path, kind: str) -> list[dict[str, Any]]:
    try:
        document = tomllib.loads(read_text(path, "a file of needles and wires"))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise FormatError(f"{path.name}: is not TOML ({error})") from None
    tables = document.get(kind, [])
    if not isinstance(tables, list) or not all(isinstance(t, dict) for t in tables):
        raise InputError(f"{path.name}: {kind} must be tables; write each as [[{kind}]]")
    return tables


def _check_keys(where: str, table: dict[str, Any], keys: Sequence[str]) -> None:
    if missing := [key for key in keys if key not in table]:
        raise InputError(f"{where}: lacks {', '.join(missing)}; it needs {', '.join(keys)}")
    if unknown := [key for key in table if key not in keys]:
        raise InputError(f"{where}: has the unknown key {unknown[0]!r}; known are {', '.join(keys)}")
    if not (isinstance(table["name"], str) and isinstance(table["frame"], str)):
        raise InputError(f"{where}: name and frame are text in quotes")


def _numbers(where: str, key: str, value: Any) -> Iterator[float]:
    numbers = value if isinstance(value, list) and len(value) == 3 else [None]
    for x in numbers:
        if isinstance(x, bool) or not isinstance(x, (int, float)) or not abs(x) < 1e9:
            raise InputError(
                f"{where}: {key} is three numbers in mm such as [0.0, 0.0, -333.0]; got {str(value)[:60]}"
            )
        yield float(x)


def _table(line: Line) -> str:
    ends = [_array(end) for end in line.segment_mm]
    return f"[[line]]\n{_names(line)}from_mm = {ends[0]}\nto_mm = {ends[1]}\n"


def _point_table(point: Point) -> str:
    return f"[[point]]\n{_names(point)}at_mm = {_array(point.place_mm)}\n"


def _names(thing: Line | Point) -> str:
    # A JSON string is a TOML string, once the one control character that JSON leaves alone is escaped.
    name, frame = (
        json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f") for text in (thing.name, thing.frame)
    )
    return f"name = {name}\nframe = {frame}\n"


def _array(place: Array) -> str:
    return "[" + ", ".join(repr(float(x)) for x in place) + "]"
