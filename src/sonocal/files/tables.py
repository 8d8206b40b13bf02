"""Cells of CSV tables, read with the place of whatever is wrong in them.

Cells are separated by commas, semicolons, tabs or bars, whichever the first line has. Where it is no comma, numbers
may have a decimal comma, as the spreadsheets of half the world write them.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import FormatError, InputError
from sonocal.files.separators import decimal_points, is_comment, other_width, separator_of, without_frame
from sonocal.files.text import decoded

__all__ = [
    "Table",
    "cells_to_numbers",
    "csv_lines",
    "csv_rows",
    "csv_text",
    "is_number",
    "parse_table",
    "without_comments",
]

# Rows that are held as such, until they stand in columns.
ROWS_AT_ONCE = 4096
# Of cells that may be blank: what programs write in place of nothing.
NOTHING = {"", "na", "n/a", "none", "null", "missing", "-", "--"}
# Of which decimal points are looked for, where commas could be decimal ones.
FIRST_ROWS = 100

# Of a name or a remark, characters.
LONGEST_TEXT = 200


@dataclass(frozen=True)
class Table:
    """A CSV table: its header, its cells column by column, the file line of each row, and what separates cells."""

    name: str
    header: tuple[str, ...]
    columns: dict[str, tuple[str, ...]]
    lines: tuple[int, ...]
    separator: str = ","

    def __len__(self) -> int:
        return len(self.lines)

    def numbers(self, column: str, blank: float | None = None) -> NDArray[np.float64]:
        """A column of numbers; empty cells give `blank` where it is given."""
        cells: Sequence[str] = self.columns[column]
        if self.separator != "," and any("," in cell for cell in cells):
            cells = self._with_points(column)
        return cells_to_numbers(self.name, column, cells, self.lines, blank)

    def _with_points(self, column: str) -> list[str]:
        """The cells of a column, each with a point for its decimal comma.

        Raises:
            InputError: there are decimal points, too, so that a comma may part thousands.
        """
        for other, cells in self.columns.items():
            for cell, line in zip(cells[:FIRST_ROWS], self.lines, strict=False):
                if "." in cell and is_number(cell):
                    raise InputError(
                        f"{self.name}, line {line}, column {other}: {cell.strip()[:40]!r} has a decimal point where "
                        f"numbers of the column {column} have commas; write one of the two all over"
                    )
        return decimal_points(f"{self.name}, column {column}", self.columns[column])

    def text(self, column: str, *, stripped: bool = True) -> NDArray[np.str_]:
        """A column of text, without the blanks around it if it is to be `stripped`.

        Raises:
            InputError: a cell is longer than a text may be.
        """
        cells = [cell.strip() if stripped else cell for cell in self.columns[column]]
        longest = max(range(len(cells)), key=lambda row: len(cells[row]), default=0)
        if cells and len(cells[longest]) > LONGEST_TEXT:
            # NumPy gives every row the room of the longest: one long cell would take gigabytes.
            raise InputError(
                f"{self.name}, line {self.lines[longest]}, column {column}: holds {len(cells[longest])} characters, "
                f"more than the {LONGEST_TEXT} that a text may have; shorten it, or leave the column out"
            )
        return np.array(cells, dtype=np.str_)

    def first_of(self, names: Iterable[str]) -> str | None:
        """The first of some names that is a column."""
        return next((name for name in names if name in self.columns), None)

    def need_rows(self, advice: str) -> None:
        """Refuse a table without rows.

        Raises:
            InputError: it has none.
        """
        if not self.lines:
            raise InputError(f"{self.name}: has a header but no rows; {advice}")


def csv_text(name: str, content: bytes, what: str) -> str:
    """The text of a CSV file.

    Raises:
        FormatError: it is no text.
    """
    try:
        text = decoded(content)
    except UnicodeDecodeError:
        text = "\0"
    if "\0" in text:
        raise FormatError(f"{name}: is not a text file; {what} a CSV table in UTF-8")
    return text


def parse_table(name: str, text: str) -> Table:
    """A table with one header line, which may have no rows; comment lines above it are passed over.

    Raises:
        FormatError: the text is not CSV, or a row has another number of cells than the header.
        InputError: there is no header, or a column stands twice.
    """
    text = without_comments(text)[0]
    separator = separator_of(text)
    rows = csv_lines(name, without_frame(text) if separator == "|" else text, separator)
    header, top = next(rows, ([], 0))
    if not header:
        raise InputError(f"{name}: is empty; a table needs a header and rows")
    header = [cell.strip() for cell in header]
    cells, lines = _columns(name, rows, len(header), separator)
    if len(set(header)) < len(header):
        twice = next(column for column in header if header.count(column) > 1)
        raise InputError(f"{name}, line {top}: has the column {twice} twice; rename or delete one")
    columns = dict(zip(header, map(tuple, cells), strict=True))
    return Table(name, tuple(header), columns, tuple(lines), separator)


def _columns(
    name: str, rows: Iterator[tuple[list[str], int]], width: int, separator: str
) -> tuple[list[list[str]], list[int]]:
    """The cells of rows, column by column, and the rows' lines; few rows are held at once, as columns are smaller."""
    columns: list[list[str]] = [[] for _ in range(width)]
    lines: list[int] = []
    while some := [*islice(rows, ROWS_AT_ONCE)]:
        cells, ends = zip(*some, strict=True)
        if {*map(len, cells)} != {width}:
            row, line = next((row, line) for row, line in some if len(row) != width)
            raise other_width(f"{name}, line {line}", row, width, separator)
        for column, part in zip(columns, zip(*cells, strict=True), strict=True):
            column.extend(part)
        lines.extend(ends)
    return columns, lines


