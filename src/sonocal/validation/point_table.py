"""Sightings of points, such as a cross-wire: where in the image, and what is known of where they are."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import FormatError, InputError
from sonocal.files import path_of, read_bytes
from sonocal.files.elsewhere import refuse_other_kind
from sonocal.files.tables import (
    csv_text,
    parse_table,
)
from sonocal.geometry import FURTHEST, Array, real_array
from sonocal.geometry.shown import brief
from sonocal.observations.table import column_of

__all__ = ["PLACE_COLUMNS", "POSE_COLUMNS", "PointSightings", "parse_point_sightings", "read_point_sightings"]

PLACE_COLUMNS = ("x_mm", "y_mm", "z_mm")
POSE_COLUMNS = tuple(f"probe_{row}{column}" for row in range(3) for column in range(4))
NOT_RIGID = 1e-3

_DEFAULT: Any = None  # filled in by the constructor


@dataclass(frozen=True, eq=False)
class PointSightings:
    """A table of points seen in the image; all arrays have one entry a row.

    Args:
        points_px: (N, 2) or (N, 3), px.
        points_mm: (N, 3): where each is known to be: in the tracker's frame when there are poses, else in
            the probe marker's. None when unknown.
        tracker_from_probe: (N, 4, 4), or None.
        target: (N,) text: which point.
        frame: (N,) integers; rows of one frame share an image.
        source: the name that messages give the table.
        sha256: digest of the file, or "".

    Raises:
        InputError: a shape does not fit, a value is not finite or further than 1e9 away, a pose is not rigid, or
            neither places nor poses are given.
    """

    points_px: Array
    points_mm: Array | None = None
    tracker_from_probe: Array | None = None
    target: NDArray[np.str_] = _DEFAULT
    frame: NDArray[np.int64] = _DEFAULT
    source: str = "points"
    sha256: str = ""

    __repr__ = brief

    def __post_init__(self) -> None:
        if self.points_px is None:
            raise InputError(f"{self.source}: points_px must have shape (N, 2) or (N, 3); got None")
        for name in ("points_px", "points_mm", "tracker_from_probe"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, real_array(f"{self.source}: {name}", given))
        if self.points_mm is None and self.tracker_from_probe is None:
            raise InputError(
                f"{self.source}: says neither where the points are ({', '.join(PLACE_COLUMNS)}) nor how the probe "
                f"stood ({POSE_COLUMNS[0]} ... {POSE_COLUMNS[-1]}); give one of them"
            )
        if self.points_px.ndim != 2 or self.points_px.shape[1] not in (2, 3):
            raise InputError(
                f"{self.source}: points_px must have shape (N, 2) or (N, 3); got {self.points_px.shape}"
            )
        count = len(self.points_px)
        if count == 0:
            raise InputError(f"{self.source}: has no points; give at least one")
        for name, shape in (("points_mm", (count, 3)), ("tracker_from_probe", (count, 4, 4))):
            value = getattr(self, name)
            if value is not None and value.shape != shape:
                raise InputError(f"{self.source}: {name} must have shape {shape}; got {value.shape}")
        self._set_column("target", np.full(count, "point"), np.str_)
        self._set_column("frame", np.arange(count), np.int64)
        self._check_values()

    def __len__(self) -> int:
        return len(self.points_px)

    @property
    def poses(self) -> Array:
        """(N, 4, 4), tracker_from_probe.

        Raises:
            InputError: the table has none.
        """
        if self.tracker_from_probe is None:
            raise InputError(
                f"{self.source}: has no poses of the probe; add {POSE_COLUMNS[0]} ... {POSE_COLUMNS[-1]}"
            )
        return self.tracker_from_probe

    @property
    def points_probe_mm(self) -> Array:
        """(N, 3): where the points are known to be, in the probe marker's frame.

        Raises:
            InputError: the table does not say.
        """
        if self.points_mm is None:
            raise InputError(
                f"{self.source}: does not say where the points are; add {', '.join(PLACE_COLUMNS)}"
            )
        if self.tracker_from_probe is None:
            return self.points_mm
        rotation, offset = self.tracker_from_probe[:, :3, :3], self.tracker_from_probe[:, :3, 3]
        return np.asarray(np.einsum("nji,nj->ni", rotation, self.points_mm - offset))

    def _set_column(self, name: str, otherwise: NDArray[Any], kind: type) -> None:
        """Names or numbers of frames, one a row."""
        given = otherwise if getattr(self, name) is None else getattr(self, name)
        column = column_of(f"{self.source}: {name}", given, kind)
        if column.shape != otherwise.shape:
            raise InputError(f"{self.source}: {name} must have shape {otherwise.shape}; got {column.shape}")
        object.__setattr__(self, name, column)

    def _check_values(self) -> None:
        for name in ("points_px", "points_mm", "tracker_from_probe"):
            value = getattr(self, name)
            if value is not None and not np.all(np.abs(value) < FURTHEST):
                row = int(np.flatnonzero(~(np.abs(value.reshape(len(value), -1)) < FURTHEST).all(axis=1))[0])
                what = f"further than {FURTHEST:g} away" if np.isfinite(value[row]).all() else "not finite"
                raise InputError(f"{self.source}, row {row}: {name} is {what}; leave out rows not seen")
        if self.tracker_from_probe is None:
            return
        rotation = self.tracker_from_probe[:, :3, :3]
        off = np.abs(rotation @ np.swapaxes(rotation, 1, 2) - np.eye(3)).max(axis=(1, 2))
        determinants = np.linalg.det(rotation)
        bad = np.flatnonzero(~(off <= NOT_RIGID) | (determinants < 0))
        if len(bad):
            raise InputError(
                f"{self.source}, row {bad[0]}: the pose is not rigid (off by {off[bad[0]]:.2g}, "
                f"det {determinants[bad[0]]:.2f}); check the order of its columns"
            )


def read_point_sightings(path: str | Path) -> PointSightings:
    """Read a table of points from a CSV file.

    Columns: ``u_px, v_px[, w_px]``; ``x_mm, y_mm, z_mm`` where the point is known; ``probe_00 ... probe_23``, the
    upper three rows of tracker_from_probe (mm), where the probe is tracked; ``frame`` and ``target``. With poses the
    places are in the tracker's frame, without them in the probe marker's.

    Raises:
        InputError, FormatError: the sentence names the file, line and column.
    """
    path = path_of(path)
    refuse_other_kind(path, "known points", "points")
    return parse_point_sightings(read_bytes(path), path.name)


def parse_point_sightings(content: bytes, name: str) -> PointSightings:
    """The table in the content of a CSV file; `name` is what messages call it."""
    table = parse_table(name, csv_text(name, content, "points are"))
    header = list(table.header)
    if "u_px" not in header or "v_px" not in header:
        raise FormatError(f"{name}: needs a header with u_px, v_px and at least one row; it has {header}")
    table.need_rows("write one row a point")

    def numbers(columns: tuple[str, ...]) -> Array | None:
        if not any(column in header for column in columns):
            return None
        missing = [column for column in columns if column not in header]
        if missing:
            raise InputError(f"{name}, line 1: lacks the columns {', '.join(missing)}")
        return np.column_stack([table.numbers(column) for column in columns])

    pixels = numbers(("u_px", "v_px", "w_px") if "w_px" in header else ("u_px", "v_px"))
    assert pixels is not None
    poses = numbers(POSE_COLUMNS)
    frame = numbers(("frame",))
    if frame is not None and not np.all((np.abs(frame) < 2**53) & (frame == np.trunc(frame))):
        raise InputError(
            f"{name}, column frame: some of it are no whole numbers; rows of one image share its number"
        )
    return PointSightings(
        points_px=pixels,
        points_mm=numbers(PLACE_COLUMNS),
        tracker_from_probe=None if poses is None else _square(poses),
        target=table.text("target") if "target" in header else _DEFAULT,
        frame=_DEFAULT if frame is None else frame[:, 0].astype(np.int64),
        source=name,
        sha256=hashlib.sha256(content).hexdigest(),
    )


def _square(poses: Array) -> Array:
    matrices = np.zeros((len(poses), 4, 4))
    matrices[:, :3] = poses.reshape(-1, 3, 4)
    matrices[:, 3, 3] = 1.0
    return matrices
