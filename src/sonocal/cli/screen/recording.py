"""What the command line shows of recordings, tools, needles and device sets."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.console import Console, Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from sonocal.cli.screen.parts import print_findings
from sonocal.cli.screen.tables import MatrixRows, NumberTable
from sonocal.detection import Detections
from sonocal.geometry import Array
from sonocal.observations.image_size import size_in_words
from sonocal.recording import (
    ImageGeometry,
    Summary,
)
from sonocal.targets import (
    DeviceSet,
    Line,
    Plane,
    Point,
    Unplaced,
)
from sonocal.tools import (
    PivotCalibration,
    SpinCalibration,
    ToolCalibration,
)
from sonocal.tools.verdict import verdict_on_tool

__all__ = [
    "print_device_set",
    "print_lines",
    "print_planes",
    "print_points",
    "print_recording",
    "print_tips",
    "print_tool",
    "print_unplaced",
]


STYLES = {"use": "bold green", "care": "bold yellow", "stop": "bold red"}


def print_recording(console: Console, summary: Summary) -> None:
    """Warnings first, then what is in the recording, then the notes."""
    print_findings(console, summary.diagnostics, "warning")
    console.print(Text(f"{summary.name}: {summary.format}", style="bold"))
    console.print(_items(summary))
    console.print(_image(summary.image))
    console.print()
    if summary.tools:
        table = NumberTable("Transforms", "poses", "valid", "lost in a row", "travel, mm", first="name")
        for tool in summary.tools:
            table.add_row(
                tool.name,
                str(tool.poses),
                str(tool.valid),
                str(tool.longest_loss),
                f"{tool.travel_mm:.1f}",
            )
        console.print(table)
    else:
        console.print("No poses: nothing in it was tracked.")
    print_findings(console, summary.diagnostics, "info")


def print_lines(console: Console, title: str, lines: Sequence[Line]) -> None:
    """Needles and wires, with their length."""
    table = NumberTable(title, "frame", "from, mm", "to, mm", "length, mm", first="name")
    for line in lines:
        length = float(np.linalg.norm(line.segment_mm[1] - line.segment_mm[0]))
        table.add_row(line.name, line.frame, *(_place(end) for end in line.segment_mm), f"{length:.1f}")
    console.print(table)


def print_tips(console: Console, title: str, points: Sequence[Point]) -> None:
    """Points of tools, beads, cross-wires."""
    table = NumberTable(title, "frame", "at, mm", first="name")
    for point in points:
        table.add_row(point.name, point.frame, _place(point.place_mm))
    console.print(table)


def print_planes(console: Console, title: str, planes: Sequence[Plane]) -> None:
    """Walls and floors."""
    table = NumberTable(title, "frame", "through, mm", "and", "and", first="name")
    for plane in planes:
        table.add_row(plane.name, plane.frame, *map(_place, plane.points_mm))
    console.print(table)


def print_unplaced(console: Console, title: str, targets: Sequence[Unplaced]) -> None:
    """Targets whose place is unknown, or known roughly."""
    table = NumberTable(title, "what", "frame", "place", first="name")
    for target in targets:
        if target.phantom is not None:
            place = f"unknown, with {target.phantom.frame}"
        elif target.spanning_mm is None:
            place = "unknown"
        else:
            place = f"{_place(target.spanning_mm.mean(axis=0))} +-{target.sigma_mm:g}"
        table.add_row(target.name, target.kind, target.frame, place)
    console.print(table)


def print_device_set(console: Console, devices: DeviceSet) -> None:
    """The transforms and the phantom's wires of a device set."""
    console.print(Text(f"{devices.name}: PLUS device set", style="bold"))
    for (target, source), matrix in devices.transforms.items():
        console.print(_matrix(f"{source}To{target}", matrix))
    if devices.wires:
        print_lines(console, f"{len(devices.patterns)} patterns of wires", devices.wires)
    else:
        console.print("No phantom wires.")


