"""What the columns of a table of poses hold, by their names."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from sonocal.geometry import Array

__all__ = ["MM_PER_UNIT", "Part", "PoseColumn", "in_mm", "pose_column", "tools_in"]

Part = Literal["quaternion", "place", "matrix", "angle"]
MM_PER_UNIT = {"": 1.0, "mm": 1.0, "cm": 10.0, "m": 1000.0, "um": 1e-3, "in": 25.4}
BETWEEN = r"[ ._:/-]"
NAME = re.compile(
    rf"""(?:(?P<tool>.*?){BETWEEN}+)?
    (?:(?P<quaternion>(?:q_?|quat_?|orientation[ ._]))(?=[wxyz])
      |(?P<place>(?:[tp]_?|pos_?|position[ ._]|translation[ ._])?)(?=[xyz])
      |(?P<matrix>m)(?=[0-3][0-3])
      |(?P<angle>r_?)(?=[xyz]))
    (?P<axis>[wxyz]|[0-3][0-3])
    (?P<after>[ _]*[\[(]?(?P<unit>mm|cm|um|in|m|deg|rad)[\])]?)?""",
    re.VERBOSE | re.IGNORECASE,
)
STATED = re.compile(rf"(?:(?P<tool>.+?){BETWEEN}+)?(?P<angles>[xyz]{{3}}|[XYZ]{{3}}|vector)")
# Longer names are no column's of a pose; a pattern takes the square of how many separators it meets.
LONGEST = 120
# What ROS and others write where a file holds one tool. The names of `rostopic echo -p` are of ROS alone: metres.
FROM_ROS = "field."
NAMELESS = {"pose", "transform", "field.pose", "field.pose.pose", "pose.pose", "field.transform"}


def in_mm(lengths: Array, mm_per_unit: ArrayLike) -> Array:
    """Lengths of a file, mm; one beyond all numbers is infinite, and its pose invalid."""
    with np.errstate(over="ignore"):
        return np.asarray(lengths * np.asarray(mm_per_unit))


@dataclass(frozen=True)
class PoseColumn:
    """One number of a pose.

    Attributes:
        name: of the column.
        tool: whose pose; empty where the name does not say.
        part: of which it is one.
        axis: ``w``, ``x``, ``y``, ``z``; of a matrix row and column.
        unit: in small letters; empty where the name does not say.
        angles: what three angles mean, where the name says.
        around: the name before and after the axis.
    """

    name: str
    tool: str
    part: Part
    axis: str
    unit: str
    angles: str
    around: tuple[str, str]

    def beside(self, axis: str) -> str:
        """The name of the same column of another axis."""
        return self.around[0] + axis + self.around[1]


def pose_column(name: str) -> PoseColumn | None:
    """What a column holds, by its name; None where it is no number of a pose."""
    match = NAME.fullmatch(name) if len(name) <= LONGEST else None
    if match is None:
        return None
    parts: tuple[Part, ...] = ("quaternion", "matrix", "angle", "place")
    part = next(part for part in parts if match[part] is not None)
    tool, angles, unit = match["tool"] or "", "", (match["unit"] or "").lower()
    if part == "angle" and (stated := STATED.fullmatch(tool)):
        tool, angles = stated["tool"] or "", stated["angles"]
    if not _fits(part, match["axis"], unit):
        return None
    if part == "place" and name.startswith(FROM_ROS):
        unit = unit or "m"
    tool = "" if tool.lower() in NAMELESS else tool
    around = (name[: match.start("axis")], name[match.end("axis") :])
    return PoseColumn(name, tool, part, match["axis"].lower(), unit, angles, around)


def tools_in(header: Iterable[str]) -> dict[str, dict[tuple[Part, str], PoseColumn]]:
    """The columns of each tool, by part and axis; where two say the same, the first."""
    found: dict[str, dict[tuple[Part, str], PoseColumn]] = {}
    for name in header:
        if column := pose_column(name):
            found.setdefault(column.tool, {}).setdefault((column.part, column.axis), column)
    return found


def _fits(part: Part, axis: str, unit: str) -> bool:
    """Whether a unit is one of such numbers, and only quaternions have a w."""
    if part == "place":
        return axis != "w" and unit in MM_PER_UNIT
    return unit in ("", "deg", "rad") if part == "angle" else unit == ""
