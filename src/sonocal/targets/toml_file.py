"""Needles, wires, planes and points in their own file (``.toml``).

[[line]]
name = "needle"
frame = "Needle"            # a tracked tool of the recording, or Probe
from_mm = [0.0, 0.0, 0.0]
to_mm = [0.0, 0.0, -333.0]

[[point]]
name = "tip"
frame = "Stylus"
at_mm = [0.0, 0.0, -150.0]

[[plane]]
name = "floor"
frame = "Tracker"           # fixed in the room
through_mm = [[0.0, 0.0, 0.0], [200.0, 0.0, 0.0], [0.0, 200.0, 0.0]]    # or point_mm = [...] and normal = [...]

[[line]]
name = "thread"
frame = "Tracker"
place = "unknown"           # of any target: found with the calibration; or where it roughly is, and sigma_mm

[phantom]                   # all targets in one frame, whose place together is unknown: `sonocal.targets.phantom`
frame = "Phantom"
fixed_to = "Reference"
place = "unknown"
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.files import path_of, write_atomically
from sonocal.files.kinds import Format, Head
from sonocal.files.toml import read_toml_text
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.targets.lines import Line, Plane, Point, Target, check_lines, require_lines
from sonocal.targets.phantom import Phantom, phantom_of, phantom_text
from sonocal.targets.toml_keys import check_keys
from sonocal.targets.unplaced import KINDS, Unplaced, of_phantom, target_of
from sonocal.targets.unplaced_tables import is_unplaced, unplaced_keys, unplaced_of

__all__ = [
    "FORMAT",
    "Targets",
    "in_phantom",
    "lines_toml",
    "read_lines_toml",
    "read_points_toml",
    "read_targets",
    "write_lines",
]

KEYS = ("name", "frame", "from_mm", "to_mm")
POINT_KEYS = ("name", "frame", "at_mm")
PLANE_KEYS, NORMAL_KEYS = ("name", "frame", "through_mm"), ("name", "frame", "point_mm", "normal")
# Of a plane by a point and its normal: its three points lie so far about that point, mm.
REACH_MM = 100.0
TABLE = re.compile(rb"^[ \t]*\[\[[ \t]*(line|point|plane)[ \t]*\]\]", re.MULTILINE)


@dataclass(frozen=True, eq=False)
class Targets:
    """What a file of targets holds.

    Attributes:
        lines: needles and wires.
        points: of tools, and others.
        planes: walls and floors.
        unplaced: those of any kind whose place is unknown, or known roughly.
    """

    lines: tuple[Line, ...]
    points: tuple[Point, ...] = ()
    planes: tuple[Plane, ...] = ()
    unplaced: tuple[Unplaced, ...] = ()

    __repr__ = brief


def read_targets(path: str | Path) -> Targets:
    """Read needles, wires, planes and points.

    Raises:
        FormatError: the file is not TOML.
        InputError: a table lacks something, a name stands twice, or there is no line, point or plane.
    """
    path = path_of(path)
    document = _document(path)
    points, planes = _points(path.name, document), _planes(path.name, document)
    unplaced = _unplaced(path.name, document)
    no_lines = (points or planes or unplaced) and not _known_tables(path.name, document, "line")
    found = Targets(() if no_lines else _lines(path.name, document), points, planes, unplaced)
    phantom = phantom_of(path.name, document)
    return found if phantom is None else _with_phantom(path.name, found, phantom)


def _with_phantom(name: str, found: Targets, phantom: Phantom) -> Targets:
    """Those in the phantom's frame as what its place is asked for by.

    Raises:
        InputError: none is, or one of them has no place in it.
    """
    if lost := [one for one in found.unplaced if one.frame == phantom.frame]:
        raise InputError(
            f"{name}: {lost[0].kind} {lost[0].name!r} has no place in the phantom, whose shape must be known; say "
            "where it is in the phantom's frame"
        )
    every: tuple[Target, ...] = (*found.lines, *found.planes, *found.points)
    mine = [one for one in every if one.frame == phantom.frame]
    if not mine:
        raise InputError(
            f"{name}: no target is in the phantom's frame {phantom.frame!r}; give its wires that frame"
        )
    check_lines(name, mine, "targets of the phantom")
    lines, points, planes = (
        [one for one in part if one.frame != phantom.frame]
        for part in (found.lines, found.points, found.planes)
    )
    together = tuple(of_phantom(phantom, one) for one in mine)
    return Targets(tuple(lines), tuple(points), tuple(planes), (*found.unplaced, *together))  # type: ignore[arg-type]


def in_phantom(targets: Targets) -> Targets:
    """A phantom's targets where they are in its own frame, as what puts it in place needs them."""
    known = {
        kind: tuple(
            target_of(one.kind, one.name, one.phantom.frame, one.in_phantom_mm)
            for one in targets.unplaced
            if one.kind == kind and one.phantom is not None and one.in_phantom_mm is not None
        )
        for kind in KINDS
    }
    return Targets(
        (*targets.lines, *known["line"]),  # type: ignore[arg-type]
        (*targets.points, *known["point"]),  # type: ignore[arg-type]
        (*targets.planes, *known["plane"]),  # type: ignore[arg-type]
        tuple(one for one in targets.unplaced if one.phantom is None),
    )


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
    name: str,
    lines: Sequence[Line],
    points: Sequence[Point] = (),
    remarks: Sequence[str] = (),
    *,
    planes: Sequence[Plane] = (),
    unplaced: Sequence[Unplaced] = (),
) -> bytes:
    """Needles, wires, points and planes as the text of their file, with remarks (of one line each) above them."""
    check_lines(name, lines)
    head = ["".join(f"# {remark}\n" for remark in remarks)] if remarks else []
    tables = [*map(_table, lines), *map(_point_table, points), *map(_plane_table, planes)]
    tables += map(_unplaced_table, unplaced)
    phantoms = {id(one.phantom): one.phantom for one in unplaced if one.phantom is not None}
    if len(phantoms) > 1:
        raise InputError(f"{name}: a file of targets holds one phantom; write each into a file of its own")
    tables += [phantom_text(list(phantoms.values()))] if phantoms else []
    return "\n".join([*head, *tables]).encode()


