"""The part of ``sonocal calibrate`` that starts from a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from sonocal.cli.options import (
    given,
    progress,
    typed,
)
from sonocal.cli.outputs import reserve
from sonocal.cli.reading import read_given
from sonocal.cli.screen.plain import say
from sonocal.cli.told import refuse_units, unit_doubts
from sonocal.errors import InputError, SonocalError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration, LabelledDots
    from sonocal.geometry import AxisScaled
    from sonocal.observations import Observations
    from sonocal.recording import Recording
    from sonocal.targets import Target, Unplaced

__all__ = [
    "OF_DETECTION",
    "SHEET",
    "TABLE",
    "Given",
    "Result",
    "at_lag",
    "at_places",
    "from_recording",
    "given_recording",
    "looking_for",
]

TABLE, SHEET, REFUSED_SHEET = "observations.csv", "contact-sheet.png", "refused-contact-sheet.png"
OF_DETECTION, FILES = ("count", "centre", "mask"), ("points", "poses", "markers", "mask")
BY_DATA = ("threshold_mm", "weighting")
"""Left to what suits lines and images, unless asked for: lines that are close to one another ask for less."""


class Result(NamedTuple):
    """A calibration, the rows it rests on, and what is written beside it."""

    rows: Observations
    calibration: Calibration
    files: dict[str, bytes]
    recording: Recording | None = None
    labels: LabelledDots | None = None


class Given(NamedTuple):
    """A recording and its targets as the command line names them, read and found sound.

    Attributes:
        recording: images and poses.
        targets: what is scanned.
        fixed: constant transforms beside the recording's.
        fitting, looking: options of `calibrate_points` and of `calibrate_recording`.
    """

    recording: Recording
    targets: Sequence[Target | Unplaced]
    fixed: Mapping[tuple[str, str], Any]
    fitting: dict[str, Any]
    looking: dict[str, Any]


def given_recording(source: Path, lines: Path, recorded: dict[str, Any], options: dict[str, Any]) -> Given:
    """Read a recording and its targets. The arguments are as of `from_recording`."""
    from sonocal.cli.formats import targets_in
    from sonocal.targets import Line

    recording = read_given(source, recorded)
    known, fixed = targets_in(lines)
    refuse_units(source.name, unit_doubts(recording), accepted=recorded["accept_units"])
    needles = [one for one in known if isinstance(one, Line)]
    refuse_units(lines.name, unit_doubts(lines=needles), accepted=recorded["accept_units"])
    how = options | {"fixed": fixed} | {name: recorded[name] for name in ("probe", "on_invalid")}
    by_data = {name: value for name, value in how.items() if name not in BY_DATA} | given(BY_DATA, options)
    looking = by_data if recorded["points"] is not None else by_data | looking_for(recording, recorded)
    return Given(recording, known, fixed, how, looking)


def from_recording(
    source: Path,
    lines: Path,
    output: Path | None,
    recorded: dict[str, Any],
    options: dict[str, Any],
    *,
    start: AxisScaled | None = None,
    seen: Any = None,
) -> Result:
    """Calibrate from a recording.

    Args:
        source: the recording.
        lines: the needle or wires.
        output: where the contact sheet stays if no calibration is found; nowhere if None.
        recorded: options of recordings and of detection.
        options: of `sonocal.calibrate`.
        start: a transform that may be near, by which candidates may be chosen.
        seen: what was detected in its images, where that is known.
    """
    from sonocal.observations.table_file import as_file
    from sonocal.recording import with_latency
    from sonocal.sweep import Posing
    from sonocal.sweep.lagged import with_line_velocities
    from sonocal.sweep.own_places import target_at
    from sonocal.targets import Line, Unplaced

    read = given_recording(source, lines, recorded, options)
    recording = read.recording
    if recorded["points"] is not None:
        result = _from_points(recording, read.targets, recorded["points"], read.fitting)
    else:
        result = _from_images(recording, read.targets, output, read.looking, start, seen=seen)
    if recording.latency_s != (result.calibration.latency_s or 0.0):  # estimated
        recording = with_latency(recording, result.calibration.latency_s or 0.0)
    posing = Posing(recorded["probe"], read.fixed, recorded["on_invalid"])
    places = result.calibration.targets
    seen_or_known = [one for one in read.targets if one.name in places or not isinstance(one, Unplaced)]
    there = [target_at(one, result.calibration) for one in seen_or_known]
    needles = [one for one in there if isinstance(one, Line)]
    rows = (
        with_line_velocities(result.rows, recording, needles, posing)
        if result.rows.lines_only
        else result.rows
    )
    table, rows = as_file(rows, TABLE)
    found = _with_provenance(result.calibration, rows, {"recording": source, "lines": lines}, recorded)
    return Result(rows, found, {TABLE: table, **result.files}, recording, result.labels)


def at_lag(rows: Observations, found: Calibration) -> Result:
    """A calibration of a table under a lag, with the table whose lines are where that leads."""
    from sonocal.calibration.lagged import rows_at_lag

    assert found.latency_s is not None
    return _moved(rows, found, rows_at_lag(rows, found.latency_s))


def at_places(rows: Observations, found: Calibration) -> Result:
    """A calibration of a table that found its targets' places, with the table whose targets are there."""
    from sonocal.calibration import placed_by

    return _moved(rows, found, placed_by(found, rows))


