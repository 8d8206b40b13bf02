"""``sonocal info``: what is in any file that sonocal reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.options import (
    FILE,
    JSON,
    LATENCY,
    POSES,
    console,
    progress,
)
from sonocal.cli.screen.plain import say_json
from sonocal.cli.told import table_doubts, unit_doubts

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.detection import Detections
    from sonocal.files.kinds import Kind
    from sonocal.findings import Diagnostic
    from sonocal.observations import Observations
    from sonocal.targets import DeviceSet, Targets
    from sonocal.validation import PointSightings

__all__ = ["info"]

Shown = tuple[Any, Callable[[], None]]
"""What --json prints, and what prints the rest."""


@click.command(short_help="Show what is in a file, and what is wrong with it.")
@click.argument("file", metavar="FILE", type=FILE)
@POSES
@LATENCY
@click.option(
    "--quick", is_flag=True, help="Of recordings: do not decode the images to look for repeated ones."
)
@JSON
def info(file: Path, poses: Path | None, latency_s: float, *, quick: bool, as_json: bool) -> None:
    """Show what is in a file, and what is wrong with it.

    Recordings, tables of sightings or points, calibrations, needles (.toml), PLUS device sets.
    """
    from sonocal.cli.formats import format_of

    found = format_of(file)
    if found.kind == "recording":
        record, show = _recording(file, poses, latency_s, quick=quick)
    else:
        record, show = _SCREENS[found.kind](file.name, found.read(file))
    if as_json:
        say_json(record)
    else:
        show()


def _recording(file: Path, poses: Path | None, latency_s: float, *, quick: bool) -> Shown:
    from dataclasses import replace

    from sonocal.cli.screen.recording import print_recording
    from sonocal.geometry.units import UNITS_CODE
    from sonocal.recording import summarize
    from sonocal.recording.formats import read_recording
    from sonocal.tools import pivot_doubts

    recording = read_recording(file, poses, latency_s, "skip")
    with progress("looking at images") as report:
        summary = summarize(recording, look_at_images=not quick, progress=report)
    if not any(one.code == UNITS_CODE for one in summary.diagnostics):
        summary = replace(summary, diagnostics=(*pivot_doubts(recording), *summary.diagnostics))
    return summary, lambda: print_recording(console(), summary)


def _calibration(_: str, found: Calibration) -> Shown:
    from sonocal.calibration import calibration_json
    from sonocal.cli.report import json_with_verdict
    from sonocal.cli.screen.calibration import print_calibration

    return json_with_verdict(found, calibration_json(found)), lambda: print_calibration(console(), found)


def _observations(_: str, found: Observations) -> Shown:
    from sonocal.cli.screen.calibration import observation_splits, print_observations

    doubts = table_doubts(found)
    record = [split | {"diagnostics": doubts} for split in observation_splits(found)]
    return record, _doubted(doubts, lambda: print_observations(console(), found))


def _points(_: str, found: Detections) -> Shown:
    from sonocal.cli.screen.recording import print_points

    record = {"frame": found.frame, "points_px": found.points_px[:, 0], "target": found.target.tolist()}
    record |= {"sigma_px": None if found.sigma_px is None else found.sigma_px[:, 0], "source": found.source}
    return record, lambda: print_points(console(), found)


def _known_points(_: str, found: PointSightings) -> Shown:
    from sonocal.cli.screen.validation import print_point_sightings

    return found, lambda: print_point_sightings(console(), found)


def _targets(name: str, found: Targets) -> Shown:
    from sonocal.cli.screen.recording import print_lines, print_tips

    def show() -> None:
        if found.lines:
            print_lines(console(), f"{name}: needles and wires", found.lines)
        if found.points:
            print_tips(console(), f"{name}: points of tools", found.points)

    doubts = unit_doubts(lines=found.lines)
    record = {"lines": found.lines, "points": found.points, "diagnostics": doubts}
    return record, _doubted(doubts, show)


def _device_set(_: str, found: DeviceSet) -> Shown:
    from sonocal.cli.screen.recording import print_device_set

    transforms = {f"{source}To{target}": matrix for (target, source), matrix in found.transforms.items()}
    doubts = unit_doubts(lines=found.wires)
    record = {"name": found.name, "transforms": transforms, "wires": found.wires, "patterns": found.patterns}
    return record | {"diagnostics": doubts}, _doubted(doubts, lambda: print_device_set(console(), found))


def _doubted(doubts: list[Diagnostic], show: Callable[[], None]) -> Callable[[], None]:
    """What prints the doubts first, then the rest."""
    from sonocal.cli.screen.parts import print_findings

    def both() -> None:
        print_findings(console(), doubts)
        show()

    return both


# What shows each kind of file: its name in messages and what its format read.
_SCREENS: dict[Kind, Callable[[str, Any], Shown]] = {
    "calibration": _calibration,
    "device set": _device_set,
    "known points": _known_points,
    "observations": _observations,
    "points": _points,
    "targets": _targets,
}