def _lines(name: str, document: dict[str, Any]) -> tuple[Line, ...]:
    tables = _known_tables(name, document, "line")
    if not tables and "line" in document and _tables(name, document, "line"):
        raise InputError(
            f"{name}: has no [[line]] whose place is known, and this needs one; give {', '.join(KEYS[2:])}"
        )
    if not tables:
        raise InputError(f"{name}: has no [[line]] table; write one a needle or wire: {', '.join(KEYS)}")
    lines = tuple(_line(name, number, table) for number, table in tables)
    check_lines(name, lines)
    return lines


def _line(name: str, number: int, table: dict[str, Any]) -> Line:
    where = f"{name}, line table {number}"
    check_keys(where, table, KEYS)
    ends = [list(_numbers(where, key, table[key])) for key in ("from_mm", "to_mm")]
    with _naming(name):
        return Line(table["name"], table["frame"], np.array(ends))


def _points(name: str, document: dict[str, Any]) -> tuple[Point, ...]:
    return tuple(_point(name, i, table) for i, table in _known_tables(name, document, "point"))


def _point(name: str, number: int, table: dict[str, Any]) -> Point:
    where = f"{name}, point table {number}"
    check_keys(where, table, POINT_KEYS)
    place = np.array(list(_numbers(where, "at_mm", table["at_mm"])))
    with _naming(name):
        return Point(table["name"], table["frame"], place)


def _planes(name: str, document: dict[str, Any]) -> tuple[Plane, ...]:
    planes = tuple(_plane(name, i, table) for i, table in _known_tables(name, document, "plane"))
    check_lines(name, planes, "planes")
    return planes


