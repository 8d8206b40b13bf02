"""Rotations from three numbers, whose meaning somebody must state: an order of axes, or a rotation vector."""

from __future__ import annotations

import re

import numpy as np

from sonocal.errors import InputError
from sonocal.geometry import Array

__all__ = ["ANGLES", "check_angles", "quaternions_from_angles", "refuse_degrees"]

ANGLES = (
    "ZYX or another order of axes (capitals: each turn about the tool's own axes as turned so far; small: about the "
    "tracker's), or vector (axis times angle)"
)
# Angles that are not brought into one turn may count a few.
MOST_RAD = 20.0
ORDER = re.compile(r"(?!.*(.).*\1)([xyz]{3}|[XYZ]{3})")


def check_angles(angles: str) -> str:
    """The same, if it says what three angles mean.

    Raises:
        InputError: it does not.
    """
    if angles != "vector" and not ORDER.fullmatch(angles):
        raise InputError(f"{angles[:40]!r} is no meaning of three angles; give {ANGLES}")
    return angles


def refuse_degrees(stated_rad: Array, where: str, instead: str) -> None:
    """Refuse angles that are said to be radians and turn as far round as only degrees do.

    Args:
        stated_rad: (N, 3).
        where: the file and the column, for the message.
        instead: how they are said to be degrees.

    Raises:
        InputError: they do.
    """
    most = float(np.abs(stated_rad[np.isfinite(stated_rad)]).max(initial=0.0))
    if most > MOST_RAD:
        raise InputError(
            f"{where}: reaches {most:.4g} rad, {most / (2 * np.pi):.0f} turns; are these degrees? {instead}; angles "
            "that count so many turns are brought into one"
        )


def quaternions_from_angles(xyz_rad: Array, angles: str) -> Array:
    """(N, 4) w, x, y, z; NaN where an angle is.

    Args:
        xyz_rad: (N, 3): about x, y and z, in this order whatever the order of turning.
        angles: an order such as "ZYX", or "vector".
    """
    from scipy.spatial.transform import Rotation

    check_angles(angles)
    found = np.full((len(xyz_rad), 4), np.nan)
    good = np.isfinite(xyz_rad).all(axis=1)
    if good.any():
        if angles == "vector":
            turns = Rotation.from_rotvec(xyz_rad[good])
        else:
            turns = Rotation.from_euler(angles, xyz_rad[good][:, ["xyz".index(a) for a in angles.lower()]])
        found[good] = np.roll(turns.as_quat(), 1, axis=1)
    return found
