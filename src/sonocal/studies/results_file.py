"""What a study found, from the folder of its results: ``summary.json``, or the manifest of a run that goes on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from sonocal.errors import FormatError
from sonocal.files import read_bytes
from sonocal.geometry.shown import brief
from sonocal.studies.definition import Study
from sonocal.studies.store import MANIFEST
from sonocal.studies.summary import Row

__all__ = ["StudyResults", "read_results"]

SUMMARY, TABLE = "summary.json", "summary.csv"


@dataclass(frozen=True, eq=False)
class StudyResults:
    """What a study found.

    Attributes:
        name: of the file.
        study: what was simulated.
        answers: sentences; none of a run that goes on.
        rows: errors by cell, method, stage and quantity; none of a run that goes on.
    """

    name: str
    study: Study
    answers: tuple[str, ...] = ()
    rows: tuple[Row, ...] = ()

    __repr__ = brief


class _Summary(msgspec.Struct):
    """The fields that are read."""

    study: Study
    answers: list[str] = []
    rows: list[dict[str, Any]] = []


def read_results(path: Path) -> StudyResults:
    """Read a folder of results, or one of the files in it.

    Raises:
        InputError: it cannot be read.
        FormatError: it is damaged.
    """
    file = _whole(path)
    try:
        record = msgspec.json.decode(read_bytes(file), type=_Summary)
        rows = tuple(msgspec.convert(_numbers(row), Row) for row in record.rows)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise FormatError(
            f"{path.name}: is a damaged file of a study's results ({error}); run the study again, which takes what is "
            "there"
        ) from None
    return StudyResults(path.name, record.study, tuple(record.answers), rows)


def _whole(path: Path) -> Path:
    """The file with most in it: the summary, of a run that goes on the manifest."""
    if path.is_file() and path.suffix.lower() != ".csv" and path.name != MANIFEST:
        return path
    folder = path if path.is_dir() else path.parent
    if (folder / SUMMARY).is_file():
        return folder / SUMMARY
    if path.suffix.lower() == ".csv":
        raise FormatError(f"{path.name}: is a table of a study without {SUMMARY} beside it; name that file")
    return folder / MANIFEST if path.is_dir() else path


def _numbers(row: dict[str, Any]) -> dict[str, Any]:
    """A row whose numbers that are no numbers, null in the file, are numbers again."""
    return {name: float("nan") if value is None else value for name, value in row.items()}
