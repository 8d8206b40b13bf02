"""What a calibration is measured on: a table of sightings, a table of known points, or a recording with its needle."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from sonocal.cli.from_recording import OF_DETECTION, from_recording
from sonocal.cli.options import typed
from sonocal.cli.reading import OF_READING
from sonocal.errors import InputError, UnsupportedError

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.existing import Existing
    from sonocal.geometry import AxisScaled
    from sonocal.observations import Observations
    from sonocal.recording import Recording
    from sonocal.validation import PointSightings

__all__ = ["OF_RECORDINGS", "Measured", "read_measured"]

OF_RECORDINGS = ("points", "probe", *OF_READING, *OF_DETECTION)
NWires = tuple[tuple[str, str, str], ...]


@dataclass(frozen=True)
class Measured:
    """What INPUT holds.

    Attributes:
        rows: sightings, of a table or of a recording.
        points: points whose place is known, of a table.
        own: of a recording, our calibration from it, by which its sightings were chosen.
        recording: the recording.
        nwires: the wires of each N, where they are told.
    """

    rows: Observations | None = None
    points: PointSightings | None = None
    own: Calibration | None = None
    recording: Recording | None = None
    nwires: NWires = ()

    @property
    def sightings(self) -> Observations:
        """The rows of what is no table of known points."""
        assert self.rows is not None
        return self.rows


def read_measured(
    source: Path,
    lines: Path | None,
    recorded: dict[str, Any],
    found: Calibration | Existing,
    *,
    crosswire: bool,
    nwires: NWires,
    split: str | None,
) -> Measured:
    """Read INPUT; of a recording, find the needle in its images and calibrate with it.

    Args:
        source: the table or the recording.
        lines: of a recording: the needle or wires.
        recorded: options of recordings and of detection.
        found: what is measured: of a recording, sightings may be chosen by it, and ours has the same model.
        crosswire: a table is of points, whatever its columns.
        nwires: as given; of a recording by default those of its device set.
        split: as given.

    Raises:
        SonocalError: it cannot be read, is something else, or has no sightings.
    """
    if lines is None:
        return _table(source, crosswire=crosswire, nwires=nwires)
    if crosswire or split is not None:
        raise click.UsageError(
            f"{'--crosswire' if crosswire else '--split'} is for tables; leave out --lines"
        )
    options, start = _like(found)
    try:
        result = from_recording(source, lines, None, recorded, options, start=start)
    except UnsupportedError:  # of a volume: ours has one scale, whatever the matrix has
        if options["model"] == "similarity":
            raise
        result = from_recording(source, lines, None, recorded, {"model": "similarity"}, start=start)
    return Measured(result.rows, None, result.calibration, result.recording, nwires or _patterns(lines))


def _like(found: Calibration | Existing) -> tuple[dict[str, Any], AxisScaled]:
    """Options of a calibration as one that is there, and where to start."""
    from sonocal.existing import Existing
    from sonocal.existing.meaning import unsheared
    from sonocal.existing.worth import model_like

    if isinstance(found, Existing):
        return {"model": model_like(found, 2)}, unsheared(found.matrix)
    return {"model": found.model}, found.probe_from_image


def _table(source: Path, *, crosswire: bool, nwires: NWires) -> Measured:
    from sonocal.cli.formats import kind_of, require_kind
    from sonocal.files import read_bytes
    from sonocal.files.kinds import Head
    from sonocal.observations import parse_observations
    from sonocal.validation import parse_point_sightings

    if names := typed((*OF_RECORDINGS, "accept_units")):
        raise click.UsageError(f"{names[0]} is for recordings; give their needle or wires with --lines")
    if source.is_dir():
        raise InputError(
            f"{source}: is a directory; name a table in it, or say with --lines what its images show"
        )
    if kind_of(source) == "recording":
        raise InputError(
            f"{source.name}: is a recording; say with --lines which needle or wires were seen in it"
        )
    advice = "give a table of sightings, or of points whose place is known (CSV), or a recording with --lines"
    require_kind(source, ("observations", "known points"), advice)
    content = read_bytes(source)
    header = Head(Path(source.name), content).columns
    if crosswire or (not {"x0_mm", "probe_from_target_00"} & set(header) and "u_px" in header):
        return Measured(points=parse_point_sightings(content, source.name))
    return Measured(parse_observations(content, source.name), nwires=nwires)


def _patterns(lines: Path) -> NWires:
    """The Ns of a phantom that a device set describes."""
    from sonocal.cli.formats import kind_of
    from sonocal.targets import read_device_set

    if kind_of(lines) != "device set":
        return ()
    patterns = [tuple(names) for names in read_device_set(lines).patterns if len(names) == 3]
    return tuple((left, middle, right) for left, middle, right in patterns)
