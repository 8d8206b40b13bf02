"""Poses of targets in the probe marker's frame, as further columns of a table: of targets whose place is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry import FURTHEST, Array
from sonocal.observations.spanning import SPANNING_COLUMNS

__all__ = [
    "POSE_COLUMNS",
    "carried",
    "carried_columns",
    "pose_cells",
    "poses_in",
    "poses_of",
    "unplaced_rows",
    "with_poses",
]

POSE_COLUMNS = tuple(f"probe_from_target_{row}{column}" for row in range(3) for column in range(4))
"""The upper three rows of the pose, row by row; mm."""

# A pose that a file gives in six digits is a rotation to this.
RIGID = 1e-3


def poses_of(observations: Any) -> Array | None:
    """(N, 3, 4): of each row's target in the probe marker's frame, rigid to rounding; NaN where a row has none.

    Returns:
        None where the table has none of the columns.

    Raises:
        InputError: some of the columns are missing, a cell is no number, or a pose is not rigid.
    """
    return poses_in(observations.source, observations.extra, observations.where, len(observations))


def poses_in(source: str, columns: Any, where: Any, count: int) -> Array | None:
    """As `poses_of`, of text in columns by their names; `where` is what messages call a row."""
    missing = [name for name in POSE_COLUMNS if name not in columns]
    if len(missing) == len(POSE_COLUMNS):
        return None
    if missing:
        raise InputError(
            f"{source}: has poses but for the columns {', '.join(missing)[:200]}; give all twelve or none"
        )
    numbers = np.column_stack([_numbers(name, columns[name], where) for name in POSE_COLUMNS])
    poses = numbers.reshape(count, 3, 4)
    blank = np.isnan(numbers)
    cells = np.count_nonzero(blank, axis=1)
    if (row := _first(np.logical_and(cells > 0, cells < len(POSE_COLUMNS)))) is not None:
        raise InputError(f"{where(row)}: gives a part of its pose; fill in all twelve cells, or none")
    turned: Array = np.where(blank[:, 0][:, None, None], np.eye(3), poses[:, :, :3])
    off: Array = (
        np.abs(np.swapaxes(turned, 1, 2) @ turned - np.eye(3)).reshape(-1, 9).max(axis=1, initial=0.0)
    )
    sizes: Array = np.asarray(np.linalg.det(turned))
    if (row := _first(np.logical_or(off > RIGID, sizes < 0))) is not None:
        raise InputError(
            f"{where(row)}: probe_from_target is not rigid (det R = {sizes[row]:.3g}); write its "
            "rotation in full, mm per mm"
        )
    return _rigid(poses)


def with_poses(observations: Any, poses: Array) -> Any:
    """The table with poses (N, 3, 4); NaN are blank cells."""
    return observations.with_sound(extra={**observations.extra, **pose_cells(poses)})


def pose_cells(poses: Array) -> dict[str, NDArray[np.str_]]:
    """The columns of poses (N, 3, 4), as text; NaN are blank cells."""
    columns = poses.reshape(-1, 12).T
    text = [np.where(np.isfinite(column), (column + 0.0).astype(np.str_), "") for column in columns]
    return dict(zip(POSE_COLUMNS, text, strict=True))


def unplaced_rows(observations: Any) -> NDArray[np.bool_]:
    """(N,): rows that say where their target's frame was and not where in it the target is."""
    if observations.lines_only:
        return np.zeros(len(observations), dtype=bool)
    return np.asarray(observations.spans == 0)


def carried(poses: Array, points: Array) -> Array:
    """(N, K, 3): points (N, K, 3) by poses (N, 3, 4)."""
    return np.asarray(points @ np.swapaxes(poses[:, :, :3], 1, 2) + poses[:, None, :, 3])


def carried_columns(
    columns: Mapping[str, Array], poses: Array, extra: Mapping[str, NDArray[np.str_]]
) -> tuple[dict[str, Array], dict[str, NDArray[np.str_]]]:
    """Spanning points' columns (N,) in the probe marker's frame, of rows whose poses (N, 3, 4) they were given beside.

    Returns:
        The columns, and the further ones, with blank cells for poses that were used.
    """
    absent = np.full(len(poses), np.nan)
    spanning = np.column_stack([columns.get(name, absent) for name in SPANNING_COLUMNS]).reshape(-1, 3, 3)
    own = np.isfinite(poses[:, 0, 0]) & np.isfinite(spanning).any(axis=(1, 2))
    spanning[own] = carried(poses[own], spanning[own])
    left = {
        name: np.where(own, "", cells) if name in POSE_COLUMNS else cells for name, cells in extra.items()
    }
    if not any((left[name] != "").any() for name in POSE_COLUMNS):
        left = {name: cells for name, cells in left.items() if name not in POSE_COLUMNS}
    return dict(zip(SPANNING_COLUMNS, spanning.reshape(-1, 9).T, strict=True)), left


def _rigid(poses: Array) -> Array:
    """The rotations nearest to those given, whose digits a file has rounded."""
    known = np.isfinite(poses).all(axis=(1, 2))
    u, _, vt = np.linalg.svd(poses[known, :, :3])
    rigid = poses.copy()
    rigid[known, :, :3] = u @ vt
    return rigid


def _numbers(name: str, cells: NDArray[np.str_], where: Any) -> Array:
    numbers = np.full(len(cells), np.nan)
    for row, cell in enumerate(cells.tolist()):
        if not cell.strip():
            continue
        try:
            numbers[row] = float(cell)
        except ValueError:
            numbers[row] = np.inf
        if not abs(numbers[row]) < FURTHEST:
            raise InputError(
                f"{where(row)}, column {name}: {cell[:40]!r} is no number of a pose; leave all twelve blank where "
                "there is none"
            )
    return numbers


def _first(mask: NDArray[np.bool_]) -> int | None:
    rows = np.flatnonzero(mask)
    return int(rows[0]) if len(rows) else None
