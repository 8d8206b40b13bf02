"""Cells of CSV tables, read with the place of whatever is wrong in them."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import FormatError, InputError

__all__ = ["Table", "cells_to_numbers", "csv_rows", "csv_text", "parse_table", "without_comments"]


# Of a name or a remark, characters.
LONGEST_TEXT = 200


@dataclass(frozen=True)
class Table:
    """A CSV table: its header, its cells column by column, and the file line of each row."""

    name: str
    header: tuple[str, ...]
    columns: dict[str, tuple[str, ...]]
    lines: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.lines)

    def numbers(self, column: str, blank: float | None = None) -> NDArray[np.float64]:
        """A column of numbers; empty cells give `blank` where it is given."""
        return cells_to_numbers(self.name, column, self.columns[column], self.lines, blank)

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
        text = content.decode("utf-8-sig")
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
    rows, lines = csv_rows(name, without_comments(text)[0])
    if not rows:
        raise InputError(f"{name}: is empty; a table needs a header and rows")
    header = tuple(cell.strip() for cell in rows[0])
    for row, line in zip(rows[1:], lines[1:], strict=True):
        if len(row) != len(header):
            raise FormatError(
                f"{name}, line {line}: has {len(row)} cells where the header has {len(header)}; "
                "quote cells that hold a comma"
            )
    if len(set(header)) < len(header):
        twice = next(column for column in header if header.count(column) > 1)
        raise InputError(f"{name}, line {lines[0]}: has the column {twice} twice; rename or delete one")
    cells = zip(*rows[1:], strict=True) if len(rows) > 1 else [()] * len(header)
    return Table(name, header, dict(zip(header, cells, strict=True)), tuple(lines[1:]))


def without_comments(text: str) -> tuple[str, list[tuple[int, str]]]:
    """A table's text whose comment lines above the header are blank, and these, each with its line's number.

    Lines keep their numbers, so that messages name the file's own.
    """
    if not text.lstrip().startswith("#"):
        return text, []
    rows, comments = text.splitlines(keepends=True), []
    for i, row in enumerate(rows):
        if row.strip() and not row.lstrip().startswith("#"):
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
) -> NDArray[np.float64]:
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
    arrived = f"{cells[row].strip()[:40]!r} is not a number" if cells[row].strip() else "the cell is empty"
    raise InputError(
        f"{name}, line {lines[row]}, column {column}: {arrived}; write a decimal number such as 12.5"
    )


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True
