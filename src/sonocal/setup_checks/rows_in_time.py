"""Rows with their targets as they were at any moment: what a lag between two clocks is tried with."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.observations import Observations, group_codes
from sonocal.observations.spanning import flat_spans
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.setup_checks.lines_in_time import LONGEST_S, LinesInTime, Moved

__all__ = ["RowsInTime", "ShiftedRows", "Table", "time_of", "tracks_of"]

Table = PointLineRows | TargetRows


class Lines(Protocol):
    """Lines whose places are known at any moment near those at which they were seen."""

    def at(self, track: NDArray[np.int64], time: Array) -> Moved:
        """Where the lines of some tracks (N,) were at some times (N,)."""
        ...


@dataclass(frozen=True, eq=False)
class ShiftedRows:
    """Rows with their lines where they were a lag later.

    Attributes:
        lag: in units of time.
        rows: (M,): which rows they are: those whose lines are known then.
        table: these, as registration takes them.
        moved: the lines, with their velocities.
    """

    lag: float
    rows: NDArray[np.int64]
    table: Table
    moved: Moved

    @property
    def lines(self) -> PointLineRows:
        """The table, where it is of lines alone."""
        assert isinstance(self.table, PointLineRows)
        return self.table


@dataclass(frozen=True, eq=False)
class RowsInTime:
    """Rows (N), and where their lines are at any lag.

    Attributes:
        table: the rows as registration takes them.
        lines: where their needles were at any moment.
        track, time: (N,): which needle, and when, counted from the earliest sighting.
        unit: of time: "s", or "frames".
    """

    table: Table
    lines: Lines
    track: NDArray[np.int64]
    time: Array
    unit: str

    @classmethod
    def of(cls, observations: Observations, table: Table) -> Self:
        """Of a table alone: each needle's sightings say where it was in between. Rows come in the order of time."""
        time, unit = time_of(observations, np.arange(len(observations)))
        track = tracks_of(observations, table)
        order = np.lexsort((*table.points.T, track, time))
        table, track, time = table.select(order), track[order], time[order] - time[order[:1]]
        return cls(table, LinesInTime.of(track, time, table.spanning_mm, _longest(unit)), track, time, unit)

    @classmethod
    def in_recording(
        cls,
        table: Table,
        times: Array,
        segments_mm: Array,
        frame: NDArray[np.int64],
        track: NDArray[np.int64],
    ) -> Self:
        """Of sightings in a recording, whose every item says where its needles were.

        Args:
            table: the sightings.
            times: (I,), s, of the items.
            segments_mm: (I, L, 2, 3): each needle's in each item, NaN where it is not known.
            frame: (N,): the item of each row.
            track: (N,): its needle.
        """
        order = np.lexsort((*table.points.T, track, frame))
        table, frame, track = table.select(order), frame[order], track[order]
        items, needles = np.nonzero(np.isfinite(segments_mm).all(axis=(2, 3)))
        time = times - times.min()
        lines = LinesInTime.of(needles, time[items], segments_mm[items, needles], LONGEST_S)
        return cls(table, lines, track, time[frame], "s")

    def __len__(self) -> int:
        return len(self.table)

    def select(self, rows: NDArray[np.bool_]) -> RowsInTime:
        """Some of the rows, with the lines of all."""
        return replace(self, table=self.table.select(rows), track=self.track[rows], time=self.time[rows])

    def shifted(self, lag: float) -> ShiftedRows:
        """The rows whose lines are known a lag later, with these."""
        moved = self.lines.at(self.track, self.time + lag)
        known = moved.usable & self._spanned(moved.spanning_mm)
        spanning = np.where(known[:, None, None], moved.spanning_mm, self.table.spanning_mm)
        table = self.table.with_spanning(spanning).select(known)
        return ShiftedRows(lag, np.flatnonzero(known), table, moved.select(known))

    def _spanned(self, spanning_mm: Array) -> NDArray[np.bool_]:
        """(N,): whether what spans a target spans it still; a curve between two places may turn it inside out."""
        lines = isinstance(self.table, PointLineRows)
        return ~flat_spans(spanning_mm, np.full(len(self.table), 2) if lines else self.table.spans)


def time_of(observations: Observations, rows: NDArray[np.int64]) -> tuple[Array, str]:
    """(N,) of the rows, and its unit: the column ``time_s`` where there is one, else the frame's number."""
    if (stamps := observations.stamps_s(rows)) is not None:
        return stamps, "s"
    return observations.frame[rows].astype(float), "frames"


def tracks_of(observations: Observations, table: Table) -> NDArray[np.int64]:
    """(N,): which needle of which split each row is a sighting of."""
    split, target = observations.split, table.target
    assert target is not None
    if np.all(split == split[:1]):
        return target.astype(np.int64)
    return group_codes(split, observations.target)


def _longest(unit: str) -> float:
    return LONGEST_S if unit == "s" else np.inf
