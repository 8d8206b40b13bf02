"""Where a tool's tip was said to be: three numbers, or a file of ours or of other software."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.geometry import Array
    from sonocal.tools import ToolCalibration

__all__ = ["ExpectedTip", "expected_tip", "place_of_tip"]


@dataclass(frozen=True)
class ExpectedTip:
    """A tip as it was said to be, beside the one that was found.

    Attributes:
        said_mm: where it was said to be, in the frame of the tool's marker.
        distance_mm: how far from there it was found.
        known_mm: what the found one is known to (95 %); None where nothing says so.
        sentence: the same in words.
    """

    said_mm: tuple[float, ...]
    distance_mm: float
    known_mm: float | None
    sentence: str


def place_of_tip(value: tuple[float, ...] | Path, tool: str) -> Array:
    """(3,): a tip in the frame of its tool's marker, mm.

    Args:
        value: three numbers; or a file that ``sonocal tool`` wrote, a device set of PLUS with such as
            StylusTipToStylus, or a transform of ITK or 3D Slicer whose translation it is.
        tool: the marker's name.

    Raises:
        InputError: the file holds no tip of that tool, or several.
    """
    import numpy as np

    from sonocal.cli.formats import kind_of
    from sonocal.tools import stylus_tip

    if not isinstance(value, Path):
        return np.array(value)
    kind = None if value.is_dir() else kind_of(value)
    if kind == "device set":
        return _of_device_set(value, tool)
    if kind == "matrix":
        from sonocal.existing import read_existing

        return read_existing(value).matrix[:3, 3]
    return stylus_tip(value, tool)


def expected_tip(found: ToolCalibration, value: tuple[float, ...] | Path) -> ExpectedTip:
    """How far a tip that was found is from where it was said to be.

    Raises:
        InputError: no tip was found, or the file holds none.
    """
    import numpy as np

    from sonocal.registration.uncertainty import radius_95
    from sonocal.tools import PivotCalibration

    tips = [point for point in found.points[:1] if isinstance(point, PivotCalibration)]
    if not tips:
        raise InputError(f"{found.tool}: has no tip to compare with --expected; pivot the tool about its tip")
    said = place_of_tip(value, found.tool)
    distance = float(np.linalg.norm(tips[0].tip_mm - said))
    known = float(radius_95(tips[0].covariance[:3, :3]))
    verdict = "more than that leaves open" if distance > known else "no more than that leaves open"
    where = ", ".join(f"{x:.2f}" for x in said)
    sentence = (
        f"The tip is {distance:.2f} mm from where it was said to be, ({where}) mm; it is known to {known:.2f} mm "
        f"(95 %): {verdict}."
    )
    return ExpectedTip(tuple(said.tolist()), distance, known, sentence)


def _of_device_set(path: Path, tool: str) -> Array:
    """The place of ``TipToTool``, whatever the tip is called."""
    from sonocal.targets import read_device_set

    transforms = read_device_set(path).transforms
    found = [
        matrix
        for (target, source), matrix in transforms.items()
        if target.lower() == tool.lower() and source.lower().endswith("tip")
    ]
    if len(found) != 1:
        have = ", ".join(f"{source}To{target}" for target, source in transforms) or "none"
        raise InputError(
            f"{path.name}: has {len(found)} transforms of a tip to {tool} where it must have one, such as "
            f"{tool}TipTo{tool}; it has {have[:300]}"
        )
    return found[0][:3, 3]
