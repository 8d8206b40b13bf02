"""``sonocal calibrate``: from a table of sightings, or from a recording with or without given points."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from sonocal.cli.existing import of_other_software
from sonocal.cli.from_recording import OF_DETECTION, SHEET, TABLE
from sonocal.cli.help import DETECTING, READING, SET_UP, command
from sonocal.cli.options import (
    ANGLES,
    CENTRE,
    COUNT,
    FILE,
    INVALID,
    JSON,
    LATENCY_OR_ESTIMATE,
    LINES,
    MARKERS,
    MASK,
    NO_REPORT,
    POSES,
    PROBE,
    SCANNER,
    THRESHOLD,
    Size,
    console,
    output_folder,
    seed,
    typed,
)
from sonocal.cli.outputs import OVERWRITE, reserve_results, write_results
from sonocal.cli.reading import ESTIMATE
from sonocal.cli.refusal import refusing
from sonocal.cli.report import json_with_verdict
from sonocal.cli.results import OF_RECORDINGS, is_table, results
from sonocal.cli.screen.plain import say_json
from sonocal.cli.sound import OF_SOUND, of_sound
from sonocal.cli.told import ACCEPT_UNITS, EXPECTED, MARKER_ABOVE
from sonocal.errors import InputError

__all__ = ["calibrate"]

OF_TABLES = ("fit_split", "test_split")


@command(
    "Calibrate from a table of sightings (CSV) or from a recording.",
    groups={
        "What is read": ("lines", "points", *READING, "image_size_px", "fit_split", "test_split"),
        "How the needle is found in images": DETECTING,
        "How rows are fitted": (
            "model",
            "scale_mm_per_px",
            "threshold_mm",
            "weighting",
            "sigma_px",
            "sigma_mm",
            "max_samples",
            "seed",
        ),
        "What is known of the set-up": (*SET_UP, "transform", "stored_as"),
        "What is known of the sound, of a curved probe": OF_SOUND,
        "What is written and shown": ("output", "tolerance_mm", "report", "overwrite", "as_json"),
    },
    examples=(
        "sonocal calibrate needle.csv",
        "sonocal calibrate sweep.igs.mha --lines needle.toml -o calibration",
        "sonocal calibrate sweep.igs.mha --lines needle.toml --points points.csv -o from-points",
        "sonocal calibrate needle.csv --test-split test --scanner-mm-per-px 0.24 -o held-out",
        "sonocal calibrate needle.csv --scale 0.24 -o known-scale",
        "sonocal calibrate needle.csv --probe-radius-mm 60 --sound-speed 1482 -o in-water",
        "sonocal calibrate - -o piped < needle.csv",
    ),
)
@click.argument("source", metavar="INPUT", type=FILE)
@output_folder("calibration", "calibration.json, report.html and what led to them")
@LINES
@click.option(
    "--points", type=FILE, help="Points found in the images (CSV: frame, u_px, v_px[, w_px][, target])."
)
@POSES
@ANGLES
@MARKERS
@PROBE
@LATENCY_OR_ESTIMATE
@INVALID
@COUNT
@CENTRE
@MASK
@click.option(
    "--model",
    type=click.Choice(["similarity", "anisotropic"]),
    default="similarity",
    show_default=True,
    help="One mm/px, or one along every axis (linear 2D probes; voxels that are no cubes).",
)
@click.option(
    "--scale",
    "scale_mm_per_px",
    type=float,
    metavar="MM_PER_PX",
    help="The scale, where it is known: six unknowns are left, and the rows say whether they agree with it.",
)
@click.option("--fit-split", metavar="NAME", help="Fit the rows of this split of a table only.")
@click.option("--test-split", metavar="NAME", help="Hold the rows of this split out, and report their error.")
@click.option(
    "--threshold-mm",
    type=THRESHOLD,
    metavar="MM|auto",
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
    help="Warn where the predicted error (95 %) at a corner of the image, or of the area seen, exceeds this.",
)
@click.option(
    "--image-size",
    "image_size_px",
    type=Size(),
    metavar="WxH[xD]",
    help="Image size, px, for predicted errors at its corners.  [default: the table's or the recording's]",
)
@click.option(
    "--max-samples", type=int, default=10_000, show_default=True, help="Random minimal samples at the most."
)
@seed("the random samples")
@SCANNER
@MARKER_ABOVE
@EXPECTED
@of_sound
@of_other_software
@ACCEPT_UNITS
@NO_REPORT
@OVERWRITE
@JSON
def calibrate(
    source: Path,
    output: Path,
    *,
    lines: Path | None,
    expected: Path | None,
    accept_units: bool,
    report: bool,
    overwrite: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Calibrate from a table of sightings (CSV), or from a recording.

    INPUT is one of these, or - for a table that is piped in:

    \b
    a table      one row a point, with frame, target, u_px, v_px[, w_px] and the end points of the line that was
                 seen there, x0_mm ... z1_mm, in the probe marker's frame. With w_px the probe is 3D, and two or
                 more rows of one frame and target give the needle's line
                 or, with --targets, the twelve columns of the pose of the target's frame, probe_from_target_00 ...
                 _23: where the target is in that frame is found, too
    a recording  with --lines: the needle is found in its images, and contact-sheet.png shows where; with --points,
                 too, the points are given

    From a recording, observations.csv is written too: the sightings that the calibration rests on. With --latency
    estimate it is written from a table, too: its lines are where the lag leads.
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.cli.screen.calibration import print_calibration

    estimated = options["latency_s"] == ESTIMATE
    options["latency"] = ESTIMATE if estimated else None
    recording = lines is not None and not is_table(source)
    _refuse_mixture(recording=recording, given=options["points"] is not None, estimated=estimated)
    if source.exists():  # else a reader says so
        _require_kinds(source, lines)
        moved = lines is not None or estimated
        reserve_results(output, _names(options["points"], moved=moved, recording=recording, report=report))
    with refusing(as_json=as_json):
        found, files, rereadings = results(
            source,
            lines,
            output,
            expected=expected,
            accept_units=accept_units,
            report=report,
            options=options,
        )
    write_results(output, files)
    if as_json:
        content = json_with_verdict(found, files["calibration.json"])
        say_json(content | {"rereadings": rereadings})
        return
    print_calibration(console(), found)
    console().print(f"Wrote {', '.join(str(output / name) for name in files)}", soft_wrap=True)


def _names(points: Path | None, *, moved: bool, recording: bool, report: bool) -> tuple[str, ...]:
    """What will be written: known before the work is done."""
    names = ("calibration.json", "report.html") if report else ("calibration.json",)
    return names + ((TABLE, SHEET) if recording and points is None else (TABLE,) if moved else ())


def _refuse_mixture(*, recording: bool, given: bool, estimated: bool) -> None:
    """Options that would do nothing are a mistake."""
    of_recordings = tuple(name for name in OF_RECORDINGS if not (estimated and name == "latency_s"))
    if not recording and (names := typed(of_recordings)):
        raise click.UsageError(f"{names[0]} is for recordings; give their needle or wires with --lines")
    if recording and (names := typed(OF_TABLES)):
        raise click.UsageError(f"{names[0]} is for tables; a recording has no splits")
    if given and (names := typed(OF_DETECTION)):
        raise click.UsageError(f"{names[0]} is for detection; with --points nothing is detected")


def _require_kinds(source: Path, lines: Path | None) -> None:
    """Refuse what is plainly something else, before anything is said of where results would go."""
    from sonocal.cli.formats import kind_of, require_kind

    if lines is not None:
        if is_table(source):
            _require_asked(source)
        else:
            require_kind(source, ("recording",))
        if lines.exists():
            require_kind(lines, ("targets", "device set"))
        return
    if source.is_dir():
        raise InputError(
            f"{source}: is a directory; name a table of sightings in it, or say with --lines what its images show"
        )
    if kind_of(source) == "recording":
        raise InputError(
            f"{source.name}: is a recording; say with --lines which needle or wires were seen in it"
        )
    require_kind(source, ("observations",))


def _require_asked(source: Path) -> None:
    """Refuse targets for a table that says where its own are."""
    import sonocal
    from sonocal.files.kinds import Head
    from sonocal.observations.poses import POSE_COLUMNS, unplaced_rows

    posed = not set(POSE_COLUMNS).isdisjoint(Head.of(source).columns)
    if not posed or not unplaced_rows(sonocal.read_observations(source)).any():
        raise InputError(
            f"{source.name}: is a table of sightings, which has its lines in it; leave out --lines"
        )
