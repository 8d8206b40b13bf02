"""The columns of a table of sightings, as its file and a data frame have them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError, UnsupportedError
from sonocal.observations.image_size import SIZE_COLUMNS
from sonocal.observations.poses import POSE_COLUMNS, carried_columns, poses_in
from sonocal.observations.spanning import SPANNING_COLUMNS, of_spanning

if TYPE_CHECKING:
    from pandas import DataFrame

__all__ = ["POINT_COLUMNS", "SEGMENT_COLUMNS", "arrays_of", "columns_of", "dataframe_of"]

POINT_COLUMNS = ("u_px", "v_px", "w_px")
SEGMENT_COLUMNS = ("x0_mm", "y0_mm", "z0_mm", "x1_mm", "y1_mm", "z1_mm")
SIGMAS = ("sigma_px", "sigma_mm")
NAME = "dataframe"


def columns_of(table: Any) -> dict[str, NDArray[Any]]:
    """Columns (N,) of a table by their names, in the order of its file, but for the image's size."""
    columns = {"frame": table.frame, "target": table.target}
    columns |= dict(zip(POINT_COLUMNS, table.points_px.T, strict=False))
    if table.spanning_mm is None:
        columns |= dict(zip(SEGMENT_COLUMNS, table.segments_mm.reshape(-1, 6).T, strict=True))
    elif np.isfinite(table.spanning_mm).any():  # NaN where a row has fewer points
        columns |= dict(zip(SPANNING_COLUMNS, table.spanning_mm.reshape(-1, 9).T, strict=True))
    if np.any(table.split != ""):
        columns["split"] = table.split
    columns |= {name: sigma for name in SIGMAS if (sigma := getattr(table, name)) is not None}
    return columns | dict(table.extra)


def dataframe_of(table: Any) -> DataFrame:
    """The columns as a data frame of pandas, with the image's size in columns of its own.

    Raises:
        UnsupportedError: pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise UnsupportedError(
            "a data frame needs pandas, which is not installed; pip install pandas"
        ) from None
    columns = {
        name: column.astype(object) if column.dtype.kind == "U" else column
        for name, column in columns_of(table).items()
    }
    size = dict(zip(SIZE_COLUMNS, table.image_size_px or (), strict=False))
    return pd.DataFrame(columns | {name: np.full(len(table), pixels) for name, pixels in size.items()})


def arrays_of(frame: Any) -> dict[str, Any]:
    """What the table's class is made with, of a data frame of pandas or of another library with such columns.

    Raises:
        InputError: it is no data frame, lacks a column, or one of its columns is not what it must be.
    """
    if not hasattr(frame, "columns") or not hasattr(frame, "__getitem__"):
        raise InputError(f"frame must be a data frame, with a row a point; got {frame!r}"[:200])
    columns = {str(name): _column(str(name), frame[name]) for name in frame.columns}
    posed = any(name in columns for name in POSE_COLUMNS)
    needed = POINT_COLUMNS[:2] if posed else (*POINT_COLUMNS[:2], *SEGMENT_COLUMNS)
    if missing := [name for name in needed if name not in columns]:
        have = ", ".join(columns) or "none"
        raise InputError(f"{NAME}: lacks the columns {', '.join(missing)}; it has {have[:200]}")
    points = [_numbers(name, columns.pop(name)) for name in POINT_COLUMNS if name in columns]
    spanning = {
        name: _numbers(name, columns.pop(name), blank=posed or name not in SPANNING_COLUMNS[:3])
        for name in SPANNING_COLUMNS
        if name in columns
    }
    made: dict[str, Any] = {
        "points_px": np.column_stack(points),
        **({} if posed else of_spanning(spanning)),
        "image_size_px": _size([columns.pop(name) for name in SIZE_COLUMNS if name in columns]),
    }
    kinds: dict[str, Callable[[str, NDArray[Any]], NDArray[Any]]] = {
        "frame": _whole,
        **dict.fromkeys(("target", "split"), _text),
        **dict.fromkeys(SIGMAS, _numbers),
    }
    made |= {name: of(name, columns.pop(name)) for name, of in kinds.items() if name in columns}
    extra = {name: _text(name, column) for name, column in columns.items()}
    count = len(made["points_px"])
    poses = poses_in(NAME, extra, lambda row: f"{NAME}, row {row}", count)
    if poses is not None:
        spanning, extra = carried_columns(spanning, poses, extra)
        made |= of_spanning(spanning)
    return made | {"extra": extra}


def _column(name: str, series: Any) -> NDArray[Any]:
    column = np.asarray(series.to_numpy() if hasattr(series, "to_numpy") else series)
    if column.ndim != 1:
        raise InputError(f"{NAME}: has the column {name} more than once; drop all but one")
    return column


def _numbers(name: str, column: NDArray[Any], *, blank: bool = False) -> NDArray[np.float64]:
    if blank:
        column = np.array([np.nan if _is_missing(one) or one == "" else one for one in column.tolist()])
    try:
        return column.astype(np.float64)
    except (TypeError, ValueError):
        odd = next(one for one in column if not isinstance(one, (int, float, np.number)))
        raise InputError(
            f"{NAME}, column {name}: {str(odd)[:40]!r} is not a number; leave out rows that were not seen"
        ) from None


def _whole(name: str, column: NDArray[Any]) -> NDArray[Any]:
    if column.dtype.kind in "iu":
        return column
    numbers = _numbers(name, column)
    if not np.all(np.abs(numbers) < 2**53) or np.any(numbers != np.trunc(numbers)):
        raise InputError(
            f"{NAME}, column {name}: some of it are no whole numbers; number the images, rows of one image share its "
            "number"
        )
    return numbers.astype(np.int64)


def _text(_: str, column: NDArray[Any]) -> NDArray[np.str_]:
    return np.array(["" if _is_missing(one) else str(one) for one in column.tolist()], dtype=np.str_)


def _is_missing(value: Any) -> bool:
    """Whether it is None, NaN, or one of pandas' own signs of what is missing."""
    return value is None or (not isinstance(value, str) and str(value) in ("nan", "<NA>", "NaT"))


def _size(columns: list[NDArray[Any]]) -> tuple[Any, ...] | None:
    """The image's size, which all rows say alike."""
    sizes = {tuple(row) for row in zip(*(column.tolist() for column in columns), strict=True)}
    if len(sizes) > 1:
        raise InputError(
            f"{NAME}: says {len(sizes)} image sizes, such as {sorted(sizes)[:2]}; give the rows of one image size"
        )
    return next(iter(sizes), None)
