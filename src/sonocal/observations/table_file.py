"""The file of a table of sightings: CSV that is read back to the last bit."""

from __future__ import annotations

import csv
import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import FormatError, InputError, require
from sonocal.files import path_of, read_bytes, write_atomically
from sonocal.files.elsewhere import refuse_other_kind
from sonocal.files.tables import (
    Table,
    csv_text,
    parse_table,
    without_comments,
)
from sonocal.geometry import Array
from sonocal.observations.columns import SEGMENT_COLUMNS, columns_of
from sonocal.observations.image_size import SIZE_COLUMNS, size_line, size_of
from sonocal.observations.poses import POSE_COLUMNS, carried_columns, poses_in
from sonocal.observations.spanning import SPANNING_COLUMNS, of_spanning
from sonocal.observations.table import _DEFAULT, Observations

__all__ = ["as_file", "observations_csv", "parse_observations", "read_observations", "write_observations"]

REQUIRED_COLUMNS = ("frame", "target", "u_px", "v_px", *SEGMENT_COLUMNS)


KNOWN_COLUMNS = (
    *REQUIRED_COLUMNS,
    *SPANNING_COLUMNS[6:],
    "w_px",
    "split",
    "sigma_px",
    "sigma_mm",
    *SIZE_COLUMNS,
)


def read_observations(path: str | Path) -> Observations:
    """Read a table of sightings from a CSV file.

    Columns: ``frame, target, u_px, v_px[, w_px], x0_mm, y0_mm, z0_mm, x1_mm, y1_mm, z1_mm[, x2_mm, y2_mm, z2_mm]
    [, split][, sigma_px][, sigma_mm]``; further columns are kept as text. The points span what was seen: two of them a
    line; a point has the first alone, and blank cells for the others, a plane all three. The size of the images is a
    comment line ``# image_size_px: 820 616`` above the header, or the columns ``image_width_px, image_height_px
    [, image_depth_px]``.

    Args:
        path: the file.

    Returns:
        The table; it has three image coordinates when there is a ``w_px`` column.

    Raises:
        InputError: the file cannot be read, a column is missing, or a value is wrong; the sentence
            names the file, line and column.
        FormatError: the file is not a CSV table.
    """
    path = path_of(path)
    refuse_other_kind(path, "observations")
    return parse_observations(read_bytes(path), path.name)


def parse_observations(data: bytes, name: str) -> Observations:
    """The table in the content of a CSV file; `name` is what messages call it. As `read_observations`."""
    if not data.strip():
        raise InputError(
            f"{name}: is empty; it needs a header with the columns {', '.join(REQUIRED_COLUMNS)}"
        )
    text, comments = without_comments(csv_text(name, data, "observations are"))
    table = parse_table(name, text)
    _check_header(name, table.header, 1 + max((line for line, _ in comments), default=0))
    table.need_rows("write one row a sighting")
    numbers = {
        column: table.numbers(column)
        for column in ("u_px", "v_px", "w_px", "sigma_px", "sigma_mm")
        if column in table.columns
    }
    spanning, extra = _spanning_and_extra(table)
    return Observations(
        points_px=np.column_stack([numbers[n] for n in ("u_px", "v_px", "w_px") if n in numbers]),
        **of_spanning(spanning),
        frame=_frames(name, table.columns["frame"], table.lines),
        target=table.text("target"),
        split=table.text("split") if "split" in table.columns else _DEFAULT,
        sigma_px=numbers.get("sigma_px"),
        sigma_mm=numbers.get("sigma_mm"),
        extra=extra,
        image_size_px=size_of(name, comments, table.columns, table.lines, 2 + ("w_px" in numbers)),
        source=name,
        lines=np.array(table.lines, dtype=np.int64),
        sha256=hashlib.sha256(data).hexdigest(),
    )


def write_observations(observations: Observations, path: str | Path) -> None:
    """Write a table of sightings; reading it again gives the same numbers to the last bit.

    Raises:
        InputError: the file cannot be written.
    """
    write_atomically(path, observations_csv(observations))


