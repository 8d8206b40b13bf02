"""Answers that labels are most easily taken for, from the wires alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.geometry import Array
from sonocal.registration.label_table import LabelTable, Settled
from sonocal.registration.wire_symmetry import near_isometries

__all__ = ["rival_starts"]

TILTED = "the mirrored tilt"


def rival_starts(table: LabelTable, best: Settled) -> Iterator[tuple[str, Array]]:
    """Names and similarities (4, 4) near which other answers may lie."""
    flat = table.points.ndim == 2
    tilted = _mirrored_tilt(table, best.matrix) if flat else best.matrix
    if flat:
        yield TILTED, tilted
    used = np.flatnonzero(np.diff(table.first) > 0)
    middle = int(used[len(used) // 2]) if len(used) else 0
    for name, motion in near_isometries(table.wires[middle]):
        if flat:
            for start in (best.matrix, tilted):
                yield name, _right_handed(motion @ start)
        elif np.linalg.det(motion[:3, :3]) > 0:  # a volume is no mirror of itself
            yield name, motion @ best.matrix


def _mirrored_tilt(table: LabelTable, matrix: Array) -> Array:
    """The image mirrored in the plane across the wires' common direction, about the middle of the dots."""
    along = (table.wires[:, :, 1] - table.wires[:, :, 0]).reshape(-1, 3)
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    axis = np.linalg.eigh(along.T @ along)[1][:, 2]
    centre = matrix @ [*table.points.mean(axis=0), 0.0, 1.0]
    mirror = np.eye(4)
    mirror[:3, :3] -= 2.0 * np.outer(axis, axis)
    mirror[:3, 3] = centre[:3] - mirror[:3, :3] @ centre[:3]
    return _right_handed(mirror @ matrix)


def _right_handed(matrix: Array) -> Array:
    """An image is flat: what is left-handed beside it may be turned round."""
    out = np.array(matrix)
    first, second = out[:3, 0], out[:3, 1]
    out[:3, 2] = np.cross(first, second) / np.linalg.norm(first)
    return out