def _plane(name: str, number: int, table: dict[str, Any]) -> Plane:
    where, by_normal = f"{name}, plane table {number}", "normal" in table or "point_mm" in table
    check_keys(where, table, NORMAL_KEYS if by_normal else PLANE_KEYS)
    if by_normal:
        at, normal = (np.array(list(_numbers(where, key, table[key]))) for key in ("point_mm", "normal"))
        if not np.any(normal):
            raise InputError(f"{where}: normal is (0, 0, 0); give the direction at right angles to the plane")
        across = np.linalg.svd(normal[None])[2][1:]
        corners = 2 * np.pi / 3 * np.arange(3)
        through = at + REACH_MM * np.column_stack([np.cos(corners), np.sin(corners)]) @ across
    else:
        rows = table["through_mm"]
        three = rows if isinstance(rows, list) and len(rows) == 3 else [rows] * 3
        through = np.array([list(_numbers(where, "each of through_mm", row)) for row in three])
    with _naming(name):
        return Plane(table["name"], table["frame"], through)


def _unplaced(name: str, document: dict[str, Any]) -> tuple[Unplaced, ...]:
    place_of: dict[str, Callable[[str, int, dict[str, Any]], Target]]
    place_of = {"point": _point, "line": _line, "plane": _plane}
    found = []
    for kind in KINDS:
        for number, table in enumerate(_tables(name, document, kind), 1):
            if is_unplaced(table):
                known = partial(place_of[kind], name, number)
                found.append(unplaced_of(f"{name}, {kind} table {number}", kind, table, known))
    return tuple(found)


def _known_tables(name: str, document: dict[str, Any], kind: str) -> list[tuple[int, dict[str, Any]]]:
    """The tables of targets whose place is known, with their numbers in the file."""
    numbered = enumerate(_tables(name, document, kind), 1)
    return [(number, table) for number, table in numbered if not is_unplaced(table)]


@contextmanager
def _naming(name: str) -> Iterator[None]:
    """Put the file's name before what is wrong with a target."""
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


def _plane_table(plane: Plane) -> str:
    points = ", ".join(_array(point) for point in plane.points_mm)
    return f"[[plane]]\n{_names(plane)}through_mm = [{points}]\n"


def _unplaced_table(target: Unplaced) -> str:
    texts: dict[str, Any] = {"point": _point_table, "line": _table, "plane": _plane_table}
    if target.phantom is not None and target.in_phantom_mm is not None:
        within = target_of(target.kind, target.name, target.phantom.frame, target.in_phantom_mm)
        return str(texts[target.kind](within))
    keys = unplaced_keys(target)
    if target.spanning_mm is None:
        return f"[[{target.kind}]]\n{_names(target)}{keys}"
    known = target_of(target.kind, target.name, target.frame, target.spanning_mm)
    return f"{texts[target.kind](known)}{keys}"


def _names(thing: Target | Unplaced) -> str:
    # A JSON string is a TOML string, once the one control character that JSON leaves alone is escaped.
    name, frame = (
        json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f") for text in (thing.name, thing.frame)
    )
    return f"name = {name}\nframe = {frame}\n"


def _array(place: Array) -> str:
    return "[" + ", ".join(repr(float(x)) for x in place) + "]"


def _write(targets: Targets, path: Path) -> None:
    write_atomically(
        path,
        lines_toml(
            path.name, targets.lines, targets.points, planes=targets.planes, unplaced=targets.unplaced
        ),
    )


def _sniff(head: Head) -> bool:
    return b"\0" not in head.content and TABLE.search(head.text) is not None


FORMAT = Format(
    name="needles, wires, points, planes",
    kind="targets",
    suffixes=(".toml",),
    sniff=_sniff,
    read=read_targets,
    holds="segments, points and planes in the frames of what is tracked",
    write=_write,
    writes=(".toml",),
)
