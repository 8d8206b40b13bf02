"""Logs of NDI's own programs: the CSV of the Combined API's sample, and ToolBox's (ToolTracker's) CSV and TSV.

A row is a count of tools, then for each tool its name, frame, face, time where the program writes one, state, pose
(quaternion ``Q0, Qx, Qy, Qz``, or angles ``Rz, Ry, Rx`` in degrees: R = Rz Ry Rx) in mm, error, and the number of
markers with their states and places, which are passed over. The API's sample writes as many markers as it saw, so that
the cells of a row need not stand below their header; some programs write one tool a row.

Source: `ToolData` and the CSV example of NDI's CombinedAPIsample; headers of ToolBox's "Save to CSV".
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from operator import itemgetter
from pathlib import Path

import numpy as np

from sonocal.errors import InputError
from sonocal.files import read_text
from sonocal.files.kinds import TABLE_SUFFIXES, Format, Head
from sonocal.files.separators import decimal_points, separator_of
from sonocal.files.tables import cells_to_numbers, csv_lines
from sonocal.geometry import Array
from sonocal.recording.formats.parts.angles import quaternions_from_angles
from sonocal.recording.formats.parts.ndi_rows import QUATERNION, Block
from sonocal.recording.model import Provenance, Recording
from sonocal.recording.poses import Poses, by_name, poses_from_quaternions

__all__ = ["FORMAT", "is_ndi", "read_ndi"]

BETWEEN = re.compile(rb"[,;\t]")
# R = Rz Ry Rx: each turn about the tool's own axes as turned so far.
NDI_ANGLES = "ZYX"
PORT, SERIAL = re.compile(r"^Port\s*:?\s*\w+\s*:\s*"), re.compile(r"\s*s/n:.*")
# What ToolBox writes for a number that it does not have.
NO_NUMBER = 1e20
# A pose takes 128 bytes, also where a tool was not seen: hours of twenty tools are fewer.
MOST_POSES = 10_000_000
LONGEST_NAME, LONGEST_STATE = 200, 40


def is_ndi(head: Head) -> bool:
    """Whether a file is one of NDI's logs: its first line has a frame, a face after it, and then Q0 or Rz."""
    cells = [cell.strip(b' "#\r') for cell in BETWEEN.split(head.text.partition(b"\n")[0])]
    after = iter(cells)
    return all(any(cell in wanted for cell in after) for wanted in ((b"Frame",), (b"Face",), (b"Q0", b"Rz")))


def read_ndi(path: Path) -> Recording:
    """Read a log of NDI's.

    Raises:
        FormatError: it is cut within a tool, or its header is not NDI's.
        InputError: a cell is no number.
    """
    text = read_text(path, "a log of poses")
    try:
        return _read(path, text, separator_of(text))
    except InputError:
        below = text.strip().partition("\n")[2]
        if separator_of(text) != "," or "." in below or not below:
            raise
        raise InputError(
            f"{path.name}: cannot be read as it stands, and none of its numbers has a decimal point; if its commas are "
            "decimal ones, separate cells by semicolons"
        ) from None


def _read(path: Path, text: str, separator: str) -> Recording:
    rows = csv_lines(path.name, text, separator)
    block = Block.of(path.name, [cell.strip() for cell in next(rows, ([], 0))[0]])
    log = _Log(block)
    for row, line in rows:
        log.add([*block.tools(row, line)], line)
    if not log.stamps:
        raise InputError(f"{path.name}: has a header but no rows; record it again")
    poses = by_name(log.poses(path.name), path.name)
    times = log.times(path.name)
    return Recording(times=times, poses=poses, provenance=Provenance(path.name, "NDI log", (str(path),)))


@dataclass
class _Tool:
    """The poses of one tool, as far as they are read: items of the recording, lines, cells of each, states."""

    items: list[int] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    cells: list[Sequence[str]] = field(default_factory=list)
    states: list[str] = field(default_factory=list)


