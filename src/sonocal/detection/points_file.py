"""The file of points found in images: by hand, or by another program."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sonocal.detection.detections import Detections
from sonocal.errors import InputError
from sonocal.files import path_of, read_text
from sonocal.files.elsewhere import refuse_other_kind
from sonocal.files.tables import parse_table

__all__ = ["read_detections"]


def read_detections(path: str | Path) -> Detections:
    """Read points found in images: a CSV with ``frame, u_px, v_px[, w_px][, target][, sigma_px][, origin]``.

    The origin is text of whoever placed a point, such as "moved"; it goes on into the table of sightings.

    Raises:
        InputError: a column is missing or a value is wrong; the sentence names file, line and column.
        FormatError: the file is not CSV.
    """
    path = path_of(path)
    refuse_other_kind(path, "points", "known points")
    table = parse_table(path.name, read_text(path, "a table of points"))
    table.need_rows("write one row a point")
    if missing := [column for column in ("frame", "u_px", "v_px") if column not in table.columns]:
        raise InputError(
            f"{path.name}, line {table.lines[0] - 1}: lacks the column {missing[0]}; "
            "a table of points has frame, u_px, v_px and perhaps w_px, target, sigma_px"
        )
    coordinates = [table.numbers(column) for column in ("u_px", "v_px", "w_px") if column in table.columns]
    frames = table.numbers("frame")
    if not (np.abs(frames) < 2**53).all() or not np.array_equal(frames, np.round(frames)):
        raise InputError(f"{path.name}, column frame: holds a number that is not whole; count images from 0")
    return Detections.of_points(
        frames.astype(np.int64),
        np.column_stack(coordinates),
        table.text("target") if "target" in table.columns else "",
        table.numbers("sigma_px") if "sigma_px" in table.columns else None,
        path.name,
        origin=table.text("origin") if "origin" in table.columns else None,
    )
