"""The command `sonocal validate`, and the report that it and `sonocal calibrate` write."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.options import (
    FILE,
    JSON,
    NO_REPORT,
    SCANNER,
    console,
    seed,
)
from sonocal.cli.outputs import OVERWRITE, reserve
from sonocal.cli.screen.plain import say, say_json
from sonocal.cli.told import EXPECTED, MARKER_ABOVE, expected_rotation
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.observations import Observations
    from sonocal.validation import Comparison, PointSightings, Validation

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


@click.command(short_help="Say how far off a calibration is, on sightings or points.")
@click.argument("calibration", metavar="CALIBRATION", type=FILE)
@click.argument("table", metavar="INPUT", type=FILE)
@click.option(
    "-o",
    "--output",
    type=FILE,
    help=f"Folder for {PAGE}.  [default: CALIBRATION's]",
)
@click.option("--split", metavar="NAME", help="Take the rows of this split as held out.")
@click.option("--crosswire", is_flag=True, help="INPUT is a table of points.  [default: by its columns]")
@click.option(
    "--nwire",
    "nwires",
    type=_NWire(),
    multiple=True,
    help="Targets of an N, for PLUS's error; once for each N.",
)
@click.option("--compare", type=FILE, metavar="OTHER", help="Another calibration.json.")
@SCANNER
@MARKER_ABOVE
@EXPECTED
@seed("the resampling")
@NO_REPORT
@OVERWRITE
@JSON
def validate(
    calibration: Path,
    table: Path,
    *,
    output: Path | None,
    compare: Path | None,
    scanner_mm_per_px: float | tuple[float, float] | None,
    marker_above_image: bool,
    expected: Path | None,
    report: bool,
    overwrite: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """How far off is a calibration (calibration.json), on a table of sightings or points (CSV)?

    \b
    INPUT is one of
      the calibration's own input: leave-one-out errors, repeatability, and
        the held-out error of its test split;
      other sightings: their error;
      points, with u_px, v_px and x_mm, y_mm, z_mm (where the point is known to
        be) or probe_00 ... probe_23 (the probe's pose): projection
        reconstruction accuracy, spread at a fixed cross-wire.
    """  # noqa: D301 - click leaves the lines below the escape alone
    from sonocal.cli.formats import calibration_in, require_kind
    from sonocal.cli.report import report_files
    from sonocal.files import read_bytes, write_into_folder
    from sonocal.validation.measured import comparison_findings

    found = calibration_in(calibration)
    folder = calibration.parent if output is None else output
    other = None if compare is None else calibration_in(compare)
    require_kind(
        table,
        ("observations", "known points"),
        "give a table of sightings, or of points whose place is known (CSV)",
    )
    if report:
        _reserve_page(folder, calibration)
    content = read_bytes(table)
    known = {
        "scanner_mm_per_px": scanner_mm_per_px,
        "expected_rotation": expected_rotation(expected)
        if expected is not None or other is None
        else other.probe_from_image.rotation,
        "marker_above_image": marker_above_image,
    }
    numbers, rows = _numbers(found, content, table.name, known=known, **options)
    comparison = None if other is None else _compared(found, other)
    if comparison is not None:
        found_too = comparison_findings(found, comparison)
        numbers = replace(numbers, diagnostics=(*numbers.diagnostics, *found_too))
    files = report_files(found, rows, numbers, comparison, name=PAGE) if report else {}
    write_into_folder(folder, files)
    if as_json:
        say_json(_record(found, numbers, comparison))
        return
    _print(found, numbers, comparison)
    for name in files:
        say(f"Wrote {folder / name}")


def _reserve_page(folder: Path, path: Path) -> None:
    """A page stands beside no other calibration."""
    for other in {folder / "calibration.json", folder / path.name}:
        if other.exists() and not other.samefile(path):
            raise InputError(
                f"{folder}: holds another calibration, {other.name}; choose another folder with -o"
            )
    reserve(folder / PAGE)


def _numbers(
    calibration: Calibration,
    content: bytes,
    name: str,
    *,
    known: dict[str, Any],
    crosswire: bool,
    split: str | None,
    nwires: tuple[tuple[str, str, str], ...],
    seed: int,
) -> tuple[Validation, Observations | None]:
    from sonocal.files.kinds import Head
    from sonocal.observations import parse_observations
    from sonocal.validation import parse_point_sightings, validate, validate_points

    header = Head(Path(name), content).columns
    if crosswire or ("x0_mm" not in header and "u_px" in header):
        points: PointSightings = parse_point_sightings(content, name)
        return validate_points(calibration, points), None
    rows = parse_observations(content, name)
    return validate(calibration, rows, split=split, nwires=nwires, seed=seed, **known), rows


def _compared(first: Calibration, second: Calibration) -> Comparison:
    from sonocal.validation import compare

    return compare(first, second)


def _print(calibration: Calibration, numbers: Validation, comparison: Comparison | None) -> None:
    from sonocal.cli.screen.validation import print_validation

    if not numbers.quantities and not numbers.diagnostics:
        raise InputError(f"{numbers.source}: gives no number; it needs held-out rows, places or poses")
    print_validation(console(), calibration, numbers, comparison)


def _record(calibration: Calibration, numbers: Validation, comparison: Comparison | None) -> dict[str, Any]:
    from sonocal.validation import cannot_show, give_verdict

    record: dict[str, Any] = {
        "verdict": give_verdict(calibration, numbers),
        "input": numbers.source,
        "sha256": numbers.sha256,
        "quantities": numbers.quantities,
        "diagnostics": numbers.diagnostics,
        "cannot_show": cannot_show(calibration),
    }
    if comparison is not None:
        record["comparison"] = {
            "places_px": comparison.places_px.tolist(),
            "distance_mm": comparison.distance_mm.tolist(),
            "allowed_mm": comparison.allowed_mm.tolist(),
            "p_value": comparison.p_value,
            "shared_input": comparison.shared_input,
        }
    return record
