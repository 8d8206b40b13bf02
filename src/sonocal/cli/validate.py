"""The command `sonocal validate`, and the report that it and `sonocal calibrate` write."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.existing import choice_of, of_other_software, refuse_choice, validate_existing
from sonocal.cli.help import DETECTING, READING, SET_UP, command
from sonocal.cli.measured import OF_RECORDINGS, Measured, read_measured
from sonocal.cli.numbers import (
    numbers_of,
    numbers_record,
    print_numbers,
    with_comparison,
)
from sonocal.cli.options import (
    ANGLES,
    CENTRE,
    COUNT,
    FILE,
    INVALID,
    JSON,
    LATENCY,
    LINES,
    MARKERS,
    MASK,
    NO_REPORT,
    POSES,
    PROBE,
    SCANNER,
    WRITTEN,
    seed,
)
from sonocal.cli.others import Others, apart_record, called, print_apart, with_others
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.piped import folder_of
from sonocal.cli.screen.plain import say, say_json
from sonocal.cli.told import ACCEPT_UNITS, EXPECTED, MARKER_ABOVE, rotation_of
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration

__all__ = ["validate"]

PAGE = "validation.html"
"""Beside the report that `calibrate` wrote, which is another run's."""


class _NWire(click.ParamType[tuple[str, str, str]]):
    """LEFT,MIDDLE,RIGHT."""

    name = "LEFT,MIDDLE,RIGHT"

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> tuple[str, str, str]:
        names = [name.strip() for name in str(value).split(",")]
        if len(names) != 3 or not all(names):
            self.fail(f"{value!r} is not three targets such as left,middle,right", param, ctx)
        return names[0], names[1], names[2]


