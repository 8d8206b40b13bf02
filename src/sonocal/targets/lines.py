"""Straight things whose place is known: points, lines, planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np

from sonocal.errors import WORDS, InputError, require
from sonocal.geometry import Array, frozen, on_one_line, real_array
from sonocal.geometry.shown import brief

__all__ = ["Line", "Plane", "Point", "Target", "check_lines", "require_lines"]


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

    __repr__ = brief

    def __post_init__(self) -> None:
        _check_names("line", self, "its ends are in")
        segment = frozen(np.array(real_array(f"line {self.name!r}: its ends", self.segment_mm)))
        if segment.shape != (2, 3) or not np.isfinite(segment).all():
            raise InputError(f"line {self.name!r}: needs two ends of three finite numbers, mm")
        if np.array_equal(segment[0], segment[1]):
            raise InputError(f"line {self.name!r}: has zero length; give two different points of it")
        object.__setattr__(self, "segment_mm", segment)

    @property
    def spanning_mm(self) -> Array:
        """(2, 3): its ends."""
        return self.segment_mm


@dataclass(frozen=True, eq=False)
class Point:
    """A point of something tracked, such as the tip of a stylus, a bead or a cross-wire.

    Attributes:
        name: such as "tip".
        frame: in whose frame it is, such as "Stylus".
        place_mm: (3,).
    """

    name: str
    frame: str
    place_mm: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        _check_names("point", self, "it is in")
        place = frozen(np.array(real_array(f"point {self.name!r}: its place", self.place_mm)))
        if place.shape != (3,) or not np.isfinite(place).all():
            raise InputError(f"point {self.name!r}: needs a place of three finite numbers, mm")
        object.__setattr__(self, "place_mm", place)

    @property
    def spanning_mm(self) -> Array:
        """(1, 3): itself."""
        return self.place_mm[None]


@dataclass(frozen=True, eq=False)
class Plane:
    """A plane in the frame of something tracked: a wall, a floor, a sheet.

    Attributes:
        name: what detections call it.
        frame: in whose frame its points are, such as "Tracker".
        points_mm: (3, 3): three points of it, near where it is seen: what they are off by, it is off by there.
    """

    name: str
    frame: str
    points_mm: Array

    __repr__ = brief

    def __post_init__(self) -> None:
        _check_names("plane", self, "its points are in")
        points = frozen(np.array(real_array(f"plane {self.name!r}: its points", self.points_mm)))
        if points.shape != (3, 3) or not np.isfinite(points).all():
            raise InputError(f"plane {self.name!r}: needs three points of three finite numbers, mm")
        if on_one_line(points):
            raise InputError(f"plane {self.name!r}: has three points on one line; give three that span it")
        object.__setattr__(self, "points_mm", points)

    @property
    def spanning_mm(self) -> Array:
        """(3, 3): its points."""
        return self.points_mm


Target = Line | Plane | Point


def require_lines(lines: object) -> None:
    """Refuse what is no sequence of lines.

    Raises:
        InputError: it is something else.
    """
    if isinstance(lines, (str, PurePath)):
        raise InputError(
            f"lines must be a list of lines; got the name {str(lines)[:80]!r}: read them from the file with "
            "lines, fixed = sonocal.targets.read_lines(name)"
        )
    require("lines", lines, Sequence, WORDS["Line"])
    assert isinstance(lines, Sequence)
    for line in lines:
        require("lines", line, Line)


def check_lines(name: str, lines: Sequence[Any], what: str = "lines") -> None:
    """Refuse two lines, or other targets, of one name, which no detection could tell apart."""
    seen: set[str] = set()
    for line in lines:
        if line.name in seen:
            raise InputError(f"{name}: two {what} are called {line.name!r}; give each its own name")
        seen.add(line.name)


def _check_names(kind: str, target: Target, where: str) -> None:
    for text in (target.name, target.frame):
        require(f"name and frame of a {kind}", text, str, "text")
    if not target.name or not target.frame:
        raise InputError(f"{kind} {target.name!r}: needs a name and the frame {where}")
    try:
        (target.name + target.frame).encode()
    except UnicodeEncodeError:  # half a character, of a command line that is not UTF-8
        raise InputError(
            f"{kind} {target.name!r}: its name or frame {target.frame!r} is not Unicode text; name it otherwise"
        ) from None
