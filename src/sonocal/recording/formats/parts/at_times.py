"""Poses of a track that has stamps of its own."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array
from sonocal.recording.poses import Poses
from sonocal.recording.timing import interpolate_poses

__all__ = ["at_times"]


def at_times(poses: Poses, stamps: Array, times: Array, name: str) -> Poses:
    """The poses as they are where their stamps are the times that are wanted; else interpolated to these.

    Args:
        poses: N of them.
        stamps: (N,) s, increasing.
        times: (M,) s.
        name: of the file, for messages.

    Raises:
        InputError: the stamps do not increase.
    """
    if np.array_equal(stamps, times):
        return poses
    return interpolate_poses(poses, stamps, times, source=name, on_invalid="skip")
