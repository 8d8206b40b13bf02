"""What rows may share an error by, as registration's noise takes it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import FURTHEST, Array
from sonocal.observations import Observations, group_codes
from sonocal.registration.fit import Fit
from sonocal.registration.noise import Noise, estimate_noise
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = ["Groupings", "groupings_of"]


class Groupings(NamedTuple):
    """Groups of rows that may share an error.

    Attributes:
        labels: by name ("frame", "target"): (N,) the group of each row.
        time: (N,), of each row's frame, in the median gap between frames: neighbours may share an error, too.
    """

    labels: dict[str, NDArray[Any]]
    time: Array

    def noise_of(self, table: PointLineRows | TargetRows, known: dict[str, bool], fit: Fit) -> Noise:
        """The noise of a fit of the rows, by what they may share.

        Args:
            table: the rows.
            known: which noise levels were given.
            fit: of any model.
        """
        return estimate_noise(table, fit, self.labels, time=self.time, **known)


def groupings_of(table: PointLineRows | TargetRows, rows: Observations) -> Groupings:
    """Frames, needles or wires, and which frames are neighbours in time.

    Args:
        table: the rows as registration takes them.
        rows: the same; its column ``time_s``, where there is one, says when they were, else the order of frames.
    """
    assert table.frame is not None
    assert table.target is not None
    return Groupings({"frame": table.frame, "target": table.target}, _time(table, rows))


def _time(table: PointLineRows | TargetRows, rows: Observations) -> Array:
    stamps = rows.stamps_s()
    if stamps is None:
        # In volumes a split may be a candidate's rank, which says nothing of when.
        order = table.frame if rows.dimension == 2 else group_codes(rows.frame)
        return np.asarray(order, dtype=float)
    instants, instant = np.unique(stamps, return_inverse=True)
    if len(instants) < 2:
        return np.zeros(len(stamps))
    # Stamps of 1e300 s are no time: their order is.
    if np.ptp(instants) >= FURTHEST * np.median(np.diff(instants)):
        return np.asarray(instant, dtype=float)
    return np.asarray((stamps - instants[0]) / np.median(np.diff(instants)))
