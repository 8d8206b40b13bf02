"""The part of ``sonocal calibrate`` that starts from a recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from sonocal.cli.options import (
    progress,
    typed,
)
from sonocal.errors import InputError, SonocalError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.detection import Candidates, LineCandidates
    from sonocal.observations import Observations
    from sonocal.recording import Recording
    from sonocal.targets import Line

__all__ = [
    "OF_DETECTION",
    "Result",
    "from_recording",
]

TABLE, SHEET = "observations.csv", "contact-sheet.png"
OF_DETECTION = ("count", "centre", "mask")


class Result(NamedTuple):
    """A calibration, the rows it rests on, and what is written beside it."""

    rows: Observations
    calibration: Calibration
    files: dict[str, bytes]
    recording: Recording | None = None


def from_recording(
    source: Path, lines: Path, output: Path, recorded: dict[str, Any], options: dict[str, Any]
) -> Result:
    """Calibrate from a recording.

    Args:
        source: the recording.
        lines: the needle or wires.
        output: where the contact sheet stays if no calibration is found.
        recorded: options of recordings and of detection.
        options: of `sonocal.calibrate`.
    """
    from sonocal.cli.formats import kind_of
    from sonocal.observations import observations_csv, parse_observations
    from sonocal.recording.formats import read_recording
    from sonocal.targets import read_lines

    if kind_of(source) == "observations":
        raise InputError(
            f"{source.name}: is a table of sightings, which has its lines in it; leave out --lines"
        )
    points, poses = recorded["points"], recorded["poses"]
    moved = (recorded["latency_s"], recorded["on_invalid"])
    recording, (known, fixed) = read_recording(source, poses, *moved), read_lines(lines)
    options = {name: value for name, value in options.items() if value is not None} | {"fixed": fixed}
    options |= {name: recorded[name] for name in ("probe", "on_invalid")}
    if points is not None:
        result = _given(recording, known, points, options)
    else:
        result = _detected(recording, known, output, recorded, options)
    table = observations_csv(result.rows)
    rows = parse_observations(table, TABLE)  # as validation will read it: with its name and digest
    inputs = {
        "recording": source,
        "lines": lines,
        **{name: recorded.pop(name) for name in ("points", "poses", "mask")},
    }
    found = _with_provenance(result.calibration, rows, inputs, recorded)
    return Result(rows, found, {TABLE: table, **result.files}, recording)


def _given(recording: Recording, lines: Sequence[Line], points: Path, options: dict[str, Any]) -> Result:
    """Calibrate on the points of a table."""
    from sonocal.sweep import calibrate_points, read_detections

    found, rows = calibrate_points(recording, lines, read_detections(points), **options)
    return Result(rows, found, {})


def _detected(
    recording: Recording,
    lines: Sequence[Line],
    output: Path,
    recorded: dict[str, Any],
    options: dict[str, Any],
) -> Result:
    """Find the needle in the images, and calibrate on the candidates that agree."""
    from sonocal.sweep import calibrate_recording

    sheet = _Sheet(recording, output)
    for name in ("threshold_mm", "weighting"):
        if not typed((name,)):
            options.pop(name)  # lines that are close to one another ask for less; volumes for equal weights
    with progress("detecting") as report:
        options |= sheet.detect(recorded, report)
        try:
            found = calibrate_recording(recording, lines, **options)
        except SonocalError:
            sheet.write()
            raise
    rows = found.observations
    return Result(rows, found.calibration, {SHEET: sheet.png(rows)})


def _of_volumes(recording: Recording, recorded: dict[str, Any]) -> dict[str, Any]:
    """The detection options of 3D probes."""
    if names := typed(("mask", "centre")):
        raise InputError(
            f"{recording.name}: has no 2D images; lines in volumes are found without {names[0]}, leave it out"
        )
    return {"count": recorded["count"]} if typed(("count",)) else {}


class _Sheet:
    """The candidates of a recording's images, and the sheet that shows them."""

    def __init__(self, recording: Recording, output: Path) -> None:
        self._recording, self._output = recording, output

    def detect(self, recorded: dict[str, Any], report: Any) -> dict[str, Any]:
        """Find candidates: the arguments of `calibrate_recording` that come of it."""
        from sonocal.detection import detect_points, detect_volumes, find_mask, read_mask
        from sonocal.sweep.calibrate import require_images

        require_images(self._recording)
        self._candidates: Candidates | LineCandidates
        if self._recording.image is not None and self._recording.image.dimension == 3:
            count = _of_volumes(self._recording, recorded)
            self._candidates = detect_volumes(self._recording, progress=report, **count)
            return {"candidates": self._candidates}
        mask = (
            find_mask(self._recording.frames, name=self._recording.name)
            if recorded["mask"] is None
            else read_mask(recorded["mask"], self._recording.frames.shape[:2])
        )
        how = {name: recorded[name] for name in ("count", "centre")} | {"mask": mask}
        self._candidates = detect_points(self._recording, progress=report, **how)
        return how | {"candidates": self._candidates}

    def png(self, rows: Observations | None = None) -> bytes:
        """The sheet, with the chosen candidates marked where there are any."""
        from sonocal.files.png import png
        from sonocal.sweep.contact_sheet import contact_sheet

        chosen = None if rows is None else (rows.frame, rows.points_px)
        return png(contact_sheet(self._recording, self._candidates, chosen))

    def write(self) -> None:
        """The sheet alone, for a look at what stood in the way of a calibration."""
        from sonocal.files import write_into_folder

        write_into_folder(self._output, {SHEET: self.png()})
        click.echo(f"Note: {self._output / SHEET} shows the candidates", err=True)


def _with_provenance(
    found: Calibration, rows: Observations, inputs: Mapping[str, Path | None], recorded: dict[str, Any]
) -> Calibration:
    from sonocal.files import digest

    provenance = found.provenance | {
        "input": rows.source,
        "sha256": rows.sha256,
        "recorded": {
            name: {"input": path.name, "sha256": digest(path)}
            for name, path in inputs.items()
            if path is not None
        },
    }
    unused = OF_DETECTION if "points" in provenance["recorded"] else ()
    options = {name: value for name, value in recorded.items() if name not in unused}
    provenance["options"] = provenance["options"] | options
    return replace(found, provenance=provenance, latency_s=recorded["latency_s"] or None)