def print_points(console: Console, points: Detections) -> None:
    """What is in a table of points found in images."""
    table = NumberTable(f"{points.source}: points found in images", "points", "images", first="target")
    for target in np.unique(points.target):
        here = points.target == target
        table.add_row(str(target) or "(none)", str(int(here.sum())), str(len(np.unique(points.frame[here]))))
    console.print(table)


def print_tool(console: Console, found: ToolCalibration) -> None:
    """Warnings first, the verdict, then tip, axis and needle, then the notes."""
    print_findings(console, found.diagnostics, "warning")
    console.print(_tool_verdict(found))
    console.print()
    if found.points:
        console.print(_points_table(found))
    if found.spin is not None:
        console.print(_axis_table(found.tool, found.spin))
    if found.needle is not None:
        print_lines(console, "The needle", [found.needle.line])
    print_findings(console, found.diagnostics, "info")


def _tool_verdict(found: ToolCalibration) -> Text:
    level, sentence = verdict_on_tool(found)
    return Text(sentence, style=STYLES[level])


def _points_table(found: ToolCalibration) -> NumberTable:
    columns = ("x", "y", "z", "+- (95 %)", "rms", "tilt, deg", "frames used")
    table = NumberTable(f"Points in {found.tool}'s frame, mm", *columns)
    for order, point in zip(("first", "second"), found.points, strict=False):
        name = order
        if isinstance(point, PivotCalibration):
            place, rms, used = point.tip_mm, point.rms_mm, f"{point.inlier.sum()} of {len(point.inlier)}"
            trust = (f"{point.tip_95_mm:.2f}", f"{rms:.2f}", f"{point.spread_deg:.1f}", used)
            name = "tip" if order == "first" else "second tip"
        else:
            place, rms = point.point_mm, float(np.sqrt(np.trace(point.covariance)))
            trust = ("", f"{rms:.2f}", "", str(point.samples))
        table.add_row(name, *(f"{x:.2f}" for x in place), *trust)
    return table


def _axis_table(tool: str, spin: SpinCalibration) -> NumberTable:
    table = NumberTable(f"Axis in {tool}'s frame", "x", "y", "z", "turn, deg", "wobble", "frames used")
    used = f"{spin.inlier.sum()} of {len(spin.inlier)}"
    turn = (f"{spin.turn_deg:.0f}", f"{spin.wobble_deg:.2f} deg", used)
    table.add_row("direction", *(f"{x:.4f}" for x in spin.direction), *turn)
    table.add_row("point, mm", *(f"{x:.2f}" for x in spin.point_mm), "", f"{spin.wobble_mm:.2f} mm", "")
    return table


def _items(summary: Summary) -> str:
    items = f"{summary.items} item" + ("s" if summary.items != 1 else "")
    if summary.duration_s is None:
        return f"{items}, without time stamps"
    return f"{items} over {summary.duration_s:.1f} s, {summary.rate_hz or 0:.1f} a second"


def _image(image: ImageGeometry | None) -> str:
    if image is None:
        return "No images: a tracker alone."
    size = size_in_words(image.size_px)
    kind = "grey" if image.channels == 1 else f"{image.channels} channels"
    stored = image.orientation or "not stated"
    turned = "" if np.array_equal(image.image_from_file, np.eye(4)) else "; flipped to MF on reading"
    spacing = (
        "mm/px not stated"
        if image.spacing_mm is None
        else " x ".join(f"{s:.5g}" for s in image.spacing_mm) + " mm/px stated"
    )
    what = "Images" if image.dimension == 2 else "Volumes"
    return f"{what}: {size} px, {image.dtype}, {kind}, orientation {stored}{turned}, {spacing}"


def _matrix(name: str, matrix: Array) -> RenderableType:
    return Group(Text(name, style="bold"), Padding(MatrixRows(matrix), (0, 0, 1, 2), expand=False))


def _place(place: Array) -> str:
    return ", ".join(f"{x:.2f}" for x in place)
