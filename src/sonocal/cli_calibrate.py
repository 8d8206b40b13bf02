"""``sonocal calibrate``: from a table of sightings, or from a recording with or without given points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from sonocal.cli_options import (
    CENTRE,
    COUNT,
    FILE,
    INVALID,
    JSON,
    LATENCY,
    LINES,
    MASK,
    NO_REPORT,
    POSES,
    PROBE,
    SCANNER,
    Size,
    Threshold,
    console,
    output_folder,
    progress,
    seed,
)
from sonocal.errors import InputError, SonocalError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.observations import Observations
    from sonocal.recording import Line, Recording
    from sonocal.report import FrameImage

__all__ = ["calibrate"]

TABLE, SHEET = "observations.csv", "contact-sheet.png"
MOST_PICTURES = 12
OF_TABLES = ("fit_split", "test_split")
OF_DETECTION = ("count", "centre", "mask")
OF_RECORDINGS = ("points", "poses", "probe", "latency_s", "on_invalid", *OF_DETECTION)


@click.command()
@click.argument("source", metavar="INPUT", type=FILE)
@output_folder("calibration", "calibration.json, report.html and what led to them")
@LINES
@click.option(
    "--points", type=FILE, help="Points found in the images (CSV: frame, u_px, v_px[, w_px][, target])."
)
@POSES
@PROBE
@LATENCY
@INVALID
@COUNT
@CENTRE
@MASK
@click.option(
    "--model",
    type=click.Choice(["similarity", "anisotropic"]),
    default="similarity",
    show_default=True,
    help="One mm/px, or one along u and one along v (linear 2D probes).",
)
@click.option("--fit-split", metavar="NAME", help="Fit the rows of this split of a table only.")
@click.option("--test-split", metavar="NAME", help="Hold the rows of this split out, and report their error.")
@click.option(
    "--threshold-mm",
    type=Threshold(),
    default=5.0,
    show_default=True,
    help='Rows further than this from their line are outliers; "auto": from the noise. Less where wires are near.',
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
    type=Size(),
    help="Image size, px, for predicted errors at its corners.  [default: the recording's, or the box of the points]",
)
@click.option(
    "--max-samples", type=int, default=10_000, show_default=True, help="Random minimal samples at the most."
)
@seed("the random samples")
@SCANNER
@NO_REPORT
@JSON
def calibrate(
    source: Path,
    output: Path,
    *,
    lines: Path | None,
    scanner_mm_per_px: float | None,
    report: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Calibrate from a table of sightings (CSV), or from a recording.

    \b
    INPUT is one of
      a table: one row a point, with frame, target, u_px, v_px[, w_px] and the
        end points of the line that was seen there, x0_mm ... z1_mm, in the
        probe marker's frame. With w_px the probe is 3D, and two or more rows
        of one frame and target give the needle's line;
      a recording, with --lines: the needle is found in its images, and
        contact-sheet.png shows where;
      a recording, with --lines and --points: the points are given.

    From a recording, observations.csv is written too: the sightings that the calibration rests on.
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.calibration_file import calibration_json
    from sonocal.cli_validation import checked, report_files
    from sonocal.files import write_into_folder
    from sonocal.terminal import print_calibration

    _refuse_mixture(recording=lines is not None, given=options["points"] is not None)
    recorded = {name: options.pop(name) for name in OF_RECORDINGS}
    if lines is None:
        result = _from_table(source, options)
    else:
        result = _from_recording(source, lines, output, recorded, options)
    found = checked(result.calibration, result.rows, scanner_mm_per_px=scanner_mm_per_px)
    content = calibration_json(found)
    files = {"calibration.json": content, **result.files}
    if report:
        files |= report_files(found, result.rows, frames=_pictures(result))
    write_into_folder(output, files)
    if as_json:
        click.echo(content, nl=False)
        return
    print_calibration(console(), found)
    console().print(f"Wrote {', '.join(str(output / name) for name in files)}", soft_wrap=True)


class _Result(NamedTuple):
    """A calibration, the rows it rests on, and what is written beside it."""

    rows: Observations
    calibration: Calibration
    files: dict[str, bytes]
    recording: Recording | None = None


def _typed(names: tuple[str, ...]) -> list[str]:
    """The options, of some, that stand on the command line."""
    context, typed = click.get_current_context(), click.core.ParameterSource.COMMANDLINE
    return [
        option.opts[0]
        for option in context.command.params
        if option.name in names and context.get_parameter_source(option.name) is typed
    ]


def _refuse_mixture(*, recording: bool, given: bool) -> None:
    """Options that would do nothing are a mistake."""
    if not recording and (names := _typed(OF_RECORDINGS)):
        raise click.UsageError(f"{names[0]} is for recordings; give their needle or wires with --lines")
    if recording and (names := _typed(OF_TABLES)):
        raise click.UsageError(f"{names[0]} is for tables; a recording has no splits")
    if given and (names := _typed(OF_DETECTION)):
        raise click.UsageError(f"{names[0]} is for detection; with --points nothing is detected")
    if recording and not given and click.get_current_context().params["threshold_mm"] == "auto":
        raise click.UsageError("--threshold-mm auto is for tables and --points; detection needs a number")


def _from_table(source: Path, options: dict[str, Any]) -> _Result:
    import sonocal
    from sonocal.contents import kind_of

    if source.is_dir():
        raise InputError(
            f"{source}: is a directory; name a table of sightings in it, or say with --lines what its images show"
        )
    if (kind := kind_of(source)) == "recording":
        raise InputError(
            f"{source.name}: is a recording; say with --lines which needle or wires were seen in it"
        )
    if kind not in ("observations", "table"):
        raise InputError(
            f"{source.name}: is a file of kind {kind!r}; give a table of sightings (CSV), or a recording with --lines"
        )
    rows = sonocal.read_observations(source)
    return _Result(rows, sonocal.calibrate(rows, **options), {})


def _from_recording(
    source: Path, lines: Path, output: Path, recorded: dict[str, Any], options: dict[str, Any]
) -> _Result:
    from sonocal.contents import kind_of
    from sonocal.observations import observations_csv, parse_observations
    from sonocal.recording import read_lines, read_recording

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
    return _Result(rows, found, {TABLE: table, **result.files}, recording)


def _given(recording: Recording, lines: Sequence[Line], points: Path, options: dict[str, Any]) -> _Result:
    """Calibrate on the points of a table."""
    from sonocal.needle_sweep import calibrate_points
    from sonocal.sightings import read_detections

    found, rows = calibrate_points(recording, lines, read_detections(points), **options)
    return _Result(rows, found, {})


def _detected(
    recording: Recording,
    lines: Sequence[Line],
    output: Path,
    recorded: dict[str, Any],
    options: dict[str, Any],
) -> _Result:
    """Find the needle in the images, and calibrate on the candidates that agree."""
    from sonocal.needle_sweep import calibrate_recording

    flat = recording.image is not None and recording.image.dimension == 2
    sheet = _Sheet(recording, output) if flat else None
    if not _typed(("threshold_mm",)):
        options.pop("threshold_mm")  # lines that are close to one another ask for less
    with progress("detecting") as report:
        if sheet is not None:
            options |= sheet.detect(recorded, report)
        else:
            options |= _of_volumes(recording, recorded)
        try:
            found = calibrate_recording(recording, lines, progress=report, **options)
        except SonocalError:
            if sheet is not None:
                sheet.write()
            raise
    rows = found.observations
    return _Result(rows, found.calibration, {} if sheet is None else {SHEET: sheet.png(rows)})


def _of_volumes(recording: Recording, recorded: dict[str, Any]) -> dict[str, Any]:
    """The detection options of 3D probes."""
    if names := _typed(("mask", "centre")):
        raise InputError(
            f"{recording.name}: has no 2D images; lines in volumes are found without {names[0]}, leave it out"
        )
    return {"count": recorded["count"]} if _typed(("count",)) else {}


class _Sheet:
    """The candidates of a recording's images, and the sheet that shows them."""

    def __init__(self, recording: Recording, output: Path) -> None:
        self._recording, self._output = recording, output

    def detect(self, recorded: dict[str, Any], report: Any) -> dict[str, Any]:
        """Find candidates: the arguments of `calibrate_recording` that come of it."""
        from sonocal.detection import detect_points, find_mask, read_mask

        mask = (
            find_mask(self._recording.frames)
            if recorded["mask"] is None
            else read_mask(recorded["mask"], self._recording.frames.shape[:2])
        )
        how = {name: recorded[name] for name in ("count", "centre")} | {"mask": mask}
        self._candidates = detect_points(self._recording, progress=report, **how)
        return how | {"candidates": self._candidates}

    def png(self, rows: Observations | None = None) -> bytes:
        """The sheet, with the chosen candidates marked where there are any."""
        from sonocal.contact_sheet import contact_sheet, png

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


def _pictures(result: _Result) -> list[FrameImage]:
    """Some images with the points that the calibration rests on, for the report."""
    import numpy as np

    from sonocal.detection import as_grey
    from sonocal.report import FrameImage

    recording, rows = result.recording, result.rows
    if recording is None or recording.image is None or recording.image.dimension != 2:
        return []
    frames = np.unique(rows.frame)
    pictures = []
    for frame in frames[np.unique(np.linspace(0, len(frames) - 1, MOST_PICTURES).astype(int))].tolist():
        here = rows.select(rows.frame == frame)
        grey = as_grey(recording.frames[frame], 2, f"{recording.name}, frame {frame}")
        image = grey.clip(0, 255).astype(np.uint8)
        pictures.append(FrameImage(image, here.points_px, here.segments_mm, f"frame {frame}"))
    return pictures
