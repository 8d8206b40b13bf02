"""A tool from recordings of it: its tip, its axis, and the needle that follows from what there is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sonocal.errors import InputError, SonocalError, require
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.geometry.units import UNITS_CODE, Hint, needle_hints, tip_hints, unit_doubt
from sonocal.recording import (
    Poses,
    Recording,
)
from sonocal.recording.lengths import unit_findings
from sonocal.recording.poses import OnInvalid
from sonocal.targets import (
    Point,
    lines_toml,
    read_points_toml,
)
from sonocal.tools.needle import (
    DigitisedPoint,
    NeedleCalibration,
    digitise_point,
    needle_from_axis,
    needle_from_points,
    needle_from_spin,
)
from sonocal.tools.pivot import (
    PivotCalibration,
    calibrate_pivot,
)
from sonocal.tools.spin import (
    SpinCalibration,
    calibrate_spin,
)

__all__ = ["Stylus", "ToolCalibration", "calibrate_tool", "pivot_doubts", "stylus_tip", "tool_toml"]


# Poses that tell whether a pivot is in mm.
ENOUGH_POSES = 400


@dataclass(frozen=True, eq=False)
class Stylus:
    """What touches the tool: the name of its marker, and its tip (3,) mm in that marker's frame."""

    name: str
    tip_mm: Array

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class ToolCalibration:
    """What was found of a tool; all in the frame of its marker.

    Attributes:
        tool: the marker's name.
        points: the tip first, then a second point of the needle, where they were recorded.
        spin: the axis, where it was recorded.
        needle: the needle, where two of these tell it.
        diagnostics: what to know before use, warnings first.
    """

    tool: str
    points: tuple[PivotCalibration | DigitisedPoint, ...]
    spin: SpinCalibration | None
    needle: NeedleCalibration | None
    diagnostics: tuple[Diagnostic, ...]

    __repr__ = brief


def calibrate_tool(
    tool: str,
    first: Recording | None = None,
    second: Recording | None = None,
    spin: Recording | None = None,
    *,
    stylus: Stylus | None = None,
    reference: str | None = None,
    length_mm: float | None = None,
    name: str = "needle",
    on_invalid: OnInvalid = "raise",
    seed: int = 0,
) -> ToolCalibration:
    """The tip, the axis and the needle of a tool, from what was recorded of it.

    Args:
        tool: what its marker is called.
        first: a pivot about the tip, or with a stylus, a touch of it.
        second: a pivot about another point of the needle, or a touch of it.
        spin: the tool spun about its shaft.
        stylus: what touches the tool; without one, `first` and `second` are pivots.
        reference: marker that the divot is fixed to; default: the tracker itself.
        length_mm: of the needle, from its tip; default with a tip: to beside the marker.
        name: of the needle's line.
        on_invalid: what to do with poses marked valid that are not rigid.
        seed: of the random triples of poses.

    Raises:
        InputError: there is no such tool, nothing to calibrate from, or too few poses.
        DegenerateGeometryError: the tool was still, hardly tilted, or turned about several axes.
        NoConsensusError: the tip did not rest.
    """
    if first is None and spin is None:
        raise InputError("a tool needs a recording of a pivot or of a spin; give one")
    points = tuple(
        _point(part, tool, stylus=stylus, reference=reference, on_invalid=on_invalid, seed=seed)
        for part in (first, second)
        if part is not None
    )
    axis = None
    if spin is not None:
        poses = _poses(spin, tool, reference, on_invalid)
        axis = calibrate_spin(poses.matrices, poses.valid, spin.name)
    doubts = [*_doubts([part for part in (first, second, spin) if part is not None], tool, points)]
    try:
        needle = _needle(points, axis, length_mm, name, tool)
    except InputError as error:  # of metres a needle is too short, and its length is not what is wrong
        if not doubts:
            raise
        raise InputError(
            f"{doubts[0].message}; {doubts[0].advice} (refused as it stands: {error})"
        ) from error
    findings = list(needle.diagnostics) if needle is not None else []
    parts = [part for part in (*points, axis) if part is not None]
    findings += doubts or _needle_doubts(tool, needle)
    findings += [found for part in parts for found in part.diagnostics if found not in findings]
    findings.sort(key=lambda found: found.severity != "warning")
    return ToolCalibration(tool, points, axis, needle, tuple(findings))


def _doubts(
    parts: Sequence[Recording], tool: str, points: Sequence[PivotCalibration | DigitisedPoint]
) -> Iterator[Diagnostic]:
    """The doubt that the tool's poses, or else the tips that follow from them, are in mm."""
    used = {part.name: replace(part, poses={tool: part.tool(tool)}) for part in parts}
    found = [finding for part in used.values() for finding in unit_findings(part)]
    pivots = [point for point in points if isinstance(point, PivotCalibration)]
    yield from found or unit_doubt([hint for pivot in pivots for hint in _tip_hints(pivot)])


