"""What a user says of the set-up on the command line: where the marker is, which calibration to expect, which units."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

from sonocal.cli.options import FILE
from sonocal.errors import InputError

if TYPE_CHECKING:
    from sonocal.findings import Diagnostic
    from sonocal.geometry import Array
    from sonocal.observations import Observations
    from sonocal.recording import Recording
    from sonocal.targets import Line

__all__ = [
    "ACCEPT_UNITS",
    "EXPECTED",
    "MARKER_ABOVE",
    "expected_rotation",
    "refuse_units",
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
    help="A calibration (JSON, or a PLUS device set) that is turned roughly as this one must be.",
)
ACCEPT_UNITS = click.option(
    "--accept-units",
    is_flag=True,
    help="Go on where lengths do not look like mm, or places not like px.  [default: exit with status 1]",
)


def expected_rotation(path: Path | None) -> Array | None:
    """The rotation of another calibration: of our file, or of a device set's ImageToProbe.

    Raises:
        InputError: the file holds none.
    """
    from sonocal.cli.formats import calibration_in, kind_of

    if path is None:
        return None
    if kind_of(path) == "device set":
        return _of_device_set(path)
    return calibration_in(path).probe_from_image.rotation


def _of_device_set(path: Path) -> Array:
    import numpy as np

    from sonocal.targets import read_device_set

    matrices = read_device_set(path).transforms
    found = {name: matrix for name, matrix in matrices.items() if name[1] == "Image"}
    if len(found) != 1:
        raise InputError(
            f"{path.name}: has {len(found)} transforms from Image where it must have one, such as ImageToProbe; it has "
            + (", ".join(f"{source}To{target}" for target, source in matrices) or "none")
        )
    (matrix,) = found.values()
    return np.asarray(matrix[:3, :3] / np.linalg.norm(matrix[:3, :3], axis=0))


def unit_doubts(
    recording: Recording | None = None, lines: Iterable[Line] = (), rows: Observations | None = None
) -> list[Diagnostic]:
    """The doubts that what was read is in mm and px, before anything is fitted to it."""
    from sonocal.geometry.units import length_hints, needle_hints, unit_doubt
    from sonocal.recording.lengths import unit_findings

    found = [] if recording is None else [*unit_findings(recording)]
    for line in lines:
        length = float(sum((line.segment_mm[1] - line.segment_mm[0]) ** 2) ** 0.5)
        found += unit_doubt(needle_hints(f"the line {line.name!r}", length))
    if rows is not None:
        found += unit_doubt(length_hints(rows.points_px, rows.segments_mm))
    return found


def table_doubts(rows: Observations) -> list[Diagnostic]:
    """The doubts that a table's lengths are mm and its places px, those that only its calibration shows among them."""
    from sonocal.calibration import calibrate
    from sonocal.calibration.evidence import evidence_of
    from sonocal.errors import SonocalError
    from sonocal.setup_checks.units import check_units

    if found := unit_doubts(rows=rows):
        return found
    try:
        return [*check_units(evidence_of(calibrate(rows), rows))]
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
