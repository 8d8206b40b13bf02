"""Matrices of other software on the command line: which of a file is meant, and what ``validate`` does with one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.options import console, typed
from sonocal.cli.screen.plain import say, say_json
from sonocal.files import write_into_folder

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.cli.measured import Measured
    from sonocal.existing import Choice, Existing
    from sonocal.existing.difference import Difference
    from sonocal.existing.worth import Said, Worth

__all__ = [
    "apart_record",
    "choice_of",
    "of_other_software",
    "print_apart",
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
    split: str | None,
    scanner_mm_per_px: float | None,
    page: Path | None,
    as_json: bool,
) -> None:
    """Show what a matrix is worth: measured, and beside our own calibration of the same rows; write the page."""
    from sonocal.cli.matrix_report import matrix_report_files
    from sonocal.cli.screen.existing import print_worth
    from sonocal.existing.difference import difference
    from sonocal.existing.worth import worth_of, worth_on_points

    for name, instead in OF_OURS.items():
        if wrong := typed((name,)):
            raise click.UsageError(f"{wrong[0]} is for calibration.json; of {existing.file} {instead}")
    if measured.points is not None:
        worth = worth_on_points(existing, measured.points)
        seen = measured.points.points_px
    else:
        rows = measured.sightings
        seen = rows.points_px
        worth = worth_of(
            existing,
            rows,
            split=split,
            nwires=measured.nwires,
            own=measured.own,
            said=_said(scanner_mm_per_px, measured),
        )
        if measured.recording is not None:
            worth = replace(worth, source=measured.recording.name)
    area = _box(seen) if worth.own is None else worth.own.area_px
    apart = None if other is None else difference(existing, other, area, "the other")
    files = {} if page is None else matrix_report_files(worth, apart, name=page.name)
    if page is not None:
        write_into_folder(page.parent, files)
    if as_json:
        say_json(_record(worth) | ({} if apart is None else {"comparison": apart_record(apart)}))
        return
    print_worth(console(), worth, apart)
    if files:
        say(f"Wrote {page}")


def _said(scanner_mm_per_px: float | None, measured: Measured) -> Said | None:
    """What the user says of the mm/px, or else the recording."""
    from sonocal.existing.worth import Said
    from sonocal.recording import stated_scale

    if scanner_mm_per_px is not None:
        return Said((scanner_mm_per_px,), "the scanner")
    stated = None if measured.recording is None else stated_scale(measured.recording)
    return None if stated is None else Said(stated.mm_per_px, f"the recording ({stated.where})")


def _box(points_px: Any) -> Any:
    import numpy as np

    return np.array([points_px.min(axis=0), points_px.max(axis=0)])


def _record(worth: Worth) -> dict[str, Any]:
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
    return record | ({} if worth.difference is None else {"difference": apart_record(worth.difference)})


def print_apart(apart: Difference) -> None:
    """Show how far a matrix of other software is from a calibration of ours."""
    from sonocal.cli.screen.existing import print_difference

    print_difference(console(), apart, "The other calibration against this one, mm")


def apart_record(apart: Difference) -> dict[str, Any]:
    """The same for programs."""
    return {
        "places_px": apart.places_px,
        "difference_mm": apart.difference_mm,
        "distance_mm": apart.distance_mm,
        "known_mm": apart.known_mm,
        "rotation_deg": apart.rotation_deg,
        "scales_mm_per_px": apart.scales_mm_per_px,
        "other_scales_mm_per_px": apart.other_scales_mm_per_px,
        "sentence": apart.sentence,
    }
