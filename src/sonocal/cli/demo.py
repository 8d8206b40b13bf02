"""``sonocal demo``: a simulated sweep, calibrated, with its report."""

from __future__ import annotations

from itertools import chain, count
from pathlib import Path

import click

from sonocal.cli.help import command
from sonocal.cli.options import (
    NO_REPORT,
    console,
    output_folder,
    seed,
    typed,
)
from sonocal.cli.outputs import OVERWRITE, reserve, reserve_results, write_results

__all__ = ["demo"]


@command(
    "Simulate a sweep, calibrate it and open the report.",
    groups={
        "What is simulated": ("dimension", "needles", "outliers", "seed"),
        "How it is shown": ("studio",),
        "What is written": ("output", "report", "overwrite"),
    },
    examples=(
        "sonocal demo",
        "sonocal demo --studio",
        "sonocal demo --dimension 3 --outliers 0.4 -o solid",
    ),
)
@output_folder("sonocal-demo", "observations.csv, calibration.json and report.html")
@click.option(
    "--dimension", type=click.Choice(["2", "3"]), default="2", show_default=True, help="Of the probe."
)
@click.option("--needles", type=click.IntRange(4), default=50, show_default=True, help="Needle poses.")
@click.option(
    "--outliers",
    type=click.FloatRange(0, 0.9),
    default=0.2,
    show_default=True,
    help="Share of the sightings that are gross nonsense.",
)
@seed("everything random")
@click.option(
    "--studio", is_flag=True, help="Write the sample recording instead, and look at it in the browser."
)
@NO_REPORT
@OVERWRITE
def demo(
    output: Path,
    *,
    dimension: str,
    needles: int,
    outliers: float,
    seed: int,
    studio: bool,
    report: bool,
    overwrite: bool,
) -> None:
    """Simulate a sweep with known truth, calibrate it, show the error and open the report.

    Run again, it takes a folder with a number after its name.

    The needle is 400 mm long, the image 500 px of 0.24 mm, the noise 1 px in the image and 1 mm at its ends.
    """
    import sonocal
    from sonocal.calibration import calibration_json
    from sonocal.cli.report import report_files
    from sonocal.cli.screen.calibration import (
        print_calibration,
        print_truth,
    )
    from sonocal.cli.screen.terminal import somebody_looks
    from sonocal.observations.table_file import as_file
    from sonocal.simulation.scene import simulate_observations

    output = output if overwrite or typed(("output",)) else _fresh(output)
    if studio:
        _in_studio(output)
        return
    names = ("observations.csv", "calibration.json", *(("report.html",) if report else ()))
    reserve_results(output, names)
    simulated = simulate_observations(int(dimension), needles, outlier_share=outliers, seed=seed)
    table, rows = as_file(simulated.observations, "observations.csv")
    try:
        calibration = sonocal.calibrate(rows)
    except sonocal.NoConsensusError as refusal:
        raise sonocal.NoConsensusError(
            f"{outliers:.0%} of the rows are nonsense on purpose, too many for the others to be told from them "
            f"(--outliers 0.5 leaves enough): {refusal}",
            best_count=refusal.best_count,
        ) from None
    files = {"observations.csv": table, "calibration.json": calibration_json(calibration)}
    files |= report_files(calibration, rows) if report else {}
    write_results(output, files)
    screen = console()
    if nonsense := round(outliers * len(rows)):
        screen.print(
            f"Of {len(rows)} simulated rows some {nonsense} are nonsense on purpose (--outliers {outliers:g}): the "
            "errors below are the others'.\n"
        )
    print_calibration(screen, calibration)
    print_truth(screen, calibration, simulated)
    screen.print(f"Wrote {', '.join(str(output / name) for name in files)}", soft_wrap=True)
    if "report.html" in files:
        screen.print(f"Report: {(output / 'report.html').resolve().as_uri()}", soft_wrap=True)
    screen.print(f"Next: sonocal calibrate {output / 'observations.csv'}", soft_wrap=True)
    if "report.html" in files and somebody_looks():
        click.launch(str(output / "report.html"))


def _in_studio(output: Path) -> None:
    """The sample recording, on the desk of the studio."""
    from sonocal.cli.studio import open_studio
    from sonocal.simulation.sample import sample_sweep
    from sonocal.simulation.sweep_files import SWEEP_FILES, write_sweep

    if names := typed(("dimension", "needles", "outliers", "seed", "report")):
        raise click.UsageError(
            f"{names[0]} is for the table; --studio shows the sample recording, leave it out"
        )
    reserve(*(output / name for name in SWEEP_FILES))
    source, lines, _ = write_sweep(sample_sweep(), output)
    open_studio([source, lines], output / "studio", host="127.0.0.1", port=0, browser=True)


def _fresh(folder: Path) -> Path:
    """The folder, or with a number after its name where that is there: a demonstration is run more than once."""
    names = (folder.with_name(f"{folder.name}-{number}") for number in count(2))
    return next(name for name in chain([folder], names) if not name.exists())
