"""What a user says of the set-up on the command line: where the marker is, which calibration to expect, which units."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import click

from sonocal.cli.options import FILE
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.existing import Existing
    from sonocal.findings import Diagnostic
    from sonocal.geometry import Array
    from sonocal.observations import Observations
    from sonocal.recording import Recording
    from sonocal.targets import Line

__all__ = [
    "ACCEPT_UNITS",
    "EXPECTED",
    "MARKER_ABOVE",
    "refuse_units",
    "rotation_of",
    "table_doubts",
    "unit_doubts",
]

MARKER_ABOVE = click.option(
    "--marker-above",
    "marker_above_image",
    is_flag=True,
    help="The marker is on the handle, beyond the upper half of the image: a 2D image that says else is flipped.",
)
EXPECTED = click.option(
    "--expected",
    type=FILE,
    metavar="CALIBRATION",
    help="A calibration, ours or of other software, that is turned roughly as this one must be.",
)
ACCEPT_UNITS = click.option(
    "--accept-units",
    is_flag=True,
    help="Go on where lengths do not look like mm, or places not like px.  [default: exit with status 1]",
)


def rotation_of(found: Calibration | Existing) -> Array:
    """(3, 3): of u, v and their normal, whatever shear a matrix of other software has."""
    from sonocal.existing import Existing, meaning_of

    return (
        meaning_of(found.matrix).rotation if isinstance(found, Existing) else found.probe_from_image.rotation
    )


def unit_doubts(
    recording: Recording | None = None, lines: Iterable[Line] = (), rows: Observations | None = None
) -> list[Diagnostic]:
    """The doubts that what was read is in mm and px, before anything is fitted to it."""
    from sonocal.geometry.units import length_hints, needle_hints, unit_doubt
    from sonocal.observations.spanning import lengths_of
    from sonocal.recording.lengths import unit_findings

    found = [] if recording is None else [*unit_findings(recording)]
    for line in lines:
        length = float(sum((line.segment_mm[1] - line.segment_mm[0]) ** 2) ** 0.5)
        found += unit_doubt(needle_hints(f"the line {line.name!r}", length))
    if rows is not None:
        found += unit_doubt(length_hints(rows.points_px, lengths_of(rows.spans, rows.segments_mm)))
    return found


def table_doubts(rows: Observations) -> list[Diagnostic]:
    """The doubts that a table's lengths are mm and its places px, those that only its calibration shows among them."""
    from sonocal.calibration import calibrate
    from sonocal.calibration.evidence import evidence_of
    from sonocal.errors import SonocalError
    from sonocal.geometry.units import UNITS_CODE
    from sonocal.setup_checks.units import check_units

    if found := unit_doubts(rows=rows):
        return found
    try:
        calibration = calibrate(rows)
        if not rows.lines_only:
            return [one for one in calibration.diagnostics if one.code == UNITS_CODE]
        return [*check_units(evidence_of(calibration, rows))]
    except SonocalError:  # rows that have no calibration have no scale
        return []


def refuse_units(name: str, findings: Iterable[Diagnostic], *, accepted: bool) -> None:
    """Refuse what is in doubtful units, unless the user goes on.

    Args:
        name: what messages call the input.
        findings: of which some may be such a doubt.
        accepted: whether the user said to go on.

    Raises:
        InputError: a unit is doubted; the sentence says which, why and what to do.
    """
    from sonocal.geometry.units import UNITS_CODE

    doubt = next((one for one in findings if one.code == UNITS_CODE), None)
    if doubt is not None and not accepted:
        raise InputError(f"{name}: {doubt.message.removeprefix(f'{name}: ')}; {doubt.advice}")
