"""The poses of one tool as they come, and where it was between two of them."""

from __future__ import annotations

from bisect import bisect_left, insort
from dataclasses import dataclass, field

import numpy as np

from sonocal.geometry import Array
from sonocal.live.clock import TICKS
from sonocal.recording import Poses, interpolate_poses

__all__ = ["BEFORE_ALL", "Track"]

KEPT_S = 2.0
BEFORE_ALL = -(1 << 80)
"""A stamp before any."""
QUIET_S = 0.3
"""Longer than what is bridged: who waits for more waits for what was lost."""


@dataclass
class Track:
    """One tool's poses of the last seconds.

    Attributes:
        names: what is tracked, and in whose frame.
        shared: how often its stamp was an image's.
        alone: how often it was not.
        came: how many poses came.
    """

    names: tuple[str, str]
    shared: int = 0
    alone: int = 0
    came: int = 0
    _poses: list[tuple[int, int, Array | None]] = field(default_factory=list)

    @property
    def apart(self) -> bool:
        """Whether it is a stream of its own, beside the images': what is missing then lies between two poses."""
        return self.alone > self.shared

    def is_stream_at(self, at: int) -> bool:
        """Whether it is such a stream, and was not silent for long before a stamp."""
        return self.apart and self.newest >= at - QUIET_S * TICKS

    @property
    def newest(self) -> int:
        """The latest stamp, ticks."""
        return self._poses[-1][0] if self._poses else BEFORE_ALL

    def add(self, at: int, pose: Array | None) -> None:
        """Keep a pose; None: it is lost."""
        self.came += pose is not None
        insort(self._poses, (at, self.came, pose), key=lambda one: one[:2])
        if len(self._poses) > 64 and self._poses[0][0] < at - KEPT_S * TICKS:
            oldest = at - int(KEPT_S * TICKS)
            self._poses = [one for one in self._poses if one[0] >= oldest]

    def clear(self) -> None:
        """Forget what came before a clock was set."""
        self._poses.clear()

    def at(self, at: int) -> Array | None:
        """(4, 4) at a stamp; None where the tool was lost on either side, or for longer than is bridged."""
        place = bisect_left(self._poses, at, key=lambda one: one[0])
        near = self._poses[max(place - 1, 0) : place + 1]
        stamps = [stamp for stamp, _, _ in near]
        if len(set(stamps)) < len(stamps) or not near:
            near = near[-1:]
        matrices = [np.full((4, 4), np.nan) if pose is None else pose for _, _, pose in near]
        times = np.array([(stamp - at) / TICKS for stamp, _, _ in near])
        found = interpolate_poses(Poses.of(*self.names, matrices), times, [0.0], on_invalid="skip")
        return found.matrices[0] if found.valid[0] else None
