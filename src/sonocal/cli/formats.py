"""Every format that sonocal reads, joined from the rooms that read them: for ``info``, ``calibrate`` and the docs.

Recordings list theirs in `sonocal.recording.formats.registry`, targets in `sonocal.targets.formats`, matrices of other
software in `sonocal.existing.formats`. Tables and calibrations are listed here, since their rooms are heavy: they are
imported when such a file is read.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from sonocal.errors import InputError, UnsupportedError
from sonocal.existing.formats import FORMATS as MATRICES
from sonocal.existing.formats import read_existing
from sonocal.files.elsewhere import (
    NAMES,
    USES,
    is_checks,
    is_known_points,
    is_observations,
    is_own_page,
    is_points,
    is_study,
    is_truth,
)
from sonocal.files.kinds import TABLE_SUFFIXES, Format, Head, Kind, recognise, refuse_container, suffixes_of
from sonocal.recording.formats import pose_csv
from sonocal.recording.formats.registry import FORMATS as RECORDINGS
from sonocal.recording.formats.registry import refuse_table
from sonocal.targets.formats import FORMATS as TARGETS

if TYPE_CHECKING:
    from sonocal.calibration import Calibration
    from sonocal.detection import Detections
    from sonocal.existing import Choice, Existing
    from sonocal.geometry import Array
    from sonocal.observations import Observations
    from sonocal.report.page_file import Page
    from sonocal.simulation.truth_file import KnownTruth
    from sonocal.studies.results_file import StudyResults
    from sonocal.targets import Line, Target, Unplaced
    from sonocal.validation import CheckLog, PointSightings

__all__ = [
    "FORMATS",
    "calibration_in",
    "format_of",
    "kind_of",
    "lines_in",
    "own_calibration_in",
    "require_kind",
    "table",
]


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


def require_kind(path: Path, wanted: tuple[Kind, ...], advice: str = "") -> None:
    """Raise if a file is known to be something else; damaged files are left to their reader's sentences.

    Args:
        path: a file; of a directory its reader speaks.
        wanted: what it may be.
        advice: what to give instead; else, who takes such a file.

    Raises:
        InputError: it cannot be read, or is of another kind.
    """
    if path.is_dir():
        return
    head = Head.of(path)
    found = recognise(head, FORMATS)
    if found is not None and found.kind not in wanted:
        raise InputError(f"{path.name}: is {NAMES[found.kind]}; {advice or USES[found.kind]}")
    if found is None:
        refuse_container(head)
    if head.is_page:
        raise InputError(
            f"{path.name}: is {head.looks_like} and not {NAMES[wanted[0]]}; {advice or 'download the file itself'}"
        )


def calibration_in(path: Path, choice: Choice | None = None) -> Calibration | Existing:
    """The calibration in a file that the command line was given: ours, or the matrix of other software.

    Args:
        path: the file.
        choice: which matrix of a file of other software, and which way it goes.

    Raises:
        InputError: the file cannot be read, or is something else; the sentence says what.
        FormatError: it is damaged.
    """
    from sonocal.calibration import load_calibration

    require_kind(path, CALIBRATION_KINDS, ADVICE)
    kind = None if path.is_dir() else kind_of(path)
    of_matrices = {suffix for one in MATRICES for suffix in one.suffixes}
    if kind == "calibration" or (kind is None and path.suffix.lower() not in of_matrices):
        return load_calibration(path)
    return read_existing(path, choice)


def own_calibration_in(path: Path) -> Calibration:
    """Our own calibration in a file. Raises as `calibration_in`."""
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


def targets_in(path: Path) -> tuple[tuple[Target | Unplaced, ...], Mapping[tuple[str, str], Array]]:
    """Points, lines and planes in a file that the command line was given, placed or not. Raises as `lines_in`."""
    from sonocal.targets import read_targets_and_fixed, read_unplaced

    require_kind(path, ("targets", "device set"), "name a file of targets (.toml), or a device set (.xml)")
    unplaced = read_unplaced(path)
    try:
        known, fixed = read_targets_and_fixed(path)
    except InputError:
        if not unplaced:
            raise
        return unplaced, {}
    return (*known, *unplaced), fixed


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
    plain = [one for one in FORMATS if not one.header and one not in OTHER_RECORDS]
    kinds = dict.fromkeys(one.kind for one in plain)
    files = [f"{_plural(kind)} ({suffixes_of(one for one in plain if one.kind == kind)})" for kind in kinds]
    tables = [one for one in FORMATS if one.header]
    free = [
        f"{one.header} ({one.name})" for one in tables if one.kind != "recording" or one is pose_csv.FORMAT
    ]
    logs = [one.name for one in tables if one.kind == "recording" and one is not pose_csv.FORMAT]
    logged, free_ones = ", ".join(logs), "; ".join(free)
    return f"{', '.join(files)}, folders of images, logs of trackers ({logged}), and tables with {free_ones}"


CALIBRATION_KINDS: tuple[Kind, ...] = ("calibration", "device set", "matrix")
ADVICE = (
    "name the calibration.json that sonocal calibrate wrote, or a matrix of other software: a device set of PLUS "
    "(.xml), a transform (.tfm, .h5), a 4 x 4 (text, .npy)"
)


def _plural(kind: Kind) -> str:
    return {"matrix": "matrices", "study": "studies"}.get(kind, kind if kind.endswith("s") else f"{kind}s")


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


def _study(path: Path) -> StudyResults:
    from sonocal.studies.results_file import read_results

    return read_results(path)


def _truth(path: Path) -> KnownTruth:
    from sonocal.simulation.truth_file import read_truth

    return read_truth(path)


def _checks(path: Path) -> CheckLog:
    from sonocal.validation import read_check_log

    return read_check_log(path)


def _page(path: Path) -> Page:
    from sonocal.report.page_file import read_page

    return read_page(path)


def _write_calibration(calibration: Calibration, path: Path) -> None:
    calibration.save(path)


TABLES: tuple[Format, ...] = (
    Format(
        name="table of sightings",
        kind="observations",
        suffixes=TABLE_SUFFIXES,
        header="the column x0_mm or probe_from_target_00",
        sniff=is_observations,
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
        sniff=is_points,
        read=_detections,
        holds="for `--points`, with the recording that they were found in",
    ),
    Format(
        name="points whose place is known",
        kind="known points",
        suffixes=TABLE_SUFFIXES,
        header="the columns u_px and x_mm or probe_00",
        sniff=is_known_points,
        read=_known_points,
        holds="for `sonocal validate --crosswire`",
    ),
)
# Beside calibrations: what else is written, and read by `sonocal info` alone.
OTHER_RECORDS: tuple[Format, ...] = (
    Format(
        name="results of a study",
        kind="study",
        suffixes=(".json", ".csv"),
        sniff=is_study,
        read=_study,
        holds="what `sonocal study` answered, from its folder or a file in it",
    ),
    Format(
        name="truth of a simulated sweep",
        kind="truth",
        suffixes=(".json",),
        sniff=is_truth,
        read=_truth,
        holds="what `sonocal simulate` made it with",
    ),
    Format(
        name="log of checks",
        kind="checks",
        suffixes=(".jsonl",),
        sniff=is_checks,
        read=_checks,
        holds="what `sonocal check` said of a calibration, a line a check",
    ),
    Format(
        name="page of sonocal",
        kind="page",
        suffixes=(".html",),
        sniff=is_own_page,
        read=_page,
        holds="the verdict and the matrix of `report.html` and `validation.html`",
    ),
)
CALIBRATIONS: tuple[Format, ...] = (
    Format(
        name="calibration",
        kind="calibration",
        suffixes=(".json",),
        sniff=lambda head: head.text.startswith(b"{") and not any(one.sniff(head) for one in OTHER_RECORDS),
        read=own_calibration_in,
        holds="all that `sonocal calibrate` found",
        write=_write_calibration,
        writes=(".json",),
    ),
)
# Tables of sightings come before tables of poses: their further columns are free.
FORMATS: tuple[Format, ...] = (*TABLES, *OTHER_RECORDS, *TARGETS, *CALIBRATIONS, *MATRICES, *RECORDINGS)
