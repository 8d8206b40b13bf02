"""The times of a table, s: the column's name, else the size of its numbers, or a date in them, says what they are."""

from __future__ import annotations

import re
from collections.abc import Iterable
from datetime import UTC, datetime

import numpy as np

from sonocal.errors import InputError
from sonocal.files.tables import Table, is_number
from sonocal.findings import Diagnostic
from sonocal.geometry import Array

__all__ = ["PER_SECOND", "UNIT_NAMES", "time_column", "times_of", "unit_by_size"]

# These before others, in this order: a table may have several.
FIRST = ("timestamp", "time_s", "time_seconds", "time", "t")
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}
WORDS = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "msecs", "millis", "millisecond", "milliseconds"),
    "us": ("us", "\u00b5s", "\u03bcs", "usec", "usecs", "micros", "microsecond", "microseconds"),
    "ns": ("ns", "nsec", "nsecs", "nanos", "nanosecond", "nanoseconds"),
}
UNIT_NAMES = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
UNIT_OF = {word: unit for unit, words in WORDS.items() for word in words}
COLUMN = re.compile(
    r"%?(?:\w{1,20}_)?(?:time_?stamps?|times?|stamp|epoch|datetime|t)(?:_(?P<unit>[a-z\u00b5\u03bc]{1,12}))?"
)
LONGEST_NAME = 40
# Seconds since 1970 are 1.7e9 in these years; what is a thousand times as many counts thousandths.
EPOCHS = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))
# Whole numbers so far apart are no seconds between two poses of a tracker, which gives ten or more a second.
STEPS = ((3e6, "ns"), (3e3, "us"), (3.0, "ms"))
DATE = re.compile(r"\d{4}-?\d\d-?\d\d[T ]")
CLOCK = re.compile(r"T?(\d\d?):(\d\d):(\d\d(?:[.,]\d{1,9})?)")
DAY_S = 86400.0


def time_column(header: Iterable[str]) -> str | None:
    """The column of times, if there is one."""
    found = {column: name for column in header if (name := _plain(column)) and _unit(name) is not None}
    for wanted in FIRST:
        if column := next((column for column, name in found.items() if name == wanted), None):
            return column
    return next(iter(found), None)


def times_of(table: Table) -> tuple[Array, tuple[Diagnostic, ...]]:
    """The times of a table's rows, s, and the note how they were read where that is not plain; NaN without a column.

    Raises:
        InputError: a cell is no time.
    """
    column = time_column(table.header)
    if column is None:
        return np.full(len(table.lines), np.nan), ()
    cells = table.columns[column]
    first = cells[0].strip() if cells else ""
    if DATE.match(first):
        times = _dates(table, column)
        return times, (_note(f"{column} holds dates (ISO 8601), read as seconds since 1970", column),)
    if CLOCK.fullmatch(first):
        times = _clock(table, column)
        return times, (_note(f"{column} holds times of day, read as seconds since midnight", column),)
    if first and not is_number(first.replace(",", ".")):
        raise _no_time(table, column, 0, "seconds, or")
    times = table.numbers(column)
    if not np.isfinite(times).all():
        row = int(np.flatnonzero(~np.isfinite(times))[0])
        raise InputError(
            f"{table.name}, line {table.lines[row]}, column {column}: {times[row]} is not a time"
        )
    unit, why = _unit(_plain(column)) or "", "by its name"
    if not unit:
        unit, why = unit_by_size(times)
    notes = () if unit == "s" else (_note(f"{column} was read as {UNIT_NAMES[unit]}, {why}", column),)
    return times / PER_SECOND[unit], notes


def _plain(column: str) -> str:
    """A name in small letters, with underscores alone between its words: ``time_seconds`` of ``Time (Seconds)``."""
    if len(column) > LONGEST_NAME:
        return ""
    return re.sub(r"[ ._()\[\]:/-]+", "_", column.strip().lower()).strip("_")


def _unit(name: str) -> str | None:
    """The unit that a column's name says, or nothing; None where it is no column of times."""
    match = COLUMN.fullmatch(name)
    if match is None or match["unit"] is None:
        return None if match is None else ""
    return UNIT_OF.get(match["unit"])


def unit_by_size(times: Array) -> tuple[str, str]:
    """The unit of times of which nothing says it, and why; nothing to say of seconds."""
    middle = float(np.median(np.abs(times)))
    for least, unit in EPOCHS:
        if middle >= least:
            return unit, f"since {middle:.0f} {UNIT_NAMES[unit]} after 1970 is a date of these years"
    steps = np.diff(times)
    step = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    if (times == np.round(times)).all():
        for least, unit in STEPS:
            if step >= least:
                return unit, f"since its whole numbers are {step:g} apart"
    return "s", ""


def _dates(table: Table, column: str) -> Array:
    times = np.empty(len(table.lines))
    for row, cell in enumerate(table.columns[column]):
        try:
            stamp = datetime.fromisoformat(cell.strip())
            times[row] = (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()
        except (ValueError, OverflowError):
            raise _no_time(table, column, row) from None
    return times


def _clock(table: Table, column: str) -> Array:
    """Times of day, s since the midnight before the first: after midnight they go on."""
    times = np.empty(len(table.lines))
    for row, cell in enumerate(table.columns[column]):
        match = CLOCK.fullmatch(cell.strip())
        if match is None:
            raise _no_time(table, column, row)
        hours, minutes, seconds = int(match[1]), int(match[2]), float(match[3].replace(",", "."))
        if hours > 23 or minutes > 59 or seconds >= 61:
            raise _no_time(table, column, row)
        times[row] = 3600 * hours + 60 * minutes + seconds
    midnights = np.cumsum(np.diff(times, prepend=times[:1]) < -DAY_S / 2)
    return np.asarray(times + DAY_S * midnights)


def _no_time(table: Table, column: str, row: int, numbers: str = "") -> InputError:
    cell = table.columns[column][row].strip()[:40]
    return InputError(
        f"{table.name}, line {table.lines[row]}, column {column}: {cell!r} is not a date and time; write "
        f"{numbers + ' ' if numbers else ''}such as 2024-05-01T12:00:00.25"
    )


def _note(message: str, column: str) -> Diagnostic:
    return Diagnostic(
        code="time-unit",
        severity="info",
        message=f"times: {message}",
        advice=f"if that is not so, say the unit at the end of the name {column[:20]}: _s, _ms, _us or _ns",
    )