def observations_csv(observations: Observations) -> bytes:
    """The table as the text of its CSV file."""
    require("observations", observations, Observations)
    columns = {name: _cells(column) for name, column in columns_of(observations).items()}
    lines = _Lines()
    writer = csv.writer(lines, lineterminator="\r\n")
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    return (size_line(observations.image_size_px) + "\n".join(lines) + "\n").encode()


def _spanning_and_extra(table: Table) -> tuple[dict[str, Array], dict[str, NDArray[np.str_]]]:
    """The spanning points' columns, in the probe marker's frame, and further ones, as text.

    Of a row that has a pose, too, the points are in its target's frame: they are carried, and the pose is left out.
    """
    others = [column for column in table.columns if column not in KNOWN_COLUMNS]
    extra = {column: table.text(column, stripped=False) for column in others}
    poses = poses_in(table.name, extra, lambda row: f"{table.name}, line {table.lines[row]}", len(table))
    if poses is None:
        return {name: table.numbers(name) for name in SPANNING_COLUMNS[:3]} | _points(table, 1), extra
    columns = _points(table, 0) or {SPANNING_COLUMNS[0]: np.full(len(table), np.nan)}
    return carried_columns(columns, poses, extra)


def _points(table: Table, first: int) -> dict[str, Array]:
    """The columns of points from the `first` on, NaN where a row has none: all three cells of it are blank there."""
    found: dict[str, Array] = {}
    for names in (SPANNING_COLUMNS[i : i + 3] for i in range(3 * first, 9, 3)):
        there = [name for name in names if name in table.columns]
        columns = {name: table.numbers(name, blank=np.nan) for name in there}
        blank = np.isnan([*columns.values()])
        for name, empty in zip(there, blank, strict=True):
            if np.any(empty & ~blank.all(axis=0)):
                table.numbers(name)  # which says where
        found |= columns
    return found


def _cells(column: NDArray[Any]) -> list[Any]:
    """Cells of a column; of a point that a row does not have, blank ones."""
    cells: list[Any] = column.tolist()
    if column.dtype.kind != "f" or not np.isnan(column).any():
        return cells
    return ["" if np.isnan(cell) else cell for cell in cells]


class _Lines(list[str]):
    """The rows that a CSV writer writes: it quotes cells that hold a letter of its own line end, so that has both."""

    def write(self, row: str) -> None:
        """Keep a row without its line end."""
        self.append(row.removesuffix("\r\n"))


def as_file(observations: Observations, name: str) -> tuple[bytes, Observations]:
    """The text of a table's CSV file, and the table as reading it will give it: with the file's name and digest."""
    content = observations_csv(observations)
    first = 2 + (observations.image_size_px is not None)  # the header is on the line before
    digest, lines = hashlib.sha256(content).hexdigest(), np.arange(len(observations)) + first
    return content, observations.with_sound(source=name, sha256=digest, lines=lines)


def _check_header(name: str, header: Sequence[str], line: int) -> None:
    posed = any(name in header for name in POSE_COLUMNS)  # points in a frame of their own, or none at all
    missing = [
        one for one in REQUIRED_COLUMNS if one not in header and not (posed and one in SEGMENT_COLUMNS)
    ]
    if len(missing) == len(REQUIRED_COLUMNS):
        raise FormatError(
            f"{name}, line {line}: is not the header of an observation table; it needs the columns "
            f"{', '.join(REQUIRED_COLUMNS)}, separated by commas"
        )
    if missing:
        plural = "s" if len(missing) > 1 else ""
        raise InputError(
            f"{name}, line {line}: lacks the column{plural} {', '.join(missing)}; the header has {', '.join(header)}"
        )


def _frames(name: str, cells: Sequence[str], lines: Sequence[int]) -> NDArray[np.int64]:
    try:
        return np.array([int(cell) for cell in cells], dtype=np.int64)
    except (ValueError, OverflowError):
        row = next(i for i, cell in enumerate(cells) if not _is_frame(cell))
    raise InputError(
        f"{name}, line {lines[row]}, column frame: {cells[row].strip()[:40]!r} is not a whole number; "
        "number the images, rows of one image share its number"
    )


def _is_frame(cell: str) -> bool:
    try:
        np.int64(int(cell))
    except (ValueError, OverflowError):
        return False
    return True
