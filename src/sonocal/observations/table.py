"""Sightings of straight things: a point in the image against a line in the probe marker's frame.

One row is one point. A 2D probe sees a needle as one point; a 3D probe sees a line, given by two or
more rows of the same split, frame and target.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import InputError, require
from sonocal.geometry import FURTHEST, Array, frozen, real_array
from sonocal.geometry.cards import card, dots_svg
from sonocal.observations.columns import SEGMENT_COLUMNS, arrays_of, dataframe_of
from sonocal.observations.image_size import checked_size
from sonocal.observations.poses import poses_of, unplaced_rows
from sonocal.observations.spanning import segments_of, spans_of, wrong_span

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = [
    "Observations",
    "column_of",
    "group_codes",
]

COLUMNS = (
    "points_px",
    "segments_mm",
    "frame",
    "target",
    "split",
    "sigma_px",
    "sigma_mm",
    "lines",
    "spanning_mm",
)
"""What has one entry a row."""

ALL_ROWS = slice(None)

# Squares of such times are numbers still; those of clocks that count nanoseconds are far below.
LATEST_S = 1e30

_DEFAULT: Any = None  # filled in by the constructor


@dataclass(frozen=True, eq=False)
class Observations:
    """A table of sightings; all arrays have one entry a row.

    Args:
        points_px: (N, 2) for a 2D probe or (N, 3) for a 3D probe: ``(u, v[, w])``, px.
        segments_mm: (N, 2, 3): the two end points of the line, mm, in the probe marker's frame.
        frame: (N,) integers; rows of one frame share an image. Default: every row its own frame.
        target: (N,) text: which needle or wire. Default: one target.
        split: (N,) text: which part of the data the row belongs to. Default: all in one, "".
        sigma_px: (N,) standard deviation of the point, px, or None when unknown.
        sigma_mm: (N,) standard deviation of the segment's end points, mm, or None when unknown.
        extra: further columns of the file, as text, kept for writing.
        image_size_px: ``(width, height[, depth])`` of the images that the points are in, or None when unknown.
        source: the name that messages give the table.
        lines: (N,) line of each row in the file, for messages.
        sha256: digest of the file, or "".
        spanning_mm: (N, 3, 3), where some targets are no lines: a point, or three points of a plane, in the same
            frame; those that a row does not have are NaN. See `of_targets`. None: all are lines.

    Raises:
        InputError: a shape does not fit, a value is not finite, a segment has no length, or a row
            stands twice.

    Rows with no spanning point have a pose instead (`with_poses`): the place of their target is asked for.
    """

    points_px: Array
    segments_mm: Array
    frame: NDArray[np.int64] = _DEFAULT
    target: NDArray[np.str_] = _DEFAULT
    split: NDArray[np.str_] = _DEFAULT
    sigma_px: Array | None = None
    sigma_mm: Array | None = None
    extra: Mapping[str, NDArray[np.str_]] = field(default_factory=dict)
    image_size_px: tuple[int, ...] | None = None
    source: str = "observations"
    lines: NDArray[np.int64] | None = None
    sha256: str = ""
    spanning_mm: Array | None = None

    def __post_init__(self) -> None:
        # Copies: what happens to the arrays given is no matter of the table's.
        points, segments = (
            np.array(real_array(f"{self.source}: {name}", getattr(self, name)), order="C")
            for name in ("points_px", "segments_mm")
        )
        if points.ndim != 2 or points.shape[1] not in (2, 3):
            raise InputError(f"{self.source}: points_px must have shape (N, 2) or (N, 3); got {points.shape}")
        count = len(points)
        if segments.shape != (count, 2, 3):
            raise InputError(
                f"{self.source}: segments_mm must have shape ({count}, 2, 3), one a point; got {segments.shape}"
            )
        self._set("points_px", points)
        self._set("segments_mm", segments)
        self._set_column("frame", np.arange(count) if self.frame is None else self.frame, np.int64)
        self._set_column("target", np.full(count, "needle") if self.target is None else self.target, np.str_)
        self._set_column("split", np.full(count, "") if self.split is None else self.split, np.str_)
        for name in ("sigma_px", "sigma_mm"):
            if getattr(self, name) is not None:
                self._set_column(name, getattr(self, name), np.float64)
        require("extra", self.extra, Mapping, "a mapping from names to columns")
        self._set("extra", {name: self._extra(name, column) for name, column in self.extra.items()})
        if self.spanning_mm is not None:
            self._set("spanning_mm", self._spanning(self.spanning_mm))
        if self.image_size_px is not None:
            size = checked_size(self.image_size_px, self.dimension, f"{self.source}: image_size_px")
            self._set("image_size_px", size)
        self._check_values()

    def __len__(self) -> int:
        return len(self.points_px)

    def __repr__(self) -> str:
        frames, targets = len(np.unique(self.frame)), len(np.unique(self.target))
        return (
            f"<Observations of a {self.dimension}D probe: {len(self)} rows, {frames} frames, {targets} "
            f"target{'s' if targets != 1 else ''}, from {self.source[:40]!r}>"
        )

    def _repr_html_(self) -> str:
        low, high = (
            self.points_px.min(axis=0, initial=FURTHEST),
            self.points_px.max(axis=0, initial=-FURTHEST),
        )
        corners = np.array([low, high] if self.image_size_px is None else [low * 0, self.image_size_px])[
            :, :2
        ]
        splits = [str(name) or "(none)" for name in np.unique(self.split)]
        rows = [
            ("from", self.source[:80]),
            ("frames", str(len(np.unique(self.frame)))),
            ("targets", ", ".join(str(name) or "(none)" for name in np.unique(self.target)[:8])),
            *([("splits", ", ".join(splits[:8]))] if splits != ["(none)"] else []),
            *([("further columns", ", ".join(self.extra)[:80])] if self.extra else []),
        ]
        where = "in the image" if self.image_size_px else "in the area seen"
        picture = dots_svg(corners, self.points_px, f"Where the needle was seen {where}") if len(self) else ""
        return card(f"{len(self)} sightings for a {self.dimension}D probe", rows=rows, picture=picture)

    @property
    def dimension(self) -> int:
        """2 for a 2D probe, 3 for a 3D probe."""
        return int(self.points_px.shape[1])

    @cached_property
    def sightings(self) -> NDArray[np.int64]:
        """(N,): a number a sighting, counted from 0: rows of one split, frame and target share it."""
        return group_codes(self.split, self.frame, self.target)

    @property
    def lines_only(self) -> bool:
        """Whether all targets are lines."""
        return self.spanning_mm is None

    @cached_property
    def spans(self) -> NDArray[np.int32]:
        """(N,): how many points span each row's target: 1 a point, 2 a line, 3 a plane; 0: its place is not known."""
        return (
            np.full(len(self), 2, dtype=np.int32) if self.spanning_mm is None else spans_of(self.spanning_mm)
        )

    @classmethod
    def of_targets(cls, points_px: ArrayLike, spanning_mm: ArrayLike, **columns: Any) -> Observations:
        """A table of points, lines and planes.

        Args:
            points_px: (N, 2) or (N, 3).
            spanning_mm: (N, 3, 3): the points that span each row's target, in the probe marker's frame: one of a
                point, two of a line, three of a plane, the others NaN.
            columns: the class's others.

        Raises:
            InputError: as of the class, or points span nothing.
        """
        spanning = np.array(real_array("spanning_mm", spanning_mm))
        if spanning.ndim != 3 or spanning.shape[1:] != (3, 3):
            raise InputError(f"spanning_mm must have shape (N, 3, 3); got {spanning.shape}")
        points = real_array("points_px", points_px)
        if (spans_of(spanning) == 2).all():
            return cls(points, spanning[:, :2], **columns)
        return cls(points, segments_of(spanning), spanning_mm=spanning, **columns)

    @classmethod
    def of_sound(cls, points_px: Array, segments_mm: Array, **columns: Any) -> Observations:
        """A table of columns that were checked where they come from: taken as they are, without a second check.

        Args:
            points_px: (N, 2) or (N, 3), finite.
            segments_mm: (N, 2, 3), finite, none of them without length.
            columns: `frame`, `target`, `split`, all (N,) and of the class's types; further ones of the class.
        """
        table = object.__new__(cls)
        defaults: dict[str, Any] = {"sigma_px": None, "sigma_mm": None, "extra": {}, "lines": None}
        defaults["spanning_mm"] = None
        defaults["image_size_px"] = None
        for name, column in {
            **defaults,
            "points_px": points_px,
            "segments_mm": segments_mm,
            **columns,
        }.items():
            table._set(name, column)
        return table

    @classmethod
    def from_dataframe(cls, frame: Any, source: str = "dataframe") -> Observations:
        """A table of a data frame of pandas, or of another library, with the columns of the table's file.

        Args:
            frame: a row a point, ``u_px, v_px[, w_px]``, and the ends of its line, ``x0_mm ... z1_mm``; others as
                `read_observations` has them.
            source: the name that messages give the table.

        Raises:
            InputError: it is no data frame, a column is missing or holds what it must not, or as of the class.
        """
        return cls(**arrays_of(frame), source=source)

    def to_dataframe(self) -> DataFrame:
        """The table as a data frame of pandas: the columns of its file, with the image's size in columns of their own.

        Raises:
            UnsupportedError: pandas is not installed.
        """
        return dataframe_of(self)

    def with_sound(self, **columns: Any) -> Observations:
        """The table with other columns, which are taken as they are: rows of a sound table are sound."""
        table = copy(self)
        for counted in ("sightings", "spans"):  # anew
            table.__dict__.pop(counted, None)
        for name, column in columns.items():
            table._set(name, column)
        return table

    def select(self, rows: ArrayLike) -> Observations:
        """The table of some rows, given by a mask or by indices.

        Raises:
            InputError: they are neither, or not of this table.
        """
        try:
            index = np.arange(len(self))[np.asarray(rows, dtype=None if np.size(rows) else np.int64)]
        except (IndexError, ValueError) as error:
            raise InputError(f"{self.source}: has no such rows ({error}); give a mask or indices") from None
        columns = {name: value[index] for name in COLUMNS if (value := getattr(self, name)) is not None}
        return self.with_sound(**columns, extra={name: column[index] for name, column in self.extra.items()})

    def select_split(self, name: str) -> Observations:
        """The rows of one split.

        Raises:
            InputError: no row has that split; the sentence names those there are.
        """
        rows = self.split == name
        if not rows.any() and np.all(self.split == ""):
            raise InputError(
                f"{self.source}: no row has split {name!r}; it has no column split: add one that says which part of "
                "the data a row belongs to"
            )
        if not rows.any():
            have = ", ".join(repr(str(s)) for s in np.unique(self.split)) or "none"
            raise InputError(f"{self.source}: no row has split {name!r}; the splits in it are {have}")
        return self.select(rows)

    def stamps_s(self, rows: NDArray[np.int64] | slice = ALL_ROWS) -> Array | None:
        """(M,): when some rows were, by the column ``time_s``; None where it is absent or no number in one of them."""
        if "time_s" not in self.extra:
            return None
        try:
            stamps = self.extra["time_s"][rows].astype(float)
        except ValueError:
            return None
        return stamps if np.all(np.abs(stamps) < LATEST_S) else None

    def where(self, row: int) -> str:
        """How messages name a row."""
        if self.lines is None:
            return f"{self.source}, row {row}"
        return f"{self.source}, line {self.lines[row]}"

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, frozen(value) if isinstance(value, np.ndarray) else value)

    def _set_column(self, name: str, values: ArrayLike, kind: type) -> None:
        column = column_of(f"{self.source}: {name}", values, kind)
        if column.shape != (len(self),):
            raise InputError(f"{self.source}: {name} must have shape ({len(self)},); got {column.shape}")
        self._set(name, column)

    def _extra(self, name: str, values: ArrayLike) -> NDArray[Any]:
        column = column_of(f"{self.source}: extra column {name}", values, np.str_)
        if not isinstance(name, str) or column.shape != (len(self),):
            raise InputError(
                f"{self.source}: extra column {name!r} must have a name and shape ({len(self)},); got {column.shape}"
            )
        return frozen(column)

    def _check_values(self) -> None:
        columns = dict(zip(("u_px", "v_px", "w_px"), self.points_px.T, strict=False))
        segments = np.where(unplaced_rows(self)[:, None, None], 0.0, self.segments_mm)
        columns |= dict(zip(SEGMENT_COLUMNS, segments.reshape(-1, 6).T, strict=True))
        for name, values in columns.items():
            if (row := _first(~(np.abs(values) < FURTHEST))) is not None:
                what = (
                    f"further than {FURTHEST:g} away" if np.isfinite(values[row]) else "not a finite number"
                )
                raise InputError(
                    f"{self.where(row)}, column {name}: {values[row]} is {what}; leave out rows that were not seen"
                )
        for name in ("sigma_px", "sigma_mm"):
            sigma = getattr(self, name)
            if sigma is not None and (row := _first(~(np.isfinite(sigma) & (sigma > 0)))) is not None:
                raise InputError(
                    f"{self.where(row)}, column {name}: {sigma[row]} is not a positive number; "
                    "give a standard deviation, or drop the column"
                )
        lengths = np.linalg.norm(self.segments_mm[:, 1] - self.segments_mm[:, 0], axis=1)
        if self.spanning_mm is not None:
            self._check_spanning(self.spanning_mm)
        elif (row := _first(lengths == 0)) is not None:
            end = ", ".join(f"{x:g}" for x in self.segments_mm[row, 0])
            raise InputError(
                f"{self.where(row)}: the segment has zero length, both ends are at ({end}) mm; "
                "give two different points of the needle"
            )
        if (pair := self._duplicate()) is not None:
            first, second = pair
            raise InputError(
                f"{self.where(second)}: repeats {self.where(first).removeprefix(self.source + ', ')} "
                f"(frame {self.frame[first]}, target {str(self.target[first])!r}) value for value; "
                "delete one, a copy is not a second measurement"
            )

    def _spanning(self, values: ArrayLike) -> Array:
        array = np.array(real_array(f"{self.source}: spanning_mm", values))
        if array.shape != (len(self), 3, 3):
            raise InputError(
                f"{self.source}: spanning_mm must have shape ({len(self)}, 3, 3), NaN where a row has fewer points; "
                f"got {array.shape}"
            )
        return array

    def _check_spanning(self, spanning_mm: Array) -> None:
        third = spanning_mm[:, 2]
        if (row := _first(np.any(np.abs(third) >= FURTHEST, axis=1))) is not None:
            raise InputError(f"{self.where(row)}: its third point is further than {FURTHEST:g} away")
        poses = poses_of(self)
        posed = None if poses is None else np.isfinite(poses[:, 0, 0])
        if (wrong := wrong_span(spanning_mm, posed)) is not None:
            raise InputError(f"{self.where(wrong[0])}: {wrong[1]}")

    def _duplicate(self) -> tuple[int, int] | None:
        numbers = np.column_stack([self.points_px, self.segments_mm.reshape(-1, 6), self.sightings])
        if self.spanning_mm is not None:
            numbers = np.column_stack([numbers, np.nan_to_num(self.spanning_mm[:, 2], nan=-1.0)])
            poses = poses_of(self)
            numbers = numbers if poses is None else np.column_stack([numbers, poses.reshape(-1, 12)])
            numbers = np.nan_to_num(numbers, nan=-1.0)
        numbers = np.ascontiguousarray(numbers + 0.0)  # -0.0 and 0.0 are the same place
        packed = numbers.view(np.dtype((np.void, numbers.dtype.itemsize * numbers.shape[1]))).reshape(-1)
        unique, first, inverse = np.unique(packed, return_index=True, return_inverse=True)
        if len(unique) == len(packed):
            return None
        second = int(np.flatnonzero(first[inverse.reshape(-1)] != np.arange(len(packed)))[0])
        return int(first[inverse.reshape(-1)[second]]), second