def without_comments(text: str) -> tuple[str, list[tuple[int, str]]]:
    """A table's text whose comment lines above the header are blank, and these, each with its line's number.

    Lines keep their numbers, so that messages name the file's own.
    """
    if not is_comment(text.lstrip().partition("\n")[0]):
        return text, []
    rows, comments = text.splitlines(keepends=True), []
    for i, row in enumerate(rows):
        if row.strip() and not is_comment(row):
            break
        if row.strip():
            comments.append((i + 1, row.strip()))
            rows[i] = "\n"
    return "".join(rows), comments


def csv_rows(name: str, text: str) -> tuple[list[list[str]], list[int]]:
    """The rows that are not empty, and the line each ends on.

    Raises:
        FormatError: the text is not CSV.
    """
    found = [*csv_lines(name, text, separator_of(text))]
    return [row for row, _ in found], [line for _, line in found]


def csv_lines(name: str, text: str, separator: str) -> Iterator[tuple[list[str], int]]:
    """Each row that is not empty, with the line it ends on.

    Raises:
        FormatError: the text is not CSV.
    """
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)
    try:
        for row in reader:
            if "".join(row).strip():
                yield row, reader.line_num
    except csv.Error as error:
        raise FormatError(f"{name}, line {reader.line_num}: is not CSV ({error})") from None


def cells_to_numbers(
    name: str, column: str, cells: Sequence[str], lines: Sequence[int], blank: float | None = None
) -> NDArray[np.float64]:
    """Numbers of cells.

    Raises:
        InputError: a cell is not a number; the sentence names line and column.
    """
    try:
        return np.array([*map(float, cells)], dtype=float)
    except ValueError:  # a blank cell, or no number
        pass
    try:
        return np.array(
            [blank if blank is not None and _is_nothing(cell) else float(cell) for cell in cells], dtype=float
        )
    except ValueError:
        row = next(
            i
            for i, cell in enumerate(cells)
            if not is_number(cell) and (blank is None or not _is_nothing(cell))
        )
    arrived = f"{cells[row].strip()[:40]!r} is not a number" if cells[row].strip() else "the cell is empty"
    raise InputError(
        f"{name}, line {lines[row]}, column {column}: {arrived}; write a decimal number such as 12.5"
    )


def _is_nothing(cell: str) -> bool:
    return cell.strip().lower() in NOTHING


def is_number(cell: str) -> bool:
    """Whether a cell is a number."""
    try:
        float(cell)
    except ValueError:
        return False
    return True
