"""Tables of numbers that no terminal is too narrow for: a number is shown whole, or its row stands on several lines."""

from __future__ import annotations

from collections.abc import Iterator

from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from sonocal.geometry import Array

__all__ = ["MatrixRows", "NumberTable"]

# Room for any table: what it needs is measured as if there were no end to a line.
ENDLESS = 10_000


class NumberTable:
    """A table whose first column names rows and whose others hold numbers.

    Names are broken between words where room is short. Numbers never are: where they do not fit side by side, each
    row is its name and a line for every number.
    """

    def __init__(self, title: str, *columns: str, first: str = "") -> None:
        """A table without rows; its texts are taken as they are, without markup."""
        self.title = title
        self.headings = (first, *columns)
        self.rows: list[tuple[str, ...]] = []

    def add_row(self, name: str, *cells: str) -> None:
        """A row: its name, and a text for each further column."""
        self.rows.append((name, *cells))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """Side by side where all numbers fit, else one below the other."""
        if self._least_width(console, options) <= options.max_width:
            yield self._table(options.max_width, self.rows)
        else:
            yield from self._lines()

    def _least_width(self, console: Console, options: ConsoleOptions) -> int:
        """Of the table with nothing broken but the names of rows."""
        whole = [(name, *(cell.replace(" ", "_") for cell in cells)) for name, *cells in self.rows]
        headings = (self.headings[0], *(heading.replace(" ", "_") for heading in self.headings[1:]))
        table = self._table(0, [headings, *whole])
        return Measurement.get(console, options.update(width=ENDLESS), table).minimum

    def _table(self, width: int, rows: list[tuple[str, ...]]) -> Table:
        table = Table(
            title=Text(self.title, style="bold"),
            title_justify="left",
            box=box.SIMPLE_HEAD,
            pad_edge=False,
            min_width=min(len(self.title), width),  # a title is broken at its table's width
        )
        table.add_column(Text(self.headings[0]), overflow="fold")
        for heading in self.headings[1:]:
            table.add_column(Text(heading), justify="right", no_wrap=True)
        for row in rows:
            table.add_row(*map(Text, row))
        return table

    def _lines(self) -> Iterator[RenderableType]:
        yield Text(self.title, style="bold")
        for name, *cells in self.rows:
            if name:
                yield Text(name)
            for heading, cell in zip(self.headings[1:], cells, strict=True):
                if cell:
                    yield Padding(Text(f"{heading}: {cell}"), (0, 0, 0, 2), expand=False)
        yield Text()


class MatrixRows:
    """A matrix, a row on a line; where that is too wide, a row goes on below, further in."""

    def __init__(self, matrix: Array) -> None:
        """The matrix as it is printed: six decimals."""
        numbers = [[f"{x: .6f}" for x in row] for row in matrix]
        widths = [max(map(len, column)) for column in zip(*numbers, strict=True)]
        self.rows = [[n.rjust(width) for n, width in zip(row, widths, strict=True)] for row in numbers]

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        """Numbers below one another, where they fit."""
        gap, further_in = " " * 3, " " * 4
        for row in self.rows:
            line = row[0]
            for number in row[1:]:
                if len(line + gap + number) > options.max_width:
                    yield Text(line)
                    line = further_in + number
                else:
                    line += gap + number
            yield Text(line)
