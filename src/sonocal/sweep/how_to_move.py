"""What a probe has still to do over a target whose place nobody knows, while it is led: from its poses alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sonocal.errors import InputError
from sonocal.geometry import Array, real_array
from sonocal.registration.unplaced_motion import LEAST_TURN_DEG, turns_deg

__all__ = ["HowToMove", "how_to_move"]

FEWEST = 6
"""Poses, before which no motion is one."""
WELL_DEG = 14.0
"""Root mean square turns that tilts of some 30 degrees to both sides come to, and a yaw: twice as much halves a
floor's error twice."""


class HowToMove(NamedTuple):
    """What was done, and what to do.

    Attributes:
        turns_deg: (3,): root mean square turns about their mean, about the axis of the largest, the second, the least.
        missing: code of what is missing: "translation", "one-axis", "third-axis", "more", as findings of a refusal
            begin; "" where all was done.
        advice: what to do, in words; "" where all was done.
    """

    turns_deg: Array
    missing: str
    advice: str


def how_to_move(probe_from_target: ArrayLike) -> HowToMove:
    """What to do next, by how the probe was turned about a target so far.

    A motion that is missing is the same that a calibration would refuse by (`sonocal.registration.register_unplaced`);
    one that is there may be too little to be precise.

    Args:
        probe_from_target: (N, 4, 4): poses of the target's frame in the probe marker's, rigid; NaN where there is none.

    Raises:
        InputError: they are no poses.
    """
    poses = np.asarray(probe_from_target, dtype=float)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise InputError(f"probe_from_target must have shape (N, 4, 4); got {poses.shape}")
    known = poses[np.isfinite(poses).all(axis=(1, 2))]
    real_array("probe_from_target", known)
    turns = turns_deg(known[:, :3, :3]) if len(known) >= FEWEST else np.zeros(3)
    return HowToMove(turns, *_missing(turns))


def _missing(turns: Array) -> tuple[str, str]:
    if turns[0] < LEAST_TURN_DEG:
        return "translation", (
            f"tilt the probe by 30 to 40 degrees to both sides: so far it hardly turned ({turns[0]:.0f} degrees)"
        )
    if turns[1] < LEAST_TURN_DEG:
        return "one-axis", (
            f"tilt the probe about another axis, too: so far it turned about one only ({turns[0]:.0f} degrees about "
            f"it, {turns[1]:.0f} about any other)"
        )
    if turns[2] < LEAST_TURN_DEG:
        return "third-axis", (
            "tilt the probe about the third axis, too, and turn it about the vertical: so far it turned by "
            f"{turns[0]:.0f}, {turns[1]:.0f} and {turns[2]:.0f} degrees"
        )
    if turns[1] < WELL_DEG:
        return "more", (
            f"tilt the probe further, by 30 to 40 degrees to both sides: so far it turned by {turns[0]:.0f}, "
            f"{turns[1]:.0f} and {turns[2]:.0f} degrees, and a floor's error falls with the tilt squared"
        )
    return "", ""
