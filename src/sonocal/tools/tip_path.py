"""Where a stylus' tip went in a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.recording import Recording
from sonocal.recording.poses import OnInvalid
from sonocal.tools.calibrate import Stylus
from sonocal.tools.poses import distinct_poses

__all__ = ["TipPath"]

# Where a recording has no times.
RATE_HZ = 20.0


@dataclass(frozen=True, eq=False)
class TipPath:
    """Where a stylus' tip went.

    Attributes:
        frame: that its places are in.
        matrices: (N, 4, 4): that frame from the stylus' marker.
        tip_mm: (3,), in the marker's frame.
        places_mm: (N, 3); NaN where there is no pose, or one that repeats another.
        times_s: (N,), rising.
        repeats: what is to be said of poses that repeat.
    """

    frame: str
    matrices: Array
    tip_mm: Array
    places_mm: Array
    times_s: Array
    repeats: tuple[Diagnostic, ...]

    __repr__ = brief

    @classmethod
    def of(
        cls, recording: Recording, stylus: Stylus, reference: str | None, on_invalid: OnInvalid
    ) -> TipPath:
        """In the frame of a reference; None: of "Reference" where it was tracked, else of the tracker.

        Raises:
            InputError: no such tool, or too few poses.
        """
        frame = reference or _reference(recording)
        poses = recording.between(frame, stylus.name, None, on_invalid)
        used, repeats = distinct_poses(poses.matrices, poses.valid, recording.name)
        tip = np.asarray(stylus.tip_mm, dtype=float)
        tips = poses.matrices[:, :3, :3] @ tip + poses.matrices[:, :3, 3]
        places = np.where(used[:, None], tips, np.nan)
        return cls(frame, poses.matrices, tip, places, _times(recording), tuple(repeats))

    def shaft(self, rows: NDArray[np.int64]) -> Array:
        """(3,): unit, from the tip towards the marker, on average over some items."""
        way = -self.matrices[rows, :3, :3].mean(axis=0) @ self.tip_mm
        length = float(np.linalg.norm(way))
        return np.asarray(way / length) if length > 0 else np.zeros(3)


def _reference(recording: Recording) -> str:
    frames = [frame for poses in recording.poses.values() for frame in (poses.source, poses.target)]
    return next((frame for frame in frames if frame.lower() == "reference"), "Tracker")


def _times(recording: Recording) -> Array:
    times = recording.times
    return times if np.isfinite(times).all() else np.arange(len(times)) / RATE_HZ
