"""Needles, wires and points of tools in their own file (``.toml``).

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
import re
import tomllib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.files import path_of, write_atomically
from sonocal.files.kinds import Format, Head
from sonocal.files.toml import read_toml_text
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.targets.lines import Line, Point, check_lines, require_lines

__all__ = [
    "FORMAT",
    "Targets",
    "lines_toml",
    "read_lines_toml",
    "read_points_toml",
    "read_targets",
    "write_lines",
]

KEYS = ("name", "frame", "from_mm", "to_mm")
POINT_KEYS = ("name", "frame", "at_mm")
TABLE = re.compile(rb"^[ \t]*\[\[[ \t]*(line|point)[ \t]*\]\]", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Targets:
    """What a file of targets holds.

    Attributes:
        lines: needles and wires.
        points: of tools.
    """

    lines: tuple[Line, ...]
    points: tuple[Point, ...] = ()

    __repr__ = brief


def read_targets(path: str | Path) -> Targets:
    """Read needles, wires and points of tools.

    Raises:
        FormatError: the file is not TOML.
        InputError: a table lacks something, a name stands twice, or there is neither a line nor a point.
    """
    path = path_of(path)
    document = _document(path)
    points = _points(path.name, document)
    return Targets(() if points and "line" not in document else _lines(path.name, document), points)


def read_lines_toml(path: str | Path) -> tuple[Line, ...]:
    """Read needles and wires.

    Raises:
        FormatError: the file is not TOML.
        InputError: a line lacks something, or a name stands twice.
    """
    path = path_of(path)
    return _lines(path.name, _document(path))


def read_points_toml(path: str | Path) -> tuple[Point, ...]:
    """Read the points of tools; none, where the file has no ``[[point]]``.

    Raises:
        FormatError: the file is not TOML.
        InputError: a point lacks something.
    """
    path = path_of(path)
    return _points(path.name, _document(path))


def write_lines(lines: Sequence[Line], path: str | Path) -> None:
    """Write needles and wires; reading them again gives the same numbers to the last bit."""
    require_lines(lines)
    write_atomically(path, lines_toml(str(path_of(path)), lines))


def lines_toml(
    name: str, lines: Sequence[Line], points: Sequence[Point] = (), remarks: Sequence[str] = ()
) -> bytes:
    """Needles, wires and points as the text of their file, with remarks (of one line each) above them."""
    check_lines(name, lines)
    head = ["".join(f"# {remark}\n" for remark in remarks)] if remarks else []
    return "\n".join([*head, *map(_table, lines), *map(_point_table, points)]).encode()


def _lines(name: str, document: dict[str, Any]) -> tuple[Line, ...]:
    tables = _tables(name, document, "line")
    if not tables:
        raise InputError(f"{name}: has no [[line]] table; write one a needle or wire: {', '.join(KEYS)}")
    lines = tuple(_line(name, number, table) for number, table in enumerate(tables, 1))
    check_lines(name, lines)
    return lines


def _line(name: str, number: int, table: dict[str, Any]) -> Line:
    where = f"{name}, line table {number}"
    _check_keys(where, table, KEYS)
    ends = [list(_numbers(where, key, table[key])) for key in ("from_mm", "to_mm")]
    with _naming(name):
        return Line(table["name"], table["frame"], np.array(ends))


def _points(name: str, document: dict[str, Any]) -> tuple[Point, ...]:
    return tuple(_point(name, i, table) for i, table in enumerate(_tables(name, document, "point"), 1))


def _point(name: str, number: int, table: dict[str, Any]) -> Point:
    where = f"{name}, point table {number}"
    _check_keys(where, table, POINT_KEYS)
    place = np.array(list(_numbers(where, "at_mm", table["at_mm"])))
    with _naming(name):
        return Point(table["name"], table["frame"], place)


@contextmanager
def _naming(name: str) -> Iterator[None]:
    """Put the file's name before what is wrong with a line or point."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{name}, {error}") from None


def _document(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(read_toml_text(path, "a file of needles and wires"))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise FormatError(f"{path.name}: is not TOML ({error})") from None


def _tables(name: str, document: dict[str, Any], kind: str) -> list[dict[str, Any]]:
    tables = document.get(kind, [])
    if not isinstance(tables, list) or not all(isinstance(t, dict) for t in tables):
        raise InputError(f"{name}: {kind} must be tables; write each as [[{kind}]]")
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


def _write(targets: Targets, path: Path) -> None:
    write_atomically(path, lines_toml(path.name, targets.lines, targets.points))


def _sniff(head: Head) -> bool:
    return b"\0" not in head.content and TABLE.search(head.text) is not None


FORMAT = Format(
    name="needles, wires, points of tools",
    kind="targets",
    suffixes=(".toml",),
    sniff=_sniff,
    read=read_targets,
    holds="segments and points in the frames of what is tracked",
    write=_write,
    writes=(".toml",),
)
