"""Cells of CSV tables, read with the place of whatever is wrong in them."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from sonocal.errors import FormatError, InputError
from sonocal.geometry import Array

__all__ = ["TIME_COLUMNS", "Table", "first_time_column", "parse_rows", "parse_table"]

TIME_COLUMNS = ("Timestamp", "timestamp", "time_s", "Time (Seconds)", "time", "t")


@dataclass(frozen=True)
class Table:
    """A CSV table: its header, its cells column by column, and the file line of each row."""

    name: str
    header: tuple[str, ...]
    columns: dict[str, tuple[str, ...]]
    lines: tuple[int, ...]

    def numbers(self, column: str, blank: float | None = None) -> Array:
        """A column of numbers; empty cells give `blank` where it is given."""
        return cells_to_numbers(self.name, column, self.columns[column], self.lines, blank)


def parse_table(name: str, text: str) -> Table:
    """A table with one header line.

    Raises:
        FormatError: the text is not CSV, or a row has another number of cells than the header.
        InputError: there are no rows, or a column stands twice.
    """
    rows, lines = parse_rows(name, text)
    if len(rows) < 2:
        raise InputError(f"{name}: has {len(rows)} lines; a table needs a header and a row")
    header = tuple(cell.strip() for cell in rows[0])
    if len(set(header)) < len(header):
        twice = next(column for column in header if header.count(column) > 1)
        raise InputError(f"{name}, line {lines[0]}: has the column {twice!r} twice; rename or delete one")
    for row, line in zip(rows[1:], lines[1:], strict=True):
        if len(row) != len(header):
            raise FormatError(f"{name}, line {line}: has {len(row)} cells where the header has {len(header)}")
    columns = dict(zip(header, zip(*rows[1:], strict=True), strict=True))
    return Table(name, header, columns, tuple(lines[1:]))


def parse_rows(name: str, text: str) -> tuple[list[list[str]], list[int]]:
    """The rows that are not empty, and their lines."""
    reader = csv.reader(io.StringIO(text, newline=""), strict=True)
    rows, lines = [], []
    try:
        for row in reader:
            if any(cell.strip() for cell in row):
                rows.append(row)
                lines.append(reader.line_num)
    except csv.Error as error:
        raise FormatError(f"{name}, line {reader.line_num}: is not CSV ({error})") from None
    return rows, lines


def cells_to_numbers(
    name: str, column: str, cells: Sequence[str], lines: Sequence[int], blank: float | None = None
) -> Array:
    """Numbers of cells.

    Raises:
        InputError: a cell is not a number; the sentence names line and column.
    """
    try:
        return np.array(
            [blank if blank is not None and not cell.strip() else float(cell) for cell in cells], dtype=float
        )
    except ValueError:
        row = next(
            i for i, cell in enumerate(cells) if not _is_number(cell) and (blank is None or cell.strip())
        )
    raise InputError(
        f"{name}, line {lines[row]}, column {column}: {cells[row].strip()[:40]!r} is not a number"
    )


def first_time_column(header: Iterable[str]) -> str | None:
    """The column of time stamps, by its name."""
    there = set(header)
    return next((column for column in TIME_COLUMNS if column in there), None)


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