@dataclass
class _Log:
    """What is read of a log; rows of one frame and of other tools are one item: some programs write a tool a row."""

    block: Block
    found: dict[tuple[str, str], _Tool] = field(default_factory=dict)
    stamps: list[Sequence[str]] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)
    frame: str = ""

    def __post_init__(self) -> None:
        place = self.block.place
        # Looked up once, since an hour has a million rows.
        self._frame, self._state, self._port = place["Frame"], place["state"], place.get("PortHandle", 0)
        self._stamp = [place[name] for name in self.block.stamps]
        self._pose = itemgetter(*(place[name] for name in self.block.pose))
        self._keys: dict[tuple[str, str], tuple[str, str]] = {}

    def add(self, tools: Sequence[Sequence[str]], line: int) -> None:
        """Add the tools of a row."""
        if not tools:
            return
        keys = [self._key(tool) for tool in tools]
        frame, item = tools[0][self._frame].strip(), len(self.stamps) - 1
        if item < 0 or frame != self.frame or self._seen(keys, item):
            self.frame, item = frame, item + 1
            self.stamps.append([tools[0][at] for at in self._stamp])
            self.lines.append(line)
        for key, tool in zip(keys, tools, strict=True):
            one = self.found.setdefault(key, _Tool())
            one.items.append(item)
            one.lines.append(line)
            one.cells.append(self._pose(tool))
            one.states.append(tool[self._state].strip()[:LONGEST_STATE])

    def _key(self, tool: Sequence[str]) -> tuple[str, str]:
        """A tool's title and port."""
        cells = tool[0], tool[self._port] if self._port else ""
        if (key := self._keys.get(cells)) is None:
            title, port = (cell.strip()[:LONGEST_NAME] for cell in cells)
            key = self._keys[cells] = title, port
        return key

    def _seen(self, keys: Iterable[tuple[str, str]], item: int) -> bool:
        return any(self.found[key].items[-1] == item for key in keys if key in self.found)

    def times(self, name: str) -> Array:
        """(N,) s; NaN where the program writes none, or a device without a clock zeros."""
        parts = [
            _numbers(name, column, [stamp[i] for stamp in self.stamps], self.lines)
            for i, column in enumerate(self.block.stamps)
        ]
        times = (
            parts[0] + (1e-9 * parts[1] if len(parts) > 1 else 0.0) if parts else np.zeros(len(self.stamps))
        )
        return times if np.isfinite(times).all() and times.any() else np.full(len(times), np.nan)

    def poses(self, name: str) -> Iterator[Poses]:
        """The poses of every tool."""
        if len(self.stamps) * len(self.found) > MOST_POSES:
            raise InputError(
                f"{name}: holds {len(self.found)} tools in {len(self.stamps)} frames, more than {MOST_POSES} poses; "
                "cut it"
            )
        names = Counter(_called(title, port) for title, port in self.found)
        for (title, port), tool in self.found.items():
            numbers = np.full((len(self.stamps), len(self.block.pose)), np.nan)
            for i, column in enumerate(self.block.pose):
                numbers[tool.items, i] = _numbers(
                    name, column, [cells[i] for cells in tool.cells], tool.lines
                )
            status: list[str | None] = [None] * len(numbers)
            for item, state in zip(tool.items, tool.states, strict=True):
                status[item] = state
            good = np.array([state == "OK" for state in status])
            numbers[~good] = np.nan
            turns, places = numbers[:, :-3], numbers[:, -3:]
            if self.block.pose[0] != QUATERNION[0]:
                turns = quaternions_from_angles(np.deg2rad(turns), NDI_ANGLES)
            poses = poses_from_quaternions(turns, places, _named(title, port, names), "Tracker", name)
            yield Poses(poses.source, poses.target, poses.matrices, poses.valid, tuple(status))


def _named(title: str, port: str, names: Mapping[str, int]) -> str:
    """A tool's name: what it is called, and its port or number where several are called so."""
    name = _called(title, port)
    return name if names[name] == 1 else name + (_word(port) or _word(title.removeprefix(name)))


def _called(title: str, port: str) -> str:
    """What a tool is called in the log, as a name."""
    return _word(SERIAL.sub("", PORT.sub("", title))) or _word(port) or _word(title) or "Tool"


def _word(text: str) -> str:
    return re.sub(r"\W+", "", text)


def _numbers(name: str, column: str, cells: Sequence[str], lines: Sequence[int]) -> Array:
    cells = decimal_points(f"{name}, column {column}", cells)
    numbers = cells_to_numbers(name, column, cells, lines, blank=np.nan)
    numbers[~(np.abs(numbers) < NO_NUMBER)] = np.nan
    return numbers


FORMAT = Format(
    name="NDI log",
    kind="recording",
    suffixes=(*TABLE_SUFFIXES, ".tsv"),
    header="Frame, Face, Q0 (or Rz) among its columns",
    sniff=is_ndi,
    read=read_ndi,
    holds="the CSV of the Combined API's sample and of ToolBox, by the tools' names; quaternions or NDI's angles",
)
