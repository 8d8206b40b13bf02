"""The command line. Thin: parse, call, print; heavy imports inside the commands."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal import __version__
from sonocal.cli_detection import COMMANDS
from sonocal.cli_study import study
from sonocal.cli_validation import validate
from sonocal.errors import InputError, SonocalError

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["main"]


class _Commands(click.Group):
    """A group whose foreseen failures are one sentence and exit status 1; a bug keeps its traceback."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except SonocalError as error:
            raise click.ClickException(str(error)) from None


class _Size(click.ParamType[tuple[int, ...]]):
    """WIDTHxHEIGHT or WIDTHxHEIGHTxDEPTH, px."""

    name = "WxH[xD]"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[int, ...]:
        parts = str(value).lower().split("x")
        if len(parts) not in (2, 3) or not all(part.isdigit() and int(part) > 0 for part in parts):
            self.fail(f"{value!r} is not a size such as 640x480", param, ctx)
        return tuple(int(part) for part in parts)


class _Threshold(click.ParamType[float | str]):
    """A number of millimetres, or "auto"."""

    name = "MM|auto"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float | str:
        if value == "auto":
            return "auto"
        try:
            return float(value)
        except ValueError:
            self.fail(f"{value!r} is neither a number of millimetres nor auto", param, ctx)


def _console() -> Console:
    from rich.console import Console

    return Console(highlight=False)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="sonocal")
def main() -> None:
    """Calibrate a tracked ultrasound probe with a tracked needle.

    Start with "sonocal demo", then "sonocal calibrate observations.csv".
    """


