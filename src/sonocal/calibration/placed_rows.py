"""A table's rows against targets whose place is asked for; and placed, once that is known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.observations import Observations, group_codes
from sonocal.observations.poses import carried, poses_of, unplaced_rows
from sonocal.registration.unplaced import UnplacedTarget
from sonocal.targets import Target, Unplaced
from sonocal.targets.unplaced import kind_of

__all__ = ["PlacedRows", "frames_of", "full_poses", "has_poses", "placed_at"]

ROOM = "tracker"
# Of rows that say where their target is: it lies here, in a frame that each has of its own.
HOMES = {1: [[0.0, 0, 0]], 2: [[0.0, 0, 0], [0, 0, 1]], 3: [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]}
KNOWN = ("point", "line", "plane")


def has_poses(observations: Observations) -> bool:
    """Whether the place of some rows' target is not in the table."""
    return bool(unplaced_rows(observations).any())


@dataclass(frozen=True, eq=False)
class PlacedRows:
    """Rows, with the pose of each one's target and which target that is.

    Attributes:
        poses: (N, 3, 4): of the target's frame in the probe marker's, mm.
        target: (N,): which of the targets.
        targets: as registration takes them.
        given: those of the targets that have a name, by that: as they were given, and their number.
    """

    poses: Array
    target: NDArray[np.int64]
    targets: tuple[UnplacedTarget, ...]
    given: Mapping[str, tuple[Target | Unplaced, int]]

    __repr__ = brief

    @classmethod
    def of(cls, rows: Observations, targets: Sequence[Target | Unplaced]) -> PlacedRows:
        """The rows of a table, each with its target.

        Raises:
            InputError: a row's target is not among those given.
        """
        posed, poses = unplaced_rows(rows), poses_of(rows)
        assert poses is not None
        poses = poses.copy()
        named = {one.name: one for one in targets}
        frames = {frame: i for i, frame in enumerate(_moving_frames(targets))}
        which = np.zeros(len(rows), dtype=np.int64)
        made: list[UnplacedTarget] = []
        given: dict[str, tuple[Target | Unplaced, int]] = {}
        for name in np.unique(rows.target[posed]).tolist():
            one = _named(name, named, rows, posed)
            which[posed & (rows.target == name)] = len(made)
            given[one.name] = (one, len(made))
            made.append(_as_registered(one, frames.get(one.frame)))
        for spans in np.unique(rows.spans[~posed]).tolist():
            mine = ~posed & (rows.spans == spans)
            which[mine] = len(made)
            poses[mine] = _homes(_spanning(rows)[mine], spans)
            made.append(UnplacedTarget(KNOWN[spans - 1], np.array(HOMES[spans])))
        return cls(poses, which, tuple(made), given)


def placed_at(rows: Observations, poses: Array, spanning_mm: Mapping[str, Array]) -> Observations:
    """A table whose targets are where they were found.

    Args:
        rows: some of which say a pose only.
        poses: (N, 3, 4): of their targets' frames.
        spanning_mm: (K, 3), by the target's name, what spans it in its own frame.
    """
    posed = unplaced_rows(rows)
    spanning = _spanning(rows).copy()
    for name, place in spanning_mm.items():
        mine = posed & np.isin(rows.target, (name, "") if len(spanning_mm) == 1 else (name,))
        points = np.broadcast_to(place, (int(mine.sum()), *np.shape(place)))
        spanning[mine, : len(place)] = carried(poses[mine], points)
    extra = {name: cells for name, cells in rows.extra.items() if not name.startswith("probe_from_target_")}
    columns = {
        name: getattr(rows, name) for name in ("frame", "target", "split", "sigma_px", "sigma_mm", "lines")
    }
    return Observations.of_targets(
        rows.points_px,
        spanning,
        extra=extra,
        image_size_px=rows.image_size_px,
        source=rows.source,
        sha256=rows.sha256,
        **columns,
    )


def full_poses(poses: Array) -> Array:
    """(N, 4, 4) of their upper rows (N, 3, 4)."""
    full = np.tile(np.eye(4), (len(poses), 1, 1))
    full[:, :3] = poses
    return full


def _spanning(rows: Observations) -> Array:
    if rows.spanning_mm is not None:
        return rows.spanning_mm
    return np.concatenate([rows.segments_mm, np.full((len(rows), 1, 3), np.nan)], axis=1)


def _moving_frames(targets: Iterable[Target | Unplaced]) -> list[str]:
    return list(dict.fromkeys(one.frame for one in targets if one.frame.lower() != ROOM))


def _named(
    name: str, named: Mapping[str, Target | Unplaced], rows: Observations, posed: NDArray[np.bool_]
) -> Target | Unplaced:
    if name in named:
        return named[name]
    if name == "" and len(named) == 1:
        return next(iter(named.values()))
    row = int(np.argmax(posed & (rows.target == name)))
    have = f"is none of the targets {', '.join(named)[:200]}" if named else "is given by its pose alone"
    raise InputError(
        f"{rows.where(row)}: target {name!r} {have}; say in a file of targets what it is, such as [[line]] with "
        f'name = {name!r}, its frame and place = "unknown", and name that with --targets'
    )


def _as_registered(one: Target | Unplaced, body: int | None) -> UnplacedTarget:
    if not isinstance(one, Unplaced):
        return UnplacedTarget(kind_of(one), one.spanning_mm, body=body)
    if one.spanning_mm is None:
        return UnplacedTarget(one.kind, body=body)
    return UnplacedTarget(one.kind, one.spanning_mm, one.sigma_mm, one.sigma_deg, body)


def _homes(spanning: Array, spans: int) -> Array:
    """(M, 3, 4): poses that carry a target at home to where each row (M, 3, 3) says that it is."""
    poses = np.zeros((len(spanning), 3, 4))
    poses[:, :, :3], poses[:, :, 3] = np.eye(3), spanning[:, 0]
    if spans > 1:
        sides = spanning[:, 1:spans] - spanning[:, :1]
        frames = np.linalg.svd(sides.swapaxes(1, 2))[0]  # columns: along the target first
        poses[:, :, :3] = frames if spans == 3 else frames[:, :, [1, 2, 0]]
        poses[:, :, 0] *= np.sign(np.linalg.det(poses[:, :, :3]))[:, None]
    return poses


def frames_of(rows: Observations) -> NDArray[np.int64]:
    """(N,): the instant of each row."""
    return group_codes(rows.split, rows.frame)