def _moved(rows: Observations, found: Calibration, there: Observations) -> Result:
    from sonocal.observations.table_file import as_file

    table, moved = as_file(there, TABLE)
    recorded = {"recorded": {"table": {"input": rows.source, "sha256": rows.sha256}}}
    provenance = found.provenance | {"input": moved.source, "sha256": moved.sha256} | recorded
    return Result(moved, replace(found, provenance=provenance), {TABLE: table})


def looking_for(recording: Recording, options: Mapping[str, Any]) -> dict[str, Any]:
    """The options of detection that stand on the command line, with the mask read."""
    from sonocal.detection import read_mask
    from sonocal.detection.recordings import require_images

    asked, image = given(OF_DETECTION, options), require_images(recording)
    if image.dimension == 3 and (names := typed(("mask", "centre"))):
        raise InputError(
            f"{recording.name}: has no 2D images; lines in volumes are found without {names[0]}, leave it out"
        )
    return asked | ({"mask": read_mask(asked["mask"], recording.frames.shape[:2])} if "mask" in asked else {})


def _from_points(
    recording: Recording, lines: Sequence[Target | Unplaced], points: Path, how: dict[str, Any]
) -> Result:
    """Calibrate on the points of a table."""
    from sonocal.detection import read_detections
    from sonocal.sweep import calibrate_points

    found, rows = calibrate_points(recording, lines, read_detections(points), **how)
    return Result(rows, found, {})


def _from_images(
    recording: Recording,
    targets: Sequence[Target | Unplaced],
    output: Path | None,
    how: dict[str, Any],
    start: AxisScaled | None,
    *,
    seen: Any = None,
) -> Result:
    """Find what is scanned in the images, and calibrate on the candidates that agree; a sheet shows all of them."""
    from sonocal.files.png import png
    from sonocal.sweep.contact_sheet import contact_sheet
    from sonocal.sweep.recordings import sweep_of

    sweep = sweep_of(recording, targets, **how)
    if seen is None:
        with progress("detecting") as report:
            seen = sweep.detect(report)
    try:
        found = sweep.calibrate(seen, start)
    except SonocalError:
        if output is not None:
            _show_candidates(output, png(contact_sheet(recording, seen)))
        raise
    sheet = png(contact_sheet(recording, seen, found.observations))
    return Result(found.observations, found.calibration, {SHEET: sheet}, labels=found.labels)


def _show_candidates(output: Path, sheet: bytes) -> None:
    """Where no calibration was found: a sheet of what there was to choose from, beside no other run's calibration."""
    from sonocal.files import write_into_folder

    name = REFUSED_SHEET if (output / "calibration.json").exists() else SHEET
    reserve(output / name, replaced=name == REFUSED_SHEET)
    write_into_folder(output, {name: sheet})
    say(f"Note: {output / name} shows the candidates", err=True)


def _with_provenance(
    found: Calibration, rows: Observations, inputs: Mapping[str, Path], recorded: dict[str, Any]
) -> Calibration:
    """The calibration with what it came from: files with their digests, and the options of the recording."""
    from sonocal.files import digest

    files = {**inputs}
    for name in FILES:
        given_files = recorded[name] if name == "poses" else (recorded[name],)
        # The first keeps the option's name: a calibration from one file says "poses", as it always did.
        files |= {
            f"{name} {i}" if i > 1 else name: path
            for i, path in enumerate(given_files, 1)
            if path is not None
        }
    unused = OF_DETECTION if "points" in files else ()
    options = {
        name: value for name, value in recorded.items() if name not in (*FILES, *unused, "accept_units")
    }
    provenance = found.provenance | {
        "input": rows.source,
        "sha256": rows.sha256,
        "recorded": {name: {"input": path.name, "sha256": digest(path)} for name, path in files.items()},
        "options": found.provenance["options"] | options,
    }
    return replace(found, provenance=provenance)