@main.command()
@click.argument("observations", metavar="OBSERVATIONS", type=click.Path(path_type=Path))
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("calibration"),
    show_default=True,
    help="Folder for calibration.json and report.html; made if absent.",
)
@click.option(
    "--model",
    type=click.Choice(["similarity", "anisotropic"]),
    default="similarity",
    show_default=True,
    help="One mm/px, or one along u and one along v (linear 2D probes).",
)
@click.option("--fit-split", metavar="NAME", help="Fit the rows of this split only.")
@click.option("--test-split", metavar="NAME", help="Hold the rows of this split out, and report their error.")
@click.option(
    "--threshold-mm",
    type=_Threshold(),
    default=5.0,
    show_default=True,
    help='Rows further than this from their line are outliers; "auto": from the noise.',
)
@click.option(
    "--weighting",
    type=click.Choice(["likelihood", "geometric"]),
    default="likelihood",
    show_default=True,
    help="Weigh distances by the noise they carry, or all alike as the paper does.",
)
@click.option("--sigma-px", type=float, help="Noise of an image point along each axis.  [default: estimated]")
@click.option(
    "--sigma-mm", type=float, help="Noise of a segment's end along each axis.  [default: estimated]"
)
@click.option(
    "--tolerance-mm",
    type=float,
    default=2.0,
    show_default=True,
    help="Warn where the predicted error (95 %) at an image corner exceeds this.",
)
@click.option(
    "--image-size",
    "image_size_px",
    type=_Size(),
    help="Image size, px, for predicted errors at its corners.  [default: the box of the points seen]",
)
@click.option(
    "--max-samples", type=int, default=10_000, show_default=True, help="Random minimal samples at the most."
)
@click.option("--seed", type=int, default=0, show_default=True, help="Of the random samples.")
@click.option(
    "--scanner-mm-per-px", type=click.FloatRange(0, min_open=True), help="What the scanner says, to compare."
)
@click.option(
    "--no-report", "report", is_flag=True, flag_value=False, default=True, help="Write no report.html."
)
@click.option(
    "--json", "as_json", is_flag=True, help="Print the calibration as JSON on stdout instead of tables."
)
def calibrate(
    observations: Path,
    output: Path,
    *,
    scanner_mm_per_px: float | None,
    report: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Calibrate from a table of sightings (CSV).

    One row a point: frame, target, u_px, v_px[, w_px] and the end points of the line that was seen there,
    x0_mm ... z1_mm, in the probe marker's frame. With w_px the probe is 3D, and two or more rows of one frame and
    target give the needle's line.
    """
    import sonocal
    from sonocal.calibration_file import calibration_json
    from sonocal.cli_validation import checked, report_files
    from sonocal.files import write_into_folder
    from sonocal.terminal import print_calibration

    rows = sonocal.read_observations(observations)
    calibration = checked(sonocal.calibrate(rows, **options), rows, scanner_mm_per_px=scanner_mm_per_px)
    content = calibration_json(calibration)
    files = {"calibration.json": content, **(report_files(calibration, rows) if report else {})}
    write_into_folder(output, files)
    if as_json:
        click.echo(content, nl=False)
        return
    console = _console()
    print_calibration(console, calibration)
    console.print(f"Wrote {' and '.join(str(output / name) for name in files)}", soft_wrap=True)


@main.command()
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    default=Path("sonocal-demo"),
    show_default=True,
    help="Folder for observations.csv and calibration.json; made if absent.",
)
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
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of everything random.")
def demo(output: Path, dimension: str, needles: int, outliers: float, seed: int) -> None:
    """Simulate a sweep with known truth, calibrate it, and show the error.

    The needle is 400 mm long, the image 500 px of 0.24 mm, the noise 1 px in the image and 1 mm at the needle's ends.
    """
    import sonocal
    from sonocal.calibration_file import calibration_json
    from sonocal.files import write_into_folder
    from sonocal.observations import observations_csv
    from sonocal.simulation.scene import IMAGE_PX, simulate_observations
    from sonocal.terminal import print_calibration, print_truth

    simulated = simulate_observations(int(dimension), needles, outlier_share=outliers, seed=seed)
    calibration = sonocal.calibrate(simulated.observations, image_size_px=(IMAGE_PX,) * int(dimension))
    files = {
        "observations.csv": observations_csv(simulated.observations),
        "calibration.json": calibration_json(calibration),
    }
    write_into_folder(output, files)
    console = _console()
    print_calibration(console, calibration)
    print_truth(console, calibration, simulated)
    console.print(f"Wrote {' and '.join(str(output / name) for name in files)}", soft_wrap=True)
    console.print(f"Next: sonocal calibrate {output / 'observations.csv'}", soft_wrap=True)


@main.command()
@click.argument("calibration", metavar="CALIBRATION", type=click.Path(path_type=Path))
@click.option(
    "--to", "form", type=click.Choice(["plus", "json"]), required=True, help="The software to export for."
)
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="File to write.")
def export(calibration: Path, form: str, output: Path) -> None:
    """Write a calibration (calibration.json) for other software.

    plus: a device-set XML whose ImageToProbe transform is the calibration. json: the calibration file, brought up to
    date.
    """
    from sonocal.calibration_file import calibration_json, load_calibration
    from sonocal.export.plus import plus_xml
    from sonocal.files import write_atomically

    loaded = load_calibration(calibration)
    write_atomically(output, plus_xml(loaded) if form == "plus" else calibration_json(loaded))
    click.echo(f"Wrote {output}")


@main.command()
@click.argument("file", metavar="FILE", type=click.Path(path_type=Path))
def info(file: Path) -> None:
    """Show what is in a file: observations (CSV) or a calibration (JSON)."""
    from sonocal.calibration_file import parse_calibration
    from sonocal.files import read_bytes
    from sonocal.observations import parse_observations
    from sonocal.terminal import print_calibration, print_observations

    content = read_bytes(file)
    if content.lstrip()[:1] == b"{":
        print_calibration(_console(), parse_calibration(content, file.name))
        return
    try:
        observations = parse_observations(content, file.name)
    except InputError as error:
        if file.suffix.lower() in (".csv", ".json"):
            raise
        raise InputError(
            f"{file.name}: is neither a calibration (JSON) nor a table of sightings (CSV): {error}"
        ) from None
    print_observations(_console(), observations)


for _command in (*COMMANDS, validate, study):
    main.add_command(_command)
