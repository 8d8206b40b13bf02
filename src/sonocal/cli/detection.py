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
)
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.reading import read_given
from sonocal.cli.screen.plain import say

__all__ = ["COMMANDS"]


@command(
    "Write a simulated recording and its needle, to try things on.",
    groups={
        "What is simulated": ("probe", "look", "frames", "rate_hz", "hidden_share", "overlay", "seed"),
        "What is wrong with it": ("sigma_px", "sigma_mm", "dropout_share", "latency_s"),
        "What is written": ("output", "overwrite"),
    },
    examples=(
        "sonocal simulate -o simulated",
        "sonocal simulate --probe linear --look bath --frames 200 -o in-water",
        "sonocal simulate --latency 0.08 --dropouts 0.1 -o with-faults",
    ),
)
@output_folder("simulated", "sweep.igs.mha, needle.toml and truth.json")
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
def simulate(output: Path, probe: str, look: str, *, overwrite: bool, **options: Any) -> None:
    """Write a simulated recording with known truth: sweep.igs.mha, needle.toml, truth.json."""
    from sonocal.simulation.sweep import SweepOptions, simulate_sweep
    from sonocal.simulation.sweep_files import SWEEP_FILES, write_sweep
    from sonocal.simulation.ultrasound import BATH, SMALL_PARTS, SMALL_PARTS_BATH, Look
    from sonocal.simulation.ultrasound_probe import ProbeGeometry, curvilinear, curvilinear_3d, linear

    reserve(*(output / name for name in SWEEP_FILES))
    probes: dict[str, Callable[[], ProbeGeometry]] = {
        "curvilinear": curvilinear,
        "linear": linear,
        "curvilinear-3d": curvilinear_3d,
    }
    fine, wet = probe == "linear", look == "bath"
    appearance = (SMALL_PARTS_BATH if wet else SMALL_PARTS) if fine else BATH if wet else Look()
    sweep = simulate_sweep(probes[probe](), appearance, SweepOptions(**options))
    with progress("images") as report:
        paths = write_sweep(sweep, output, report)
    say(f"Wrote {', '.join(str(path) for path in paths)}")
    say(f"Next: sonocal calibrate {paths[0]} --lines {paths[1]}")


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
    from sonocal import detection
    from sonocal.cli.formats import lines_in
    from sonocal.cli.from_recording import looking
    from sonocal.files import write_atomically
    from sonocal.files.png import png
    from sonocal.observations import write_observations
    from sonocal.sweep import Posing, tabulate
    from sonocal.sweep.calibrate import no_candidates
    from sonocal.sweep.contact_sheet import contact_sheet
    from sonocal.sweep.lagged import with_line_velocities

    if lines is None:
        raise click.UsageError("Missing option '--lines'.")
    files = [output, *([] if sheet is None else [sheet])]
    loaded = read_given(recording, options)
    known, fixed = lines_in(lines)
    reserve(*files)
    with progress("detecting") as report:
        look = detection.DetectionOptions(**looking(loaded, options))
        found = detection.detect(loaded, look, report)
    reserve(*files)
    if sheet is not None:
        write_atomically(sheet, png(contact_sheet(loaded, found)))
    if len(found) == 0:
        raise no_candidates(loaded.name, found.images)
    posing = Posing(options["probe"], fixed, options["on_invalid"])
    table = with_line_velocities(tabulate(loaded, known, found, posing).observations, loaded, known, posing)
    write_observations(table, output)
    say(f"Wrote {len(table)} candidates to {output}" + (f" and {sheet}" if sheet else ""))


COMMANDS = [simulate, detect]
