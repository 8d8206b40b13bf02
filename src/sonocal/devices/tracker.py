"""What a tracker is to sonocal: something that is read until it is closed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from sonocal.geometry import Array
from sonocal.geometry.shown import brief

__all__ = ["Reading", "Tracker", "pose_of"]

UNIT = 0.01
"""By how much the length of a quaternion may differ from 1: it was rounded on its way."""


@dataclass(frozen=True, eq=False)
class Reading:
    """Where tools are at one time.

    Attributes:
        time_s: by this machine's clock, seconds since 1970, when the reading arrived.
        poses: (4, 4) by the tool's name: tracker_from_tool, mm; None where a tool is lost.
    """

    time_s: float
    poses: Mapping[str, Array | None] = field(default_factory=dict)

    __repr__ = brief


class Tracker(Protocol):
    """A tracker; whoever opened it closes it."""

    def read(self, timeout_s: float) -> Reading | None:
        """The next reading; None where none came in time.

        Raises:
            InputError: the tracker is gone, or says that something is wrong.
        """

    def close(self) -> None:
        """End the connection."""


def pose_of(quaternion_wxyz: ArrayLike, place_mm: ArrayLike) -> Array | None:
    """(4, 4) of a quaternion and a place; None where they are none, as of a tool that is lost."""
    from scipy.spatial.transform import Rotation

    w, x, y, z = np.asarray(quaternion_wxyz, dtype=float)
    place = np.asarray(place_mm, dtype=float)
    length = np.sqrt(w * w + x * x + y * y + z * z)
    if not (np.isfinite(place).all() and abs(length - 1.0) <= UNIT):
        return None
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([x, y, z, w]).as_matrix()
    pose[:3, 3] = place
    return pose
