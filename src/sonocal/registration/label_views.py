"""Which view tells two answers apart: how the probe would have to be moved for their dots to part."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array
from sonocal.registration.label_table import LabelTable

__all__ = ["telling_view"]

TURN_DEG, SHIFT_MM = 20.0, 10.0
# Of the box of all dots, on each side: its corners are dots.
AROUND = 0.05
# What a hand may do: words, a rotation vector and a shift along the image's u, v and normal.
Motion = tuple[tuple[float, float, float], tuple[float, float, float]]
VIEWS: dict[str, Motion] = {
    f"tilt the image by {TURN_DEG:g} degrees about u": ((TURN_DEG, 0, 0), (0, 0, 0)),
    f"tilt the image by {TURN_DEG:g} degrees about v": ((0, TURN_DEG, 0), (0, 0, 0)),
    f"turn the image by {TURN_DEG:g} degrees in its plane": ((0, 0, TURN_DEG), (0, 0, 0)),
    f"move the image by {SHIFT_MM:g} mm along u": ((0, 0, 0), (SHIFT_MM, 0, 0)),
    f"move the image by {SHIFT_MM:g} mm along v": ((0, 0, 0), (0, SHIFT_MM, 0)),
    f"move the image by {SHIFT_MM:g} mm along its normal": ((0, 0, 0), (0, 0, SHIFT_MM)),
}


def telling_view(table: LabelTable, matrix: Array, other: Array) -> tuple[str, float]:
    """What to do with the probe so that the images say which of two similarities is right, and by how much.

    Wires of the middle frame are moved as they would be seen from there; each dot of the one answer is then as far from
    the nearest one of the other.

    Args:
        table: dots and wires.
        matrix: (4, 4), mm from px.
        other: (4, 4), the same of the other one.

    Returns:
        Words, and the middle distance, mm; "" and 0 where dots part nowhere, and of volumes.
    """
    used = np.flatnonzero(np.diff(table.first) > 0)
    if not len(used) or table.points.ndim > 2:
        return "", 0.0
    wires = table.wires[used[len(used) // 2]]
    parted = {words: _least_parted_mm(table, matrix, other, wires, motion) for words, motion in VIEWS.items()}
    words = max(parted, key=lambda one: parted[one])
    return (words, parted[words]) if parted[words] > 0 else ("", 0.0)


def _least_parted_mm(table: LabelTable, matrix: Array, other: Array, wires: Array, motion: Motion) -> float:
    """Whichever of the two is right, and whichever way the hand goes."""
    return min(
        _parted_mm(table, one, another, _seen_from(table, one, wires, sign, motion))
        for one, another in ((matrix, other), (other, matrix))
        for sign in (1.0, -1.0)
    )


def _seen_from(
    table: LabelTable,
    matrix: Array,
    wires: Array,
    sign: float,
    motion: Motion,
) -> Array:
    """Wires (L, 2, 3) in the target's frame, were the image turned about its middle and moved."""
    from scipy.spatial.transform import Rotation

    turn_deg, shift_mm = motion
    axes = matrix[:3, :3] / np.linalg.norm(matrix[:3, 0])
    turned = axes @ Rotation.from_rotvec(sign * np.radians(turn_deg)).as_matrix() @ axes.T
    middle = matrix[:3, :2] @ table.points.mean(axis=0) + matrix[:3, 3]
    # The target's frame goes with the probe: what stands still moves the other way in it.
    return np.asarray((wires - middle - axes @ (sign * np.array(shift_mm))) @ turned + middle)


def _parted_mm(table: LabelTable, matrix: Array, other: Array, wires: Array) -> float:
    """How far dots of one similarity are from the nearest ones of the other, the middle one of those in the images."""
    ours, theirs = _crossings_px(matrix, wires), _crossings_px(other, wires)
    low, high = table.points.min(axis=0), table.points.max(axis=0)
    low, high = low - AROUND * (high - low), high + AROUND * (high - low)
    ours = ours[np.all((ours >= low) & (ours <= high), axis=1)]
    theirs = theirs[np.isfinite(theirs).all(axis=1)]
    if not len(ours) or not len(theirs):
        return 0.0
    nearest = np.linalg.norm(ours[:, None] - theirs, axis=-1).min(axis=1)
    return float(np.median(nearest) * np.linalg.norm(matrix[:3, 0]))


def _crossings_px(matrix: Array, wires: Array) -> Array:
    """(L, 2) px: where wires cross the image that a similarity puts there."""
    ends = (wires - matrix[:3, 3]) @ np.linalg.inv(matrix[:3, :3]).T
    along = ends[:, 1] - ends[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = -ends[:, 0, 2] / along[:, 2]
        return np.asarray((ends[:, 0] + share[:, None] * along)[:, :2])
