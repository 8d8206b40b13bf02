"""The needle from a pivot and a spin, as the page is told of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.geometry.shown import brief
from sonocal.studio.answer import numbers
from sonocal.studio.told import findings_told
from sonocal.tools import PivotCalibration, SpinCalibration, ToolCalibration, tool_toml
from sonocal.tools.needle import NeedleCalibration
from sonocal.tools.verdict import verdict_on_tool

__all__ = ["NEEDLE", "Asked", "ToolOf", "needle_file", "tool_told"]

NEEDLE = "needle.toml"
LETTERS = 60


@dataclass(frozen=True)
class Asked:
    """What a needle is to be found from.

    Attributes:
        pivot: a recording of the tool tilted about its resting tip.
        spin: a recording of it turned about its shaft.
        tool: what its marker is called.
        length_mm: of the shaft, from the tip; None: to beside the marker.
    """

    pivot: Path | None = None
    spin: Path | None = None
    tool: str = "Needle"
    length_mm: float | None = None

    __repr__ = brief


ToolOf = Callable[[Asked], ToolCalibration]
"""What recordings say of a tool; may raise `SonocalError`."""


def needle_file(found: ToolCalibration) -> bytes | None:
    """The needle as a file of targets; None where what was recorded does not tell it."""
    return None if found.needle is None else tool_toml(found, NEEDLE)


def tool_told(found: ToolCalibration) -> dict[str, Any]:
    """Verdict, tip, axis, needle and findings, as JSON has them."""
    level, sentence = verdict_on_tool(found)
    tip = next((one for one in found.points[:1] if isinstance(one, PivotCalibration)), None)
    content = needle_file(found)
    return {
        "tool": found.tool[:LETTERS],
        "level": level,
        "sentence": sentence,
        "tip": None if tip is None else _tip(tip),
        "axis": None if found.spin is None else _axis(found.spin),
        "needle": None if found.needle is None else _needle(found.needle),
        "findings": findings_told(found.diagnostics),
        "toml": None if content is None else content.decode(),
    }


def _tip(tip: PivotCalibration) -> dict[str, Any]:
    return {
        "at_mm": numbers(tip.tip_mm, 2),
        "within_mm": round(tip.tip_95_mm, 3),
        "rms_mm": round(tip.rms_mm, 3),
        "tilt_deg": round(tip.spread_deg, 1),
        "used": int(tip.inlier.sum()),
        "of": len(tip.inlier),
    }


def _axis(spin: SpinCalibration) -> dict[str, Any]:
    return {
        "direction": numbers(spin.direction, 4),
        "turn_deg": round(spin.turn_deg, 1),
        "wobble_deg": round(spin.wobble_deg, 2),
        "wobble_mm": round(spin.wobble_mm, 2),
        "used": int(spin.inlier.sum()),
        "of": len(spin.inlier),
    }


def _needle(needle: NeedleCalibration) -> dict[str, Any]:
    start, end = needle.line.segment_mm
    return {
        "from_mm": numbers(start, 2),
        "to_mm": numbers(end, 2),
        "length_mm": round(float(np.linalg.norm(end - start)), 1),
        "within_deg": round(1.96 * needle.direction_deviation_deg, 3),
    }
