"""``sonocal info``: what is in any file that sonocal reads."""

from __future__ import annotations

from collections.abc import Callable, Container
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.help import command
from sonocal.cli.options import (
    ANGLES,
    FILE,
    JSON,
    LATENCY,
    MARKERS,
    POSES,
    console,
    progress,
    typed,
)
from sonocal.cli.reading import OF_READING, read_given
from sonocal.cli.screen.plain import say_json
from sonocal.cli.told import table_doubts, unit_doubts

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.detection import Detections
    from sonocal.existing import Matrices
    from sonocal.files.kinds import Kind
    from sonocal.findings import Diagnostic
    from sonocal.observations import Observations
    from sonocal.report.page_file import Page
    from sonocal.simulation.truth_file import KnownTruth
    from sonocal.studies.results_file import StudyResults
    from sonocal.targets import DeviceSet, Targets, Unplaced
    from sonocal.validation import CheckLog, PointSightings

__all__ = ["info"]

Shown = tuple[Any, Callable[[], None]]
"""What --json prints, and what prints the rest."""


@command(
    "Show what is in a file, and what is wrong with it.",
    groups={
        "Of recordings": ("poses", "angles", "markers", "latency_s", "quick"),
        "What is shown": ("as_json",),
    },
    examples=(
        "sonocal info sweep.igs.mha",
        "sonocal info calibration.json --json",
        "sonocal info needle.toml",
        "sonocal info - < needle.csv",
    ),
)
@click.argument("file", metavar="FILE", type=FILE)
@POSES
@ANGLES
@MARKERS
@LATENCY
@click.option(
    "--quick", is_flag=True, help="Of recordings: do not decode the images to look for repeated ones."
)
@JSON
def info(file: Path, *, quick: bool, as_json: bool, **reading: Any) -> None:
    """Show what is in a file, and what is wrong with it.

    Recordings, tables of sightings or points, calibrations, needles (.toml), PLUS device sets, matrices of other
    software (.tfm, .h5, a 4 x 4 as text or of NumPy): what they mean. Of what sonocal wrote: pages, the truth of a
    simulation, what a study found, too.
    """
    from sonocal.cli.formats import format_of

    found = format_of(file)
    if found.kind != "recording" and (names := typed((*OF_READING, "quick"))):
        raise click.UsageError(f"{names[0]} is for recordings, and {file.name} is none; leave it out")
    if found.kind == "recording":
        record, show = _recording(file, reading, quick=quick)
    else:
        record, show = _SCREENS[found.kind](file.name, found.read(file))
    if as_json:
        say_json(record)
    else:
        show()


def _recording(file: Path, reading: dict[str, Any], *, quick: bool) -> Shown:
    from dataclasses import replace

    from sonocal.cli.screen.recording import print_recording
    from sonocal.geometry.units import UNITS_CODE
    from sonocal.recording import summarize
    from sonocal.tools import pivot_doubts

    recording = read_given(file, reading | {"on_invalid": "skip"})
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
    from sonocal.observations.outside import outside_findings

    doubts = [*table_doubts(found), *outside_findings(found.points_px, found.image_size_px)]
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
    from sonocal.cli.screen.recording import (
        print_lines,
        print_planes,
        print_tips,
        print_unplaced,
    )

    def show() -> None:
        if found.lines:
            print_lines(console(), f"{name}: needles and wires", found.lines)
        if found.points:
            print_tips(console(), f"{name}: points", found.points)
        if found.planes:
            print_planes(console(), f"{name}: planes", found.planes)
        if found.unplaced:
            print_unplaced(console(), f"{name}: to be found with the calibration", found.unplaced)

    doubts = unit_doubts(lines=found.lines)
    record = {
        "lines": found.lines,
        "points": found.points,
        "planes": found.planes,
        "unplaced": list(map(_unplaced, found.unplaced)),
        "diagnostics": doubts,
    }
    return record, _doubted(doubts, show)


def _unplaced(target: Unplaced) -> dict[str, Any]:
    """Of one whose place is unknown there is no number to tell: JSON knows no infinity."""
    told: dict[str, Any] = {"kind": target.kind, "name": target.name, "frame": target.frame}
    if target.spanning_mm is None:
        return told | {"place": "unknown"}
    return told | {
        "spanning_mm": target.spanning_mm,
        "sigma_mm": target.sigma_mm,
        "sigma_deg": target.sigma_deg,
    }


def _device_set(_: str, found: DeviceSet) -> Shown:
    from sonocal.cli.screen.recording import print_device_set
    from sonocal.existing.plus import matrices_of

    transforms = {f"{source}To{target}": matrix for (target, source), matrix in found.transforms.items()}
    doubts = unit_doubts(lines=found.wires)
    record = {"name": found.name, "transforms": transforms, "wires": found.wires, "patterns": found.patterns}
    meaning, show = (
        ([], None) if not found.transforms else _matrices(found.name, matrices_of(found), shown=transforms)
    )

    def both() -> None:
        print_device_set(console(), found)
        if show is not None:
            show()

    return record | {"calibrations": meaning, "diagnostics": doubts}, _doubted(doubts, both)


def _matrices(_: str, found: Matrices, *, shown: Container[str] = ()) -> Shown:
    """All of a file that may be from an image; what else is known by name is said in a sentence.

    The numbers of those whose names are `shown` are on the screen already.
    """
    from rich.text import Text

    from sonocal.cli.screen.existing import existing_record, print_existing, tip_sentences
    from sonocal.existing.choice import candidates
    from sonocal.existing.meaning import matrix_findings

    each = candidates(found)
    tips = tip_sentences(found)

    def show() -> None:
        for one in each:
            print_existing(console(), one, numbers=one.transform not in shown)
        for sentence in tips:
            console().print(Text(sentence))

    record = [existing_record(one) | {"diagnostics": matrix_findings(one)} for one in each]
    return record or {"tips": tips}, show


def _truth(_: str, found: KnownTruth) -> Shown:
    from sonocal.cli.screen.records import print_truth_file

    return found, lambda: print_truth_file(console(), found)


def _checks(_: str, found: CheckLog) -> Shown:
    from sonocal.cli.screen.check import print_check_log

    return found, lambda: print_check_log(console(), found)


def _page(_: str, found: Page) -> Shown:
    from sonocal.cli.screen.records import print_page

    return found, lambda: print_page(console(), found)


def _study(_: str, found: StudyResults) -> Shown:
    from sonocal.cli.screen.study import print_results

    return found, lambda: print_results(found)


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
    "checks": _checks,
    "device set": _device_set,
    "known points": _known_points,
    "matrix": _matrices,
    "observations": _observations,
    "page": _page,
    "points": _points,
    "study": _study,
    "targets": _targets,
    "truth": _truth,
}
