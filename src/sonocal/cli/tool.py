"""``sonocal tool``: a tip by pivoting, an axis by spinning, and the needle that follows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.help import command
from sonocal.cli.landmarks import OF_LANDMARKS, place_phantom
from sonocal.cli.options import (
    ANGLES,
    FILE,
    INVALID,
    JSON,
    MARKERS,
    WRITTEN,
    console,
    seed,
)
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.reading import read_given
from sonocal.cli.screen.plain import say, say_json
from sonocal.cli.stepper import find_stepper
from sonocal.cli.tips import expected_tip, place_of_tip
from sonocal.cli.told import ACCEPT_UNITS, refuse_units
from sonocal.cli.tool_session import OF_SESSIONS, read_session
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.recording import Recording
    from sonocal.tools import Stylus, ToolCalibration

__all__ = ["OF_OTHER_TOOLS", "found_tool", "tool"]


OF_OTHER_TOOLS = (
    *("recording", "output", "landmarks", "session", "expected", "overwrite", "accept_units", "as_json"),
    *("page", "stepper", *OF_LANDMARKS),
)
"""Parameters that say nothing of what one tool's recordings are."""


class _Range(click.ParamType[slice]):
    """FIRST:LAST, both included."""

    name = "FIRST:LAST"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> slice:
        first, colon, last = str(value).partition(":")
        if not colon or not all(part.isdigit() or not part for part in (first, last)):
            self.fail(f"{value!r} is not a range of frames such as 0:250", param, ctx)
        return slice(int(first) if first else None, int(last) + 1 if last else None)


class _Place(click.ParamType["tuple[float, ...] | Path"]):
    """X,Y,Z in mm, or a file with the place: of ``sonocal tool``, PLUS, 3D Slicer."""

    name = "FILE|X,Y,Z"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[float, ...] | Path:
        parts = str(value).split(",")
        if len(parts) != 3:
            return Path(value)
        try:
            return tuple(float(part) for part in parts)
        except ValueError:
            self.fail(f"{value!r} is neither three numbers in mm nor a file", param, ctx)


