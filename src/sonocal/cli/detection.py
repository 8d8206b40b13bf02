"""Commands that make and read images: ``simulate``, ``detect``."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from sonocal.cli.help import DETECTING, READING, command
from sonocal.cli.options import (
    ANGLES,
    CENTRE,
    COUNT,
    FILE,
    INVALID,
    LATENCY,
    LINES,
    MARKERS,
    MASK,
    POSES,
    PROBE,
    WRITTEN,
    output_folder,
    progress,
    seed,
    typed,
)
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.reading import read_given
from sonocal.cli.screen.plain import say
from sonocal.errors import InputError

__all__ = ["COMMANDS"]

OF_NEEDLES = ("dropout_share", "latency_s")


@command(
    "Write a simulated recording and its needle, to try things on.",
    groups={
        "What is simulated": (
            "target",
            "probe",
            "look",
            "frames",
            "rate_hz",
            "hidden_share",
            "overlay",
            "seed",
        ),
        "What is wrong with it": ("sigma_px", "sigma_mm", "dropout_share", "latency_s"),
        "What is written": ("output", "overwrite"),
    },
    examples=(
        "sonocal simulate -o simulated",
        "sonocal simulate --probe linear --look bath --frames 200 -o in-water",
        "sonocal simulate --latency 0.08 --dropouts 0.1 -o with-faults",
        "sonocal simulate --target walls --look bath --frames 120 -o tank",
    ),
)
@output_folder("simulated", "sweep.igs.mha, needle.toml or targets.toml, and truth.json")
@click.option(
    "--target",
    type=click.Choice(["needle", "wall", "walls", "cross-wire", "cross-wires", "wires"]),
    default="needle",
    show_default=True,
    metavar="SCENE",
    help="A needle that is moved; or, fixed in the room, wall (a tank's floor), walls, cross-wire, cross-wires, wires.",
)
@click.option(
    "--probe",
    type=click.Choice(["curvilinear", "linear", "curvilinear-3d"]),
    default="curvilinear",
    show_default=True,
    help="The probe.",
)
@click.option(
    "--look",
    type=click.Choice(["tissue", "bath"]),
    default="tissue",
    show_default=True,
    help="Speckle, or a needle in water at low gain.",
)
@click.option("--frames", type=click.IntRange(1), default=500, show_default=True, help="Images.")
@click.option("--rate", "rate_hz", type=float, default=20.0, show_default=True, help="Images a second.")
@click.option("--sigma-px", type=float, default=1.0, show_default=True, help="Noise of the image point, px.")
@click.option(
    "--sigma-mm", type=float, default=1.0, show_default=True, help="Tracking noise of the needle's ends, mm."
)
@click.option(
    "--hidden",
    "hidden_share",
    type=float,
    default=0.2,
    show_default=True,
    help="Share without a visible needle.",
)
@click.option(
    "--dropouts",
    "dropout_share",
    type=float,
    default=0.0,
    show_default=True,
    help="Share without valid poses.",
)
@click.option(
    "--latency",
    "latency_s",
    type=float,
    default=0.0,
    show_default=True,
    help="Of the tracker behind the images, s.",
)
@click.option(
    "--overlay", is_flag=True, help="Draw text and a ruler over the images, as in a screen capture."
)
@seed("everything random")
@OVERWRITE
def simulate(output: Path, target: str, probe: str, look: str, *, overwrite: bool, **options: Any) -> None:
    """Write a simulated recording with known truth: sweep.igs.mha, needle.toml, truth.json."""
    from sonocal.simulation.sweep import SweepOptions, simulate_sweep
    from sonocal.simulation.sweep_files import SWEEP_FILES, TARGET_FILES, write_sweep, write_targets
    from sonocal.simulation.target_scenes import scene_of
    from sonocal.simulation.target_sweep import TargetOptions, simulate_targets
    from sonocal.simulation.ultrasound import BATH, SMALL_PARTS, SMALL_PARTS_BATH, Look
    from sonocal.simulation.ultrasound_probe import ProbeGeometry, curvilinear, curvilinear_3d, linear

    reserve(*(output / name for name in (SWEEP_FILES if target == "needle" else TARGET_FILES)))
    if target != "needle" and (names := typed(OF_NEEDLES)):
        raise click.UsageError(
            f"{names[0]} is for a needle that is moved; leave it out, or leave out --target"
        )
    probes: dict[str, Callable[[], ProbeGeometry]] = {
        "curvilinear": curvilinear,
        "linear": linear,
        "curvilinear-3d": curvilinear_3d,
    }
    fine, wet = probe == "linear", look == "bath"
    appearance = (SMALL_PARTS_BATH if wet else SMALL_PARTS) if fine else BATH if wet else Look()
    with progress("images") as report:
        if target == "needle":
            sweep = simulate_sweep(probes[probe](), appearance, SweepOptions(**options))
            paths = write_sweep(sweep, output, report)
        else:
            fixed = {name: value for name, value in options.items() if name not in OF_NEEDLES}
            seen = simulate_targets(scene_of(target), probes[probe](), appearance, TargetOptions(**fixed))
            paths = write_targets(seen, output, report)
    say(f"Wrote {', '.join(str(path) for path in paths)}")
    say(f"Next: sonocal calibrate {paths[0]} --{'lines' if target == 'needle' else 'targets'} {paths[1]}")


@command(
    "Find the needle in a recording's images.",
    groups={
        "What is read": ("lines", *READING),
        "How the needle is found": DETECTING,
        "What is written": ("output", "sheet", "overwrite"),
    },
    examples=(
        "sonocal detect sweep.igs.mha --lines needle.toml -o candidates.csv",
        "sonocal detect sweep.igs.mha --lines needle.toml -o few.csv --count 2 --sheet contact-sheet.png",
    ),
)
@click.argument("recording", metavar="RECORDING", type=FILE)
@LINES
@click.option(
    "-o", "--output", type=WRITTEN, default=Path("candidates.csv"), show_default=True, help="Table to write."
)
@click.option("--sheet", type=WRITTEN, help="Contact sheet (PNG) to write.")
@POSES
@ANGLES
@MARKERS
@COUNT
@CENTRE
@MASK
@PROBE
@LATENCY
@INVALID
@OVERWRITE
def detect(
    recording: Path, lines: Path | None, output: Path, sheet: Path | None, *, overwrite: bool, **options: Any
) -> None:
    """Find the needle in a recording's images: several candidates an image, best first, as a table of sightings.

    At most one candidate of an image is right; "sonocal calibrate RECORDING --lines" chooses.
    """
    from sonocal.cli.formats import targets_in
    from sonocal.cli.from_recording import looking_for
    from sonocal.files import write_atomically
    from sonocal.files.png import png
    from sonocal.observations import write_observations
    from sonocal.sweep import Sweep, TargetSweep, sweep_of
    from sonocal.sweep.contact_sheet import contact_sheet
    from sonocal.targets import Unplaced

    if lines is None:
        raise click.UsageError("Missing option '--lines'.")
    files = [output, *([] if sheet is None else [sheet])]
    loaded = read_given(recording, options)
    known, fixed = targets_in(lines)
    if placeless := [one.name for one in known if isinstance(one, Unplaced)]:
        raise InputError(
            f"{lines}: says no place of {placeless[0]!r}, and candidates are tabled against places; "
            '"sonocal calibrate RECORDING --lines" finds it with the calibration'
        )
    reserve(*files)
    posing = {"fixed": fixed} | {name: options[name] for name in ("probe", "on_invalid")}
    sweep = sweep_of(loaded, known, **posing, **looking_for(loaded, options))
    with progress("detecting") as report:
        found: Any = sweep.detect(report)
    reserve(*files)
    if sheet is not None:
        write_atomically(sheet, png(contact_sheet(loaded, found)))
    assert isinstance(sweep, (Sweep, TargetSweep))
    table = sweep.candidates(found)
    write_observations(table, output)
    say(f"Wrote {len(table)} candidates to {output}" + (f" and {sheet}" if sheet else ""))


COMMANDS = [simulate, detect]
