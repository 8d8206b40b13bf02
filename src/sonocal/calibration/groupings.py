"""What rows may share an error by, as registration's noise takes it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.observations import group_codes
from sonocal.registration.fit import Fit
from sonocal.registration.mapped import MappedRows
from sonocal.registration.noise import stretch_length

__all__ = ["Groupings", "groupings_of"]


class Groupings(NamedTuple):
    """Groups of rows that may share an error.

    Attributes:
        labels: by name ("frame", "target", "stretch" of frames): (N,) the group of each row.
        stretch_frames: how many frames a stretch has; 1 where neighbours have nothing in common.
    """

    labels: dict[str, NDArray[Any]]
    stretch_frames: int


def groupings_of(mapped: MappedRows, fit: Fit, split: NDArray[np.str_]) -> Groupings:
    """Frames, needles or wires, and stretches of frames over which the residuals repeat one another."""
    frame, target = mapped.table.frame, mapped.table.target
    assert frame is not None
    assert target is not None
    stretch = stretch_length(mapped.residuals[fit.inlier], frame[fit.inlier])
    labels: dict[str, NDArray[Any]] = {"frame": frame, "target": target}
    if stretch > 1:
        labels["stretch"] = group_codes(split, frame // stretch)
    return Groupings(labels, stretch)
