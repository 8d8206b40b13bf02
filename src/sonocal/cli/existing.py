"""Matrices of other software on the command line: which of a file is meant, and what ``validate`` does with one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.options import console, typed
from sonocal.cli.others import apart_record, called, reread_records
from sonocal.cli.screen.plain import say, say_json
from sonocal.files import write_into_folder

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.cli.measured import Measured
    from sonocal.existing import Choice, Existing
    from sonocal.existing.compared import Compared
    from sonocal.existing.worth import Said, Worth

__all__ = [
    "choice_of",
    "of_other_software",
    "refuse_choice",
    "validate_existing",
]

CHOICE = ("transform", "stored_as")
# What needs a calibration of ours: it has observations and an uncertainty.
OF_OURS = {
    "expected": "compare it with --compare instead",
    "marker_above_image": "compare it with --compare instead",
}


def of_other_software(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options --transform and --stored-as."""
    for option in (
        click.option(
            "--stored-as",
            type=click.Choice(["direct", "inverse", "slicer"]),
            help="Of a file of other software: px to mm, its inverse, or as 3D Slicer does.  [default: by the file]",
        ),
        click.option(
            "--transform",
            metavar="NAME",
            help="Of a file of other software: the matrix to take.  [default: the one from the image, ImageToProbe]",
        ),
    ):
        command = option(command)
    return command


def choice_of(options: dict[str, Any]) -> Choice:
    """What these options say, taken out of all."""
    from sonocal.existing import Choice

    return Choice(**{name: options.pop(name) for name in CHOICE})


def refuse_choice(*files: Calibration | Existing | None) -> None:
    """Options that would do nothing are a mistake."""
    from sonocal.existing import Existing

    if not any(isinstance(one, Existing) for one in files) and (names := typed(CHOICE)):
        raise click.UsageError(
            f"{names[0]} is for files of other software; calibration.json holds one matrix"
        )


def validate_existing(
    existing: Existing,
    other: Calibration | Existing | None,
    measured: Measured,
    *,
    name: str,
    split: str | None,
    scanner_mm_per_px: float | None,
    page: Path | None,
    as_json: bool,
) -> None:
    """Show what a matrix is worth: measured, and beside our own calibration of the same rows; write the page.

    Args:
        existing: the matrix.
        other: what it is compared with, where that was asked for.
        measured: what it is measured on.
        name: of the other, as it was given.
        split: rows to measure on.
        scanner_mm_per_px: what the scanner says.
        page: to write, where one is wanted.
        as_json: print for programs.
    """
    from sonocal.cli.matrix_report import matrix_report_files
    from sonocal.cli.screen.existing import print_worth
    from sonocal.existing.compared import worth_compared

    for option, instead in OF_OURS.items():
        if wrong := typed((option,)):
            raise click.UsageError(f"{wrong[0]} is for calibration.json; of {existing.file} {instead}")
    worth = _measured(existing, measured, split, scanner_mm_per_px)
    area = _seen(measured) if worth.own is None else worth.own.area_px
    beside = None
    if other is not None:
        worth, beside = worth_compared(worth, other, area, name)
    against = {} if beside is None else {called(other, name): beside.difference}
    files = {} if page is None else matrix_report_files(worth, against, area, name=page.name)
    if page is not None:
        write_into_folder(page.parent, files)
    if as_json:
        say_json(_record(worth, other, beside))
        return
    print_worth(console(), worth, against)
    if files:
        say(f"Wrote {page}")


def _measured(
    existing: Existing, measured: Measured, split: str | None, scanner_mm_per_px: float | None
) -> Worth:
    """What a matrix is worth on INPUT."""
    from sonocal.existing.worth import worth_of, worth_on_points

    if measured.points is not None:
        return worth_on_points(existing, measured.points)
    worth = worth_of(
        existing,
        measured.sightings,
        split=split,
        nwires=measured.nwires,
        own=measured.own,
        said=_said(scanner_mm_per_px, measured),
    )
    return worth if measured.recording is None else replace(worth, source=measured.recording.name)


def _said(scanner_mm_per_px: float | None, measured: Measured) -> Said | None:
    """What the user says of the mm/px, or else the recording."""
    from sonocal.existing.worth import Said
    from sonocal.recording import stated_scale

    if scanner_mm_per_px is not None:
        return Said((scanner_mm_per_px,), "the scanner")
    stated = None if measured.recording is None else stated_scale(measured.recording)
    return None if stated is None else Said(stated.mm_per_px, f"the recording ({stated.where})")


def _seen(measured: Measured) -> Any:
    """(2, d) px: what was seen of the image."""
    import numpy as np

    points = measured.points.points_px if measured.points is not None else measured.sightings.points_px
    return np.array([points.min(axis=0), points.max(axis=0)])


def _record(worth: Worth, other: Calibration | Existing | None, beside: Compared | None) -> dict[str, Any]:
    from sonocal.cli.screen.existing import existing_record
    from sonocal.existing.worth import MATRIX_ALONE
    from sonocal.validation import give_verdict

    record: dict[str, Any] = {
        "sentence": worth.sentence,
        "scale_sentence": worth.scale_sentence,
        "matrix": existing_record(worth.existing),
        "input": worth.source,
        "sha256": worth.sha256,
        "quantities": worth.quantities,
        "diagnostics": worth.diagnostics,
        "cannot_show": [MATRIX_ALONE],
    }
    if worth.own is not None:
        record["own"] = {
            "verdict": give_verdict(worth.own),
            "model": worth.own.model,
            "probe_from_image": worth.own.probe_from_image.matrix,
            "quantities": worth.own_quantities,
        }
    if worth.difference is not None:
        record["difference"] = apart_record(worth.difference)
    record["rereadings"] = reread_records(worth.existing, worth.rereadings)
    if worth.reread_quantities:
        record["rereadings"][0]["quantities"] = worth.reread_quantities
    if beside is not None:
        record["comparison"] = apart_record(beside.difference)
        record["rereadings"] += reread_records(other, beside.rereadings)
    return record
