"""``sonocal info``: what is in any file that sonocal reads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from sonocal.cli.options import (
    FILE,
    JSON,
    LATENCY,
    POSES,
    console,
    progress,
)
from sonocal.errors import InputError

__all__ = ["info"]

Shown = tuple[Any, Callable[[], None]]
"""What --json prints, and what prints the rest."""


@click.command()
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
    from sonocal.files.kinds import kind_of

    kind = kind_of(file)
    if kind == "recording":
        record, show = _recording(file, poses, latency_s, quick=quick)
    else:
        record, show = _READERS[kind](file)
    if as_json:
        import msgspec

        encoded = msgspec.json.encode(record, enc_hook=lambda array: array.tolist())
        click.echo(msgspec.json.format(encoded, indent=1).decode())
    else:
        show()


def _recording(file: Path, poses: Path | None, latency_s: float, *, quick: bool) -> Shown:
    from sonocal.cli.screen.recording import print_recording
    from sonocal.recording import summarize
    from sonocal.recording.formats import read_recording

    recording = read_recording(file, poses, latency_s, "skip")
    with progress("looking at images") as report:
        summary = summarize(recording, look_at_images=not quick, progress=report)
    return summary, lambda: print_recording(console(), summary)


def _calibration(file: Path) -> Shown:
    import msgspec

    from sonocal.calibration import (
        calibration_json,
        load_calibration,
    )
    from sonocal.cli.screen.calibration import print_calibration

    found = load_calibration(file)
    return msgspec.Raw(calibration_json(found)), lambda: print_calibration(console(), found)


def _observations(file: Path) -> Shown:
    from sonocal.cli.screen.calibration import (
        observation_splits,
        print_observations,
    )
    from sonocal.observations import read_observations

    found = read_observations(file)
    return observation_splits(found), lambda: print_observations(console(), found)


def _unknown_table(file: Path) -> Shown:
    raise InputError(
        f"{file.name}: is text that sonocal does not know; it reads tables of sightings (with x0_mm ... z1_mm), points "
        "(u_px, v_px) and poses (Probe_qw, ...), recordings, calibrations, needles (.toml) and PLUS device sets"
    )


def _points(file: Path) -> Shown:
    from sonocal.cli.screen.recording import print_points
    from sonocal.detection import read_detections

    found = read_detections(file)
    record = {"frame": found.frame, "points_px": found.points_px[:, 0], "target": found.target.tolist()}
    record |= {"sigma_px": None if found.sigma_px is None else found.sigma_px[:, 0], "source": found.source}
    return record, lambda: print_points(console(), found)


def _known_points(file: Path) -> Shown:
    from sonocal.cli.screen.validation import print_point_sightings
    from sonocal.validation import read_point_sightings

    found = read_point_sightings(file)
    return found, lambda: print_point_sightings(console(), found)


def _lines(file: Path) -> Shown:
    from sonocal.cli.screen.recording import (
        print_lines,
        print_tips,
    )
    from sonocal.targets import (
        read_lines,
        read_points_toml,
    )

    tips = read_points_toml(file)
    lines = () if tips and b"[[line]]" not in file.read_bytes() else read_lines(file)[0]

    def show() -> None:
        if lines:
            print_lines(console(), f"{file.name}: needles and wires", lines)
        if tips:
            print_tips(console(), f"{file.name}: points of tools", tips)

    return {"lines": lines, "points": tips}, show


def _device_set(file: Path) -> Shown:
    from sonocal.cli.screen.recording import print_device_set
    from sonocal.targets import read_device_set

    found = read_device_set(file)
    transforms = {f"{source}To{target}": matrix for (target, source), matrix in found.transforms.items()}
    record = {"name": found.name, "transforms": transforms, "wires": found.wires, "patterns": found.patterns}
    return record, lambda: print_device_set(console(), found)


_READERS: dict[str, Callable[[Path], Shown]] = {
    "calibration": _calibration,
    "device set": _device_set,
    "known points": _known_points,
    "lines": _lines,
    "observations": _observations,
    "points": _points,
    "table": _unknown_table,
}
