"""Whether to use what was found of a tool, in a sentence, for every way to show it."""

from __future__ import annotations

from typing import Literal

from sonocal.geometry.units import UNITS_CODE
from sonocal.tools.calibrate import ToolCalibration
from sonocal.tools.pivot import PivotCalibration

__all__ = ["verdict_on_tool"]


def verdict_on_tool(found: ToolCalibration) -> tuple[Literal["use", "care", "stop"], str]:
    """The level, and what to expect."""
    known = [
        f"the tip to +-{p.tip_95_mm:.2f} mm" for p in found.points[:1] if isinstance(p, PivotCalibration)
    ]
    if found.needle is not None:
        known.append(f"the needle's direction to +-{1.96 * found.needle.direction_deviation_deg:.2f} deg")
    trust = "expect " + " and ".join(known) + " (95 %)" if known else "see how well the points rested"
    if any(one.code == UNITS_CODE for one in found.diagnostics):
        return "stop", "Do not use it: the numbers may not be millimetres."
    if any(one.severity == "warning" for one in found.diagnostics):
        return "care", f"Use with care: {trust}; the warnings say why it may be more."
    return "use", f"Sound: {trust}"