@command(
    "Find where a tool's tip and shaft are in its marker's frame.",
    groups={
        "What was recorded": (
            *("tool_name", "spin", "second", "frames", "spin_frames", "second_frames", "reference"),
            *("angles", "markers", "on_invalid"),
        ),
        "A long recording": ("session", *OF_SESSIONS),
        "A stepper": ("stepper",),
        "A phantom's place": ("landmarks", *OF_LANDMARKS),
        "What is known of the tool": ("length_mm", "stylus", "stylus_tip", "expected", "accept_units"),
        "What is written and shown": ("output", "name", "seed", "overwrite", "as_json"),
    },
    examples=(
        "sonocal tool pivot.igs.mha --tool Needle -o tip.toml",
        "sonocal tool pivot.igs.mha --spin spin.igs.mha --tool Needle -o found.toml",
        "sonocal tool touch.igs.mha --frames 0:60 --second-frames 70:139 --tool Needle --stylus Stylus "
        "--stylus-tip stylus.toml -o touched.toml",
        "sonocal tool turned.igs.mha --stepper moved.igs.mha --tool Probe",
        "sonocal tool session.igs.mha --session --page session.html -o found.toml",
        "sonocal tool touches.igs.mha --landmarks phantom.xml --stylus Stylus -o registered.xml",
        "sonocal tool drags.igs.mha --landmarks block.toml --dragged all --stylus-tip 12,-4,-110 -o placed.toml",
    ),
)
@click.argument("recording", metavar="[RECORDING]", type=FILE, required=False)
@click.option(
    "--tool", "tool_name", default="Needle", show_default=True, help="What the tool's marker is called."
)
@click.option("-o", "--output", type=WRITTEN, help="File (.toml) to write.")
@click.option("--spin", type=FILE, help="Recording of the tool spun about its shaft.")
@click.option(
    "--second", type=FILE, help="Recording of a pivot about, or touch of, a second point of the needle."
)
@click.option("--frames", type=_Range(), help="Frames of RECORDING to use.  [default: all]")
@click.option(
    "--spin-frames", type=_Range(), help="Frames of the spin; of RECORDING, if --spin is not given."
)
@click.option(
    "--second-frames", type=_Range(), help="Frames of the second point; of RECORDING without --second."
)
@click.option(
    "--length",
    "length_mm",
    type=click.FloatRange(0, min_open=True),
    help="Of the shaft from its tip, mm.  [default: to beside the marker]",
)
@click.option("--stylus", help="Marker of a stylus that touches the tool: RECORDING is a touch, not a pivot.")
@click.option("--stylus-tip", type=_Place(), help="Where the stylus' tip is in its marker's frame.")
@click.option(
    "--expected",
    type=_Place(),
    help="Where the tip was said to be: of an earlier one, of PLUS or 3D Slicer, to compare.",
)
@click.option("--reference", help="Marker that the divot is fixed to.  [default: the tracker]")
@click.option(
    "--session",
    is_flag=True,
    help="RECORDING is long and of any tools: find pivots, spins, touches and stillness in it.",
)
@click.option(
    "--stepper",
    type=FILE,
    help="Recording of a probe that a stepper moves along; RECORDING is of the probe that it turns, --tool its marker.",
)
@click.option("--page", type=WRITTEN, help="Page (.html) with the time line of --session.")
@click.option(
    "--landmarks",
    type=FILE,
    help="A phantom, PLUS's (.xml) or ours (.toml with a [[point]] each), whose landmarks RECORDING's stylus touches.",
)
@click.option(
    "--into", type=FILE, help="Device set to put the phantom's place into.  [default: of the landmarks]"
)
@click.option(
    "--dragged",
    multiple=True,
    metavar="NAME",
    help="Line or plane of the phantom that the stylus was dragged along, each with an option of its own; or: all.",
)
@click.option(
    "--in-order",
    is_flag=True,
    help="Landmarks were touched in the order listed, and lines and planes dragged along in the order named.",
)
@click.option("--name", default="needle", show_default=True, help="What detections call the needle.")
@ANGLES
@MARKERS
@INVALID
@ACCEPT_UNITS
@seed("the random triples of poses")
@OVERWRITE
@JSON
def tool(
    recording: Path | None,
    *,
    output: Path | None,
    landmarks: Path | None,
    session: bool,
    stepper: Path | None,
    expected: tuple[float, ...] | Path | None,
    overwrite: bool,
    accept_units: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Calibrate a tracked tool: where its tip and its shaft are in its marker's frame.

    \b
    RECORDING                          a pivot about the resting tip: the tip
    --spin SPIN                        the tool spun about its shaft: the axis
    RECORDING --spin SPIN              both: the needle, from its tip
    RECORDING --second OTHER           two pivots: the needle through both points
    RECORDING --second OTHER --stylus  two touches with a calibrated stylus
    RECORDING --stepper OTHER          a stepper's axes: it turns a probe in the one, moves it along in the other
    RECORDING --session                a long recording of any tools: what each did, its tip and its needle
    RECORDING --landmarks PHANTOM      a phantom's place: its landmarks touched with a stylus, in any order
              --dragged NAME           and lines and planes of it that the stylus was dragged along

    A needle is written as a [[line]], which "sonocal calibrate --lines" reads; a tip alone as a [[point]].

    With a sweep of the needle at hand none of this is needed: a [[line]] with place = "unknown" is found with the
    calibration of the probe.
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.cli.screen.recording import print_tool
    from sonocal.files import write_atomically
    from sonocal.tools import tool_toml

    if session:
        _refuse_half_a_stylus(options)
        options |= {"accept_units": accept_units}
        read_session(_touched(recording, options), output, options, as_json=as_json)
        return
    if stepper is not None:
        along = read_given(stepper, {name: options[name] for name in ("angles", "markers")})
        how = options | {"accept_units": accept_units}
        find_stepper(_touched(recording, how), along, options["tool_name"], how, as_json=as_json)
        return
    if (page := options.pop("page")) is not None:
        raise click.UsageError(f"--page {page} is for --session, which is missing")
    if landmarks is not None:
        options |= {"expected": expected, "accept_units": accept_units}
        place_phantom(_touched(recording, options), landmarks, output, options, as_json=as_json)
        return
    _refuse_landmarks(options)
    _refuse_half_a_stylus(options)
    found = found_tool(recording, options, output, accept_units=accept_units)
    compared = None if expected is None else expected_tip(found, expected)
    if output is not None:
        reserve(output)
        write_atomically(output, tool_toml(found, str(output)))
    if as_json:
        say_json(found if compared is None else {"tool": found, "expected": compared})
        return
    print_tool(console(), found)
    if compared is not None:
        console().print(compared.sentence, markup=False)
    if output is not None:
        say(f"Wrote {output}")


def found_tool(
    recording: Path | None, options: dict[str, Any], output: Path | None = None, *, accept_units: bool
) -> ToolCalibration:
    """What recordings, or ranges of frames of one, say of one tool.

    Args:
        recording: of a pivot, or a touch.
        options: of the command that are of one tool.
        output: is reserved once the recordings are read; None: nothing is written.
        accept_units: that implausible units are meant.
    """
    from sonocal.tools import calibrate_tool

    options |= _parts(recording, options)
    reserve(*([] if output is None else [output]))
    options["stylus"] = _stylus(options["stylus"], options.pop("stylus_tip"))
    found = calibrate_tool(options.pop("tool_name"), **options)
    source = next(part.name for name in ("first", "spin") if (part := options.get(name)) is not None)
    refuse_units(source, found.diagnostics, accepted=accept_units)
    return found


def _touched(recording: Path | None, options: dict[str, Any]) -> Recording:
    """The recording of a stylus, or its range of frames."""
    if recording is None:
        raise click.UsageError("Missing argument 'RECORDING'; give it.")
    read = read_given(recording, {name: options.pop(name) for name in ("angles", "markers")})
    return read if options["frames"] is None else _cut(read, options["frames"])


def _refuse_landmarks(options: dict[str, Any]) -> None:
    for name in OF_LANDMARKS:
        if options.pop(name):
            raise click.UsageError(f"--{name.replace('_', '-')} is for --landmarks, which is missing")


def _refuse_half_a_stylus(options: dict[str, Any]) -> None:
    if (options["stylus"] is None) != (options["stylus_tip"] is None):
        raise click.UsageError("--stylus and --stylus-tip go together: the marker, and the tip in its frame")


def _parts(recording: Path | None, options: dict[str, Any]) -> dict[str, Recording]:
    """What was recorded of the tool: each a file, or a range of frames of RECORDING."""
    reading = {name: options.pop(name) for name in ("angles", "markers")}
    files = {"first": recording, "second": options.pop("second"), "spin": options.pop("spin")}
    ranges = {"first": options.pop("frames")}
    ranges |= {name: options.pop(f"{name}_frames") for name in ("second", "spin")}
    if not any(files.values()):
        raise click.UsageError("Missing argument 'RECORDING'; give it, or --spin.")
    read = {path: read_given(path, reading) for path in files.values() if path is not None}
    parts = {}
    for name, path in files.items():
        source = path or (recording if ranges[name] is not None else None)
        if source is not None:
            parts[name] = _cut(read[source], ranges[name])
    return parts


def _cut(recording: Recording, frames: slice | None) -> Recording:
    rows = range(len(recording))[frames or slice(None)]
    if not rows:
        raise InputError(
            f"{recording.name}: has frames 0 to {len(recording) - 1}, none of which is in the range given"
        )
    return recording.select(rows)


def _stylus(name: str | None, tip: tuple[float, ...] | Path | None) -> Stylus | None:
    from sonocal.tools import Stylus

    return None if name is None or tip is None else Stylus(name, place_of_tip(tip, name))