def _tip_hints(pivot: PivotCalibration) -> list[Hint]:
    return tip_hints(float(np.linalg.norm(pivot.tip_mm)), pivot.rms_mm)


def _needle_doubts(tool: str, needle: NeedleCalibration | None) -> Iterator[Diagnostic]:
    """The doubt that a needle's length is in mm."""
    if needle is not None:
        start, end = needle.line.segment_mm
        yield from unit_doubt(needle_hints(f"the needle of {tool}", float(np.linalg.norm(end - start))))


def pivot_doubts(recording: Recording) -> list[Diagnostic]:
    """The doubt that a recording of nothing but a pivot is in mm; none of what is no pivot."""
    recording = recording.select(np.arange(0, len(recording), 1 + len(recording) // ENOUGH_POSES))
    for poses in [] if recording.image is not None else recording.poses.values():
        try:
            pivot = calibrate_tool(poses.source, recording, on_invalid="skip")
        except SonocalError:
            continue
        if found := [one for one in pivot.diagnostics if one.code == UNITS_CODE]:
            return found
    return []


def stylus_tip(path: str | Path, stylus: str) -> Array:
    """The tip of a stylus (3,), mm, from a file that `tool_toml` made.

    Raises:
        InputError: the file holds no point of that marker, or several.
    """
    here = [point for point in read_points_toml(path) if point.frame.lower() == stylus.lower()]
    if len(here) != 1:
        raise InputError(
            f"{Path(path).name}: holds {len(here)} points of {stylus}; it must hold its tip, as sonocal tool writes it"
        )
    return here[0].place_mm


def tool_toml(found: ToolCalibration, name: str) -> bytes:
    """What was found as the text of a ``.toml`` file: the needle as a line, a pivot's tip as a point."""
    require("found", found, ToolCalibration)
    lines = [] if found.needle is None else [found.needle.line]
    tips = [point for point in found.points[:1] if isinstance(point, PivotCalibration)]
    points = [Point("tip", found.tool, tip.tip_mm) for tip in tips]
    return lines_toml(
        name, lines, points, [f"mm, in the frame of the marker {found.tool!r}", *_remarks(found)]
    )


def _point(
    part: Recording,
    tool: str,
    *,
    stylus: Stylus | None,
    reference: str | None,
    on_invalid: OnInvalid,
    seed: int,
) -> PivotCalibration | DigitisedPoint:
    if stylus is not None:
        return digitise_point(part.between(tool, stylus.name, None, on_invalid), stylus.tip_mm, on_invalid)
    poses = _poses(part, tool, reference, on_invalid)
    return calibrate_pivot(poses.matrices, poses.valid, seed, part.name)


def _poses(part: Recording, tool: str, reference: str | None, on_invalid: OnInvalid) -> Poses:
    if reference is not None:
        return part.between(reference, tool, None, on_invalid)
    return part.tool(tool).usable(part.name, on_invalid)


def _needle(
    points: tuple[PivotCalibration | DigitisedPoint, ...],
    axis: SpinCalibration | None,
    length_mm: float | None,
    name: str,
    tool: str,
) -> NeedleCalibration | None:
    if len(points) == 2:
        (first, one), (second, other) = (_place(point) for point in points)
        return needle_from_points(first, second, (one, other), name, tool)
    if axis is None:
        return None
    if not points:
        if length_mm is None:
            raise InputError(
                "a spin alone does not tell the needle's length; give it with --length, or pivot it too"
            )
        return needle_from_spin(axis, length_mm, name, tool)
    if isinstance(points[0], DigitisedPoint):
        raise InputError(
            "a touch and a spin make no needle; pivot the tool about its tip, or touch a second point"
        )
    return needle_from_axis(points[0], axis, length_mm, name, tool)


def _place(point: PivotCalibration | DigitisedPoint) -> tuple[Array, Array]:
    if isinstance(point, PivotCalibration):
        return point.tip_mm, point.covariance[:3, :3]
    return point.point_mm, point.covariance


def _remarks(found: ToolCalibration) -> list[str]:
    remarks = [
        f"tip known to +-{point.tip_95_mm:.2g} mm (95 %)"
        for point in found.points[:1]
        if isinstance(point, PivotCalibration)
    ]
    if found.needle is not None:
        remarks.append(f"direction known to +-{1.96 * found.needle.direction_deviation_deg:.2g} deg (95 %)")
    return remarks + [
        f"{one.severity}: {one.message}" for one in found.diagnostics if one.severity == "warning"
    ]
