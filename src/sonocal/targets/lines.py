"""Straight things whose place is known, and points of tools."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np

from sonocal.errors import WORDS, InputError, require
from sonocal.geometry import Array, frozen, real_array
from sonocal.geometry.shown import brief

__all__ = ["Line", "Point", "check_lines", "require_lines"]


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

    __repr__ = brief

    def __post_init__(self) -> None:
        _check_names("point", self, "it is in")
        place = frozen(np.array(real_array(f"point {self.name!r}: its place", self.place_mm)))
        if place.shape != (3,) or not np.isfinite(place).all():
            raise InputError(f"point {self.name!r}: needs a place of three finite numbers, mm")
        object.__setattr__(self, "place_mm", place)


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


def check_lines(name: str, lines: Sequence[Line]) -> None:
    """Refuse two lines of one name, which no detection could tell apart."""
    seen: set[str] = set()
    for line in lines:
        if line.name in seen:
            raise InputError(f"{name}: two lines are called {line.name!r}; give each its own name")
        seen.add(line.name)


def _check_names(kind: str, target: Line | Point, where: str) -> None:
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
