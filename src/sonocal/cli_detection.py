"""Commands that make and read images: ``simulate``, ``detect``, ``sweep``."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import click

__all__ = ["COMMANDS"]

FOLDER = click.Path(path_type=Path)


@contextmanager
def _progress(what: str) -> Iterator[Callable[[int, int], None]]:
    """A bar on stderr, so that stdout stays the result's."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@click.command()
@click.option(
    "-o",
    "--output",
    type=FOLDER,
    default=Path("simulated"),
    show_default=True,
    help="Folder; made if absent.",
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
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of everything random.")
def simulate(output: Path, probe: str, look: str, **options: Any) -> None:
    """Write a simulated recording with known truth: sweep.igs.mha, needle.toml, truth.json."""
    from sonocal.simulation.sweep import SweepOptions, simulate_sweep
    from sonocal.simulation.sweep_files import write_sweep
    from sonocal.simulation.ultrasound import BATH, SMALL_PARTS, SMALL_PARTS_BATH, Look
    from sonocal.simulation.ultrasound_probe import ProbeGeometry, curvilinear, curvilinear_3d, linear

    probes: dict[str, Callable[[], ProbeGeometry]] = {
        "curvilinear": curvilinear,
        "linear": linear,
        "curvilinear-3d": curvilinear_3d,
    }
    fine, wet = probe == "linear", look == "bath"
    appearance = (SMALL_PARTS_BATH if wet else SMALL_PARTS) if fine else BATH if wet else Look()
    sweep = simulate_sweep(probes[probe](), appearance, SweepOptions(**options))
    with _progress("images") as report:
        paths = write_sweep(sweep, output, report)
    click.echo(f"Wrote {', '.join(str(path) for path in paths)}")
    click.echo(f"Next: sonocal sweep {paths[0]} --lines {paths[1]}")


LINES = click.option(
    "--lines", type=FOLDER, required=True, help="The needle or wires: needle.toml or a PLUS device set (XML)."
)
COUNT = click.option(
    "--count", type=click.IntRange(1), default=5, show_default=True, help="Candidates an image."
)
PROBE = click.option("--probe", default="Probe", show_default=True, help="What the probe's marker is called.")
LATENCY = click.option(
    "--latency", "latency_s", type=float, default=0.0, show_default=True, help="Tracker lag, s."
)
INVALID = click.option(
    "--on-invalid",
    type=click.Choice(["raise", "skip"]),
    default="raise",
    show_default=True,
    help="What to do with poses that are not rigid.",
)


@click.command()
@click.argument("recording", metavar="RECORDING", type=FOLDER)
@LINES
@click.option(
    "-o", "--output", type=FOLDER, default=Path("candidates.csv"), show_default=True, help="Table to write."
)
@click.option("--sheet", type=FOLDER, help="Contact sheet (PNG) to write.")
@COUNT
@PROBE
@LATENCY
@INVALID
def detect(
    recording: Path, lines: Path, output: Path, sheet: Path | None, count: int, **options: Any
) -> None:
    """Find the needle in a recording's images: several candidates an image, best first, as a table of sightings.

    At most one candidate of an image is right; "sonocal sweep" chooses.
    """
    from sonocal.contact_sheet import contact_sheet, png
    from sonocal.detection import detect_points
    from sonocal.files import write_atomically
    from sonocal.needle_sweep import candidate_observations, line_observations
    from sonocal.observations import write_observations
    from sonocal.recording import read_lines, read_recording

    loaded, (known, fixed) = read_recording(recording), read_lines(lines)
    options["fixed"] = fixed
    with _progress("detecting") as report:
        if loaded.image is not None and loaded.image.dimension == 3:
            table = line_observations(loaded, known, count=count, progress=report, **options)
        else:
            found = detect_points(loaded, count=count, progress=report)
            if sheet is not None:
                write_atomically(sheet, png(contact_sheet(loaded, found)))
            table = candidate_observations(loaded, known, found, **options)
    write_observations(table, output)
    click.echo(f"Wrote {len(table)} candidates to {output}" + (f" and {sheet}" if sheet else ""))


@click.command()
@click.argument("recording", metavar="RECORDING", type=FOLDER)
@LINES
@click.option(
    "-o",
    "--output",
    type=FOLDER,
    default=Path("calibration"),
    show_default=True,
    help="Folder; made if absent.",
)
@COUNT
@PROBE
@LATENCY
@INVALID
@click.option(
    "--threshold-mm", type=float, default=5.0, show_default=True, help="Further candidates are wrong."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the random samples.")
def sweep(recording: Path, lines: Path, output: Path, count: int, **options: Any) -> None:
    """Calibrate from a recording of a needle, detection included.

    Writes calibration.json, observations.csv (the chosen candidates) and contact-sheet.png, the last also when no
    calibration is found.
    """
    from rich.console import Console

    from sonocal.calibration_file import calibration_json
    from sonocal.contact_sheet import contact_sheet, png
    from sonocal.detection import detect_points
    from sonocal.files import write_into_folder
    from sonocal.needle_sweep import calibrate_recording
    from sonocal.observations import observations_csv
    from sonocal.recording import read_lines, read_recording
    from sonocal.terminal import print_calibration

    loaded, (known, fixed) = read_recording(recording), read_lines(lines)
    options["fixed"] = fixed
    files: dict[str, bytes] = {}
    with _progress("detecting") as report:
        if loaded.image is not None and loaded.image.dimension == 2:
            options["candidates"] = detect_points(loaded, count=count, progress=report)
            sheet = "contact-sheet.png"
            write_into_folder(output, {sheet: png(contact_sheet(loaded, options["candidates"]))})
        found = calibrate_recording(loaded, known, progress=report, **options)
    chosen = found.observations
    if "candidates" in options:
        marked = contact_sheet(loaded, options["candidates"], (chosen.frame, chosen.points_px))
        files["contact-sheet.png"] = png(marked)
    files |= {
        "observations.csv": observations_csv(chosen),
        "calibration.json": calibration_json(found.calibration),
    }
    write_into_folder(output, files)
    print_calibration(Console(highlight=False), found.calibration)
    click.echo(f"Wrote {', '.join(str(output / name) for name in files)}")


COMMANDS = [simulate, detect, sweep]
