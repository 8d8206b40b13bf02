"""The log of a calibration's checks: a line of JSON for each, in a file beside it, to which lines are only added."""

from __future__ import annotations

import datetime
import os
from codecs import BOM_UTF8
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from sonocal.errors import FormatError, InputError, require
from sonocal.files import path_of, read_bytes
from sonocal.geometry.shown import brief
from sonocal.validation.check_result import Check

__all__ = ["CHECKS_FORMAT", "CheckLog", "CheckRecord", "append_check", "check_log_path", "read_check_log"]

CHECKS_FORMAT, VERSION = "sonocal-check", 1
ENDING = ".checks.jsonl"


@dataclass(frozen=True)
class CheckRecord:
    """A line of the log.

    Attributes:
        format, version: what the line is.
        checked: when, ISO 8601, UTC.
        verdict: "holds", "changed" or "cannot tell".
        moved_mm, turned_deg, scale_change: the change seen.
        p_value: of its test.
        tolerance_mm: the change that matters.
        power_mean, power_least: what share of changes of that size the sweep would have shown.
        visible_mm: the least change seen whichever way it goes; None: some is never seen.
        rows: sightings that it rests on.
        calibration, calibration_sha256: the file that was in doubt.
        sweep, sweep_sha256: the recording or table.
        codes: of the findings.
        sonocal: the version.
    """

    checked: str
    verdict: str
    moved_mm: float
    turned_deg: float
    scale_change: float
    p_value: float
    tolerance_mm: float
    power_mean: float
    power_least: float
    visible_mm: float | None
    rows: int
    calibration: str = ""
    calibration_sha256: str = ""
    sweep: str = ""
    sweep_sha256: str = ""
    codes: tuple[str, ...] = ()
    sonocal: str = ""
    format: str = CHECKS_FORMAT
    version: int = VERSION

    __repr__ = brief

    @classmethod
    def of(cls, check: Check, **origin: Any) -> CheckRecord:
        """The line for a check made now; `origin` are the fields that name files."""
        from importlib.metadata import version

        require("check", check, Check)
        return cls(
            checked=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            verdict=check.verdict,
            moved_mm=check.moved_mm,
            turned_deg=check.turned_deg,
            scale_change=check.scale_change,
            p_value=check.p_value,
            tolerance_mm=check.tolerance_mm,
            power_mean=check.power_mean,
            power_least=check.power_least,
            visible_mm=check.visible_mm if np.isfinite(check.visible_mm) else None,
            rows=check.rows,
            codes=tuple(one.code for one in check.diagnostics),
            sonocal=version("sonocal"),
            **origin,
        )


@dataclass(frozen=True, eq=False)
class CheckLog:
    """A log of checks.

    Attributes:
        name: of the file.
        checks: in the order in which they were written.
        damaged: numbers of lines, from 1, that are no checks: cut off by a full disk, or edited.
    """

    name: str
    checks: tuple[CheckRecord, ...]
    damaged: tuple[int, ...]

    __repr__ = brief


def check_log_path(calibration: str | Path) -> Path:
    """The log beside a calibration's file: ``calibration.checks.jsonl`` of ``calibration.json``."""
    path = path_of(calibration)
    return path.with_name(path.stem + ENDING)


def append_check(path: str | Path, record: CheckRecord) -> None:
    """Add a line to a log, which is made if it is absent; nothing that stands in it is touched.

    Raises:
        InputError: it cannot be written.
    """
    path = path_of(path)
    require("record", record, CheckRecord)
    line = msgspec.json.encode(record) + b"\n"
    try:
        with path.open("a+b") as file:
            end = file.seek(0, os.SEEK_END)
            if end:  # a line that was cut off must not take this one with it
                file.seek(end - 1)
                line = line if file.read(1) == b"\n" else b"\n" + line
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise InputError(
            f"{path}: the check cannot be added to it ({error.strerror}); give another file with --log, or --no-log"
        ) from None


def read_check_log(path: str | Path) -> CheckLog:
    """Read a log of checks; lines that are none are counted and left where they are.

    Raises:
        InputError: it cannot be read.
        FormatError: no line of it is a check.
    """
    path = path_of(path)
    checks, damaged = [], []
    for number, line in enumerate(read_bytes(path).removeprefix(BOM_UTF8).splitlines(), 1):
        if not line.strip():
            continue
        try:
            record = msgspec.json.decode(line, type=CheckRecord)
            datetime.datetime.fromisoformat(record.checked)
        except (msgspec.DecodeError, ValueError, RecursionError):
            damaged.append(number)
            continue
        checks.append(record)
    if not checks:
        raise FormatError(
            f"{path.name}: holds no check; name the file ending in {ENDING} that sonocal check wrote"
        )
    return CheckLog(path.name, tuple(checks), tuple(damaged))