def column_of(what: str, values: ArrayLike, kind: type) -> NDArray[Any]:
    """A column of numbers, whole numbers or text, copied."""
    if kind is np.float64:
        return np.array(real_array(what, values))
    if np.ma.isMaskedArray(values) and np.ma.count_masked(values):  # type: ignore[no-untyped-call]
        raise InputError(f"{what}: some of the values are masked; leave out the rows that hold them")
    word = "whole numbers" if kind is np.int64 else "text"
    try:
        given = np.asarray(values)
        column: NDArray[Any] = given.astype(kind, casting="same_kind" if kind is np.int64 else "unsafe")
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{what} must be {word}; {error}") from None
    if kind is np.int64 and given.dtype.kind == "u" and np.any(column < 0):  # NumPy wraps those too large
        raise InputError(f"{what} must be {word} below 2^63; got {given.max()}")
    if given.dtype.kind == "O" and (
        odd := [x for x in given.flat if not isinstance(x, (str, int, np.generic))]
    ):
        raise InputError(f"{what} must be {word}; got objects such as {odd[0]!r}"[:200])
    return column


def stacked(tables: Sequence[Observations]) -> Observations:
    """Tables one after the other, their rows in the order of frames; none has a row of another.

    A column that some of them lack is left out.
    """
    order = np.argsort(np.concatenate([table.frame for table in tables]), kind="stable")
    columns: dict[str, Any] = {}
    for name in COLUMNS:
        parts = [getattr(table, name) for table in tables]
        whole = name != "lines" and all(part is not None for part in parts)
        columns[name] = np.concatenate(parts)[order] if whole else None
    shared = [name for name in tables[0].extra if all(name in table.extra for table in tables)]
    extra = {name: np.concatenate([table.extra[name] for table in tables])[order] for name in shared}
    return tables[0].with_sound(**columns, extra=extra, sha256="")


def group_codes(*columns: NDArray[Any]) -> NDArray[np.int64]:
    """The group (N,) of each row, counted from 0 in sorted order: rows alike in all columns share one."""
    codes: NDArray[np.int64] | None = None
    for column in columns:
        if len(column) == 0 or (column == column[0]).all():
            continue
        count, code = _codes(column)
        codes = code if codes is None else _codes(codes * count + code)[1]
    return np.zeros(len(columns[0]), dtype=np.int64) if codes is None else codes


def _codes(column: NDArray[Any]) -> tuple[int, NDArray[np.int64]]:
    """How many distinct values a column has, and which of them, in their order, each row has."""
    if column.dtype.kind in "iu" and (column[1:] >= column[:-1]).all():
        code = np.zeros(len(column), dtype=np.int64)
        (column[1:] != column[:-1]).cumsum(out=code[1:])
        return int(code[-1]) + 1, code
    distinct, code = np.unique(column, return_inverse=True)
    return len(distinct), code.reshape(-1)


def _first(mask: NDArray[np.bool_]) -> int | None:
    rows = np.flatnonzero(mask)
    return int(rows[0]) if len(rows) else None
