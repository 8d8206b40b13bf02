"""Every format that sonocal reads, joined from the rooms that read them: for ``info``, ``calibrate`` and the docs.

Recordings list theirs in `sonocal.recording.formats.registry`, targets in `sonocal.targets.formats`. Tables and
calibrations are listed here, since their rooms are heavy: they are imported when such a file is read.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from sonocal.errors import InputError, UnsupportedError
from sonocal.files.kinds import TABLE_SUFFIXES, Format, Head, Kind, recognise, refuse_container, suffixes_of
from sonocal.recording.formats import pose_csv
from sonocal.recording.formats.registry import FORMATS as RECORDINGS
from sonocal.recording.formats.registry import refuse_table
from sonocal.targets.formats import FORMATS as TARGETS

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.detection import Detections
    from sonocal.geometry import Array
    from sonocal.observations import Observations
    from sonocal.targets import Line
    from sonocal.validation import PointSightings

__all__ = ["FORMATS", "calibration_in", "format_of", "kind_of", "lines_in", "require_kind", "table"]


def format_of(path: Path) -> Format:
    """The format that a file is in.

    Raises:
        InputError: it cannot be read.
        UnsupportedError: it is in none that sonocal reads.
    """
    head = Head.of(path)
    if found := recognise(head, FORMATS):
        return found
    refuse_container(head)
    refuse_table(head)
    raise UnsupportedError(
        f"{path.name}: is {head.looks_like} in no format that sonocal reads; it reads {_what_is_read()}"
    )


def kind_of(path: Path) -> Kind | None:
    """What is in a file; None where it is in no format that sonocal reads."""
    found = recognise(Head.of(path), FORMATS)
    return None if found is None else found.kind


def require_kind(path: Path, wanted: tuple[Kind, ...], advice: str) -> None:
    """Raise if a file is known to be something else; damaged files are left to their reader's sentences.

    Args:
        path: a file; of a directory its reader speaks.
        wanted: what it may be.
        advice: what to give instead.

    Raises:
        InputError: it cannot be read, or is of another kind.
    """
    if path.is_dir():
        return
    head = Head.of(path)
    found = recognise(head, FORMATS)
    if found is not None and found.kind not in wanted:
        raise InputError(f"{path.name}: is {_KINDS[found.kind]}; {advice}")
    if found is None:
        refuse_container(head)
    if head.is_page:
        raise InputError(f"{path.name}: is {head.looks_like} and not {_KINDS[wanted[0]]}; {advice}")


def calibration_in(path: Path) -> Calibration:
    """The calibration in a file that the command line was given.

    Raises:
        InputError: the file cannot be read, or is something else; the sentence says what.
        FormatError: it is damaged.
    """
    from sonocal.calibration import load_calibration

    require_kind(path, ("calibration",), "name the calibration.json that sonocal calibrate wrote")
    return load_calibration(path)


def lines_in(path: Path) -> tuple[tuple[Line, ...], Mapping[tuple[str, str], Array]]:
    """The needle or wires in a file that the command line was given, as `sonocal.targets.read_lines` reads them.

    Raises:
        InputError: the file cannot be read, or is something else; the sentence says what.
        FormatError: it is damaged.
    """
    from sonocal.targets import read_lines

    require_kind(
        path, ("targets", "device set"), "name a file of needles or wires (.toml), or a device set (.xml)"
    )
    return read_lines(path)


def table() -> str:
    """The formats as the table of docs/formats.md."""
    rows = [
        "| format | files | read as | what of it | written | needs |",
        "|---|---|---|---|---|---|",
    ]
    return "\n".join([*rows, *map(_row, sorted(FORMATS, key=lambda one: one.kind != "recording"))])


def _row(one: Format) -> str:
    files = _quoted(one.suffixes) or "a folder"
    if one.header:
        files += f" with {one.header}"
    return (
        f"| {one.name} | {files} | {one.kind} | {one.holds} | {_quoted(one.writes)} | {_quoted(one.needs)} |"
    )


def _quoted(words: Iterable[str]) -> str:
    return ", ".join(f"`{word}`" for word in words)


def _what_is_read() -> str:
    plain = [one for one in FORMATS if not one.header]
    kinds = dict.fromkeys(one.kind for one in plain)
    files = [f"{_plural(kind)} ({suffixes_of(one for one in plain if one.kind == kind)})" for kind in kinds]
    tables = [one for one in FORMATS if one.header]
    free = [
        f"{one.header} ({one.name})" for one in tables if one.kind != "recording" or one is pose_csv.FORMAT
    ]
    logs = [one.name for one in tables if one.kind == "recording" and one is not pose_csv.FORMAT]
    logged, free_ones = ", ".join(logs), "; ".join(free)
    return f"{', '.join(files)}, folders of images, logs of trackers ({logged}), and tables with {free_ones}"


_KINDS: dict[Kind, str] = {
    "calibration": "a JSON file",
    "device set": "a device set of PLUS",
    "known points": "a table of points whose place is known",
    "observations": "a table of sightings",
    "points": "a table of points found in images",
    "recording": "a recording",
    "targets": "a file of needles, wires or points",
}


def _plural(kind: Kind) -> str:
    return kind if kind.endswith("s") else f"{kind}s"


def _observations(path: Path) -> Observations:
    from sonocal.observations import read_observations

    return read_observations(path)


def _write_observations(observations: Observations, path: Path) -> None:
    from sonocal.observations import write_observations

    write_observations(observations, path)


def _detections(path: Path) -> Detections:
    from sonocal.detection import read_detections

    return read_detections(path)


def _known_points(path: Path) -> PointSightings:
    from sonocal.validation import read_point_sightings

    return read_point_sightings(path)


def _write_calibration(calibration: Calibration, path: Path) -> None:
    calibration.save(path)


def _has_known_place(head: Head) -> bool:
    return not {"x_mm", "probe_00"}.isdisjoint(head.columns)


def _is_points(head: Head) -> bool:
    return "u_px" in head.columns and "x0_mm" not in head.columns


TABLES: tuple[Format, ...] = (
    Format(
        name="table of sightings",
        kind="observations",
        suffixes=TABLE_SUFFIXES,
        header="the column x0_mm",
        sniff=lambda head: "x0_mm" in head.columns,
        read=_observations,
        holds="points of images against lines, with further columns",
        write=_write_observations,
        writes=(".csv",),
    ),
    Format(
        name="points found in images",
        kind="points",
        suffixes=TABLE_SUFFIXES,
        header="the column u_px",
        sniff=lambda head: _is_points(head) and not _has_known_place(head),
        read=_detections,
        holds="for `--points`, with the recording that they were found in",
    ),
    Format(
        name="points whose place is known",
        kind="known points",
        suffixes=TABLE_SUFFIXES,
        header="the columns u_px and x_mm or probe_00",
        sniff=lambda head: _is_points(head) and _has_known_place(head),
        read=_known_points,
        holds="for `sonocal validate --crosswire`",
    ),
)
CALIBRATIONS: tuple[Format, ...] = (
    Format(
        name="calibration",
        kind="calibration",
        suffixes=(".json",),
        sniff=lambda head: head.text.startswith(b"{"),
        read=calibration_in,
        holds="all that `sonocal calibrate` found",
        write=_write_calibration,
        writes=(".json",),
    ),
)
# Tables of sightings come before tables of poses: their further columns are free.
FORMATS: tuple[Format, ...] = (*TABLES, *TARGETS, *CALIBRATIONS, *RECORDINGS)
