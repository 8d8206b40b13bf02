"""Rows of NDI's logs: where the cells of each tool lie in them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from sonocal.errors import FormatError

__all__ = ["QUATERNION", "Block"]

QUATERNION, ANGLES, PLACE = ("Q0", "Qx", "Qy", "Qz"), ("Rx", "Ry", "Rz"), ("Tx", "Ty", "Tz")
# Names that programs spell in two ways.
SPELT = {
    "Frame": ("Frame#",),
    "Time": ("Time [sec]", "Time (sec)", "Time[sec]"),
    "state": ("TransformStatus", "State"),
    "markers": ("#Markers", "Markers"),
}
PLAIN = {spelt: name for name, ways in SPELT.items() for spelt in ways}
STAMPS = (("timespec_s", "timespec_ns"), ("Time",))
CELLS_A_MARKER, MOST_DIGITS = 4, 6


@dataclass(frozen=True)
class Block:
    """Where the cells of one tool lie within its part of a row, which starts with its name.

    Attributes:
        name: of the file.
        starts: where the tools of the header start.
        width: cells of the header.
        place: of each column in a tool's part, by its plain name.
        pose, stamps: the columns of a pose and of a time.
        last: the place of the last cell before the markers.
    """

    name: str
    starts: tuple[int, ...]
    width: int
    place: dict[str, int]
    pose: tuple[str, ...]
    stamps: tuple[str, ...]
    last: int

    @classmethod
    def of(cls, name: str, header: Sequence[str]) -> Block:
        """The layout that a header tells.

        Raises:
            FormatError: it is not NDI's.
        """
        starts = tuple(i - 1 for i, cell in enumerate(header) if cell in ("Frame#", "Frame") and i)
        if not starts:
            raise FormatError(f"{name}, line 1: is not the header of NDI's log; export it again")
        cells = header[starts[0] : starts[1] if len(starts) > 1 else len(header)]
        place = {PLAIN.get(cell, cell): i for i, cell in reversed([*enumerate(cells)])}
        pose = (*(ANGLES if "Q0" not in place else QUATERNION), *PLACE)
        if missing := [cell for cell in (*pose, "state") if cell not in place]:
            raise FormatError(f"{name}, line 1: lacks the column {missing[0]} of NDI's log; export it again")
        stamps = next((stamps for stamps in STAMPS if place.keys() >= {*stamps}), ())
        read = ("Frame", "PortHandle", *stamps, *pose, "state", "markers")
        last = max(place[cell] for cell in read if cell in place)
        if starts[-1] + last >= len(header):
            raise FormatError(
                f"{name}, line 1: its last tool lacks columns that the first has; export it again"
            )
        return cls(name, starts, len(header), place, pose, stamps, last)

    def tools(self, row: list[str], line: int) -> Iterator[Sequence[str]]:
        """The cells of each tool in a row, without its markers.

        Raises:
            FormatError: it ends within a tool, or goes on after the last one.
        """
        while len(row) > self.width and not row[-1].strip():
            row.pop()
        if len(row) == self.width and len(self.starts) > 1:
            yield from (row[start : start + self.last + 1] for start in self.starts)
            return
        start = self.starts[0]
        if len(row) < start:
            raise FormatError(
                f"{self.name}, line {line}: ends after {len(row)} cells, before its tools; delete the line if the log "
                "was cut there"
            )
        count = row[start - 1].strip() if start else ""
        left = int(count) if count.isdecimal() and len(count) < MOST_DIGITS else len(row)
        while start < len(row):
            if left == 0 and not any(cell.strip() for cell in row[start:]):
                return
            if left == 0:
                raise FormatError(
                    f"{self.name}, line {line}: holds {len(row)} cells, more than its {count} tools have; export it "
                    "again"
                )
            tool = row[start : start + self.last + 1]
            lost = len(tool) > self.place["state"] and tool[self.place["state"]].strip() != "OK"
            if len(tool) <= self.last and not lost:
                raise FormatError(
                    f"{self.name}, line {line}: ends after {len(row)} cells, within a tool; delete the line if the log "
                    "was cut there"
                )
            tool += [""] * (self.last + 1 - len(tool))
            yield tool
            left -= 1
            start += self._width(tool, line, lost=lost)

    def _width(self, tool: Sequence[str], line: int, *, lost: bool) -> int:
        """How many cells a tool has, with its markers; some programs write no number of them for one that is lost."""
        if "markers" not in self.place:
            return self.last + 1
        cell = tool[self.place["markers"]].strip()
        if cell and not (cell.isdecimal() and len(cell) < MOST_DIGITS):
            if lost:
                return self.place["markers"]
            raise FormatError(
                f"{self.name}, line {line}: {cell[:40]!r} is not a number of markers; export it again"
            )
        return self.last + 1 + CELLS_A_MARKER * int(cell or 0)