@command(
    "Say how far off a calibration is, whoever made it.",
    groups={
        "What is read": ("lines", "points", *READING, "split", "crosswire", "nwires"),
        "How the needle is found in images": DETECTING,
        "What it is compared with": ("compare", "transform", "stored_as"),
        "What is known of the set-up": SET_UP,
        "What is written and shown": ("output", "seed", "report", "overwrite", "as_json"),
    },
    examples=(
        "sonocal validate calibration.json needle.csv",
        "sonocal validate calibration.json crosswire.csv --crosswire",
        "sonocal validate calibration.json needle.csv --compare earlier/calibration.json --overwrite",
        "sonocal validate plus.xml sweep.igs.mha --lines needle.toml",
        "sonocal validate calibration.json - --no-report < needle.csv",
    ),
)
@click.argument("calibration", metavar="CALIBRATION", type=FILE)
@click.argument("source", metavar="INPUT", type=FILE)
@click.option(
    "-o",
    "--output",
    type=WRITTEN,
    help=f"Folder for {PAGE}.  [default: CALIBRATION's; none of a matrix of other software]",
)
@click.option("--split", metavar="NAME", help="Take the rows of this split as held out.")
@click.option("--crosswire", is_flag=True, help="INPUT is a table of points.  [default: by its columns]")
@click.option(
    "--nwire",
    "nwires",
    type=_NWire(),
    multiple=True,
    help="Targets of an N, for PLUS's error; once for each N.  [default: of a recording, those of its device set]",
)
@click.option("--compare", type=FILE, metavar="OTHER", help="Another calibration, ours or of other software.")
@of_other_software
@LINES
@click.option(
    "--points", type=FILE, help="Points found in the images (CSV: frame, u_px, v_px[, w_px][, target])."
)
@POSES
@ANGLES
@MARKERS
@PROBE
@LATENCY
@INVALID
@COUNT
@CENTRE
@MASK
@SCANNER
@MARKER_ABOVE
@EXPECTED
@ACCEPT_UNITS
@seed("the resampling")
@NO_REPORT
@OVERWRITE
@JSON
def validate(
    calibration: Path,
    source: Path,
    *,
    lines: Path | None,
    output: Path | None,
    compare: Path | None,
    expected: Path | None,
    report: bool,
    overwrite: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """How far off is a calibration, on a table of sightings or points (CSV), or on a recording?

    CALIBRATION is calibration.json, or a matrix of other software: a device set of PLUS (.xml), a transform of ITK or
    3D Slicer (.tfm, .h5), a 4 x 4 (text, .npy). It is compared with our own calibration of INPUT, too.

    INPUT is one of these, or - for a table that is piped in:

    \b
    its own input    leave-one-out errors, repeatability, and the held-out error of its test split
    other sightings  in a table, or in a recording with --lines: their error
    points           with u_px, v_px and x_mm, y_mm, z_mm (where the point is known to be) or probe_00 ... probe_23 (the
                     probe's pose): projection reconstruction accuracy, spread at a fixed cross-wire
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.cli.formats import calibration_in
    from sonocal.existing import Existing

    choice, recorded = (
        choice_of(options),
        {name: options.pop(name) for name in (*OF_RECORDINGS, "accept_units")},
    )
    found = calibration_in(calibration, choice)
    folder = folder_of(calibration) if output is None else output
    page = folder / PAGE if report and (output is not None or not isinstance(found, Existing)) else None
    if page is not None:
        _reserve_page(folder, calibration)
    others = Others(*(None if path is None else calibration_in(path, choice) for path in (compare, expected)))
    refuse_choice(found, others.compared, others.expected)
    name = "" if compare is None else str(compare)
    how = {"crosswire": options.pop("crosswire"), "nwires": options.pop("nwires"), "split": options["split"]}
    measured = read_measured(source, lines, recorded, found, **how)
    if isinstance(found, Existing):
        of_matrix = {name: options[name] for name in ("split", "scanner_mm_per_px")}
        validate_existing(
            found, others.compared, measured, name=name, **of_matrix, page=page, as_json=as_json
        )
        return
    expectation = others.expectation
    options["expected_rotation"] = None if expectation is None else rotation_of(expectation)
    _validate_ours(
        found, others, measured, options, name=name, folder=folder if report else None, as_json=as_json
    )


def _validate_ours(
    found: Calibration,
    others: Others,
    measured: Measured,
    options: dict[str, Any],
    *,
    name: str,
    folder: Path | None,
    as_json: bool,
) -> None:
    """The numbers of a calibration of ours, the comparison, and the report where a folder is given."""
    from sonocal.calibration import Calibration
    from sonocal.cli.report import report_files
    from sonocal.cli.screen.existing import difference_section
    from sonocal.files import write_into_folder
    from sonocal.findings import begun
    from sonocal.validation import compare

    other = others.compared
    numbers, beside, misread = with_others(numbers_of(found, measured, options), found, others)
    comparison = compare(found, other) if isinstance(other, Calibration) else None
    if comparison is not None:
        numbers = with_comparison(numbers, found, comparison)
    title = f"{begun(called(other, name))}, against this one"
    sections = [] if beside is None else [difference_section(title, beside.difference)]
    files = (
        {}
        if folder is None
        else report_files(
            found, measured.rows, numbers, comparison, name=PAGE, other=name, differences=sections
        )
    )
    write_into_folder(folder or Path(), files)
    if as_json:
        apart = {} if beside is None else {"difference": apart_record(beside.difference)}
        say_json(numbers_record(found, numbers, comparison) | apart | {"rereadings": misread})
        return
    print_numbers(found, numbers, comparison, called(other, name))
    if beside is not None:
        print_apart(beside.difference, title)
    for file in files:
        say(f"Wrote {(folder or Path()) / file}")


def _reserve_page(folder: Path, path: Path) -> None:
    """A page stands beside no other calibration."""
    for other in {folder / "calibration.json", folder / path.name}:
        if other.exists() and not other.samefile(path):
            raise InputError(
                f"{folder}: holds another calibration, {other.name}; choose another folder with -o"
            )
    reserve(folder / PAGE)
