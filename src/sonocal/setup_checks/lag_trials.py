"""Rows under one lag after the other, each fitted by consensus from few samples."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import DegenerateGeometryError, NoConsensusError
from sonocal.geometry import Array
from sonocal.registration.best_fit import consensus_fit
from sonocal.registration.fit import Fit
from sonocal.registration.options import Options
from sonocal.setup_checks.motion import FEWEST_FRAMES
from sonocal.setup_checks.rows_in_time import RowsInTime, ShiftedRows

__all__ = ["Trial", "lag_trials", "some_sightings", "tried_lag"]

# Sightings that take part in the search, evenly from the whole scan: more make it no surer.
MOST_SEARCHED = 400
# Of the rows whose lines are known as they stand, those that must be known under a lag.
LEAST_KNOWN = 0.5
# An image shrunk to less than so many thresholds agrees with all lines that pass near one point.
LEAST_SIZE = 2.0


@dataclass(frozen=True, eq=False)
class Trial:
    """Rows under a lag, and the transform that most of them agree with, if any."""

    shifted: ShiftedRows
    fit: Fit | None
    threshold_mm: float

    @property
    def costs(self) -> Array:
        """(M,): of each row, between 0 and 1: truncated squared distances."""
        if self.fit is None:
            return np.ones(len(self.shifted.rows))
        return np.minimum(self.fit.residuals_mm / self.threshold_mm, 1.0) ** 2

    @property
    def cost(self) -> float:
        """Of all rows, in the middle."""
        return float(self.costs.mean())


def lag_trials(rows: RowsInTime, options: Options, most: float, step: float) -> tuple[Trial, list[Trial]]:
    """Some of the rows as they stand, and under each lag up to the most at which enough of them are known."""
    some = rows.select(some_sightings(rows, MOST_SEARCHED))
    still = tried_lag(some, 0.0, options)
    if not _enough(still.shifted):
        return replace(still, fit=None), []
    count = round(most / step)
    lags = step * np.arange(-count, count + 1)
    trials = [tried_lag(some, lag, options) for lag in lags if lag != 0.0]
    return still, [one for one in trials if len(one.shifted.rows) >= LEAST_KNOWN * len(still.shifted.rows)]


def some_sightings(rows: RowsInTime, most: int) -> NDArray[np.bool_]:
    """(N,): the rows of up to so many sightings, evenly from all."""
    sighting = np.arange(len(rows)) if rows.table.sightings is None else rows.table.sightings
    count = int(sighting.max(initial=0)) + 1
    kept = np.zeros(count, dtype=bool)
    kept[np.unique(np.linspace(0, count - 1, min(most, count)).astype(int))] = True
    return kept[sighting]


def _enough(shifted: ShiftedRows) -> bool:
    """Whether a lag can be looked for at all."""
    assert shifted.table.frame is not None
    return len(np.unique(shifted.table.frame)) >= FEWEST_FRAMES


def tried_lag(rows: RowsInTime, lag: float, options: Options) -> Trial:
    """The rows under a lag, fitted by consensus."""
    assert options.threshold_mm != "auto"
    shifted = rows.shifted(lag)
    try:
        fit = consensus_fit(shifted.table, options) if len(shifted.rows) >= FEWEST_FRAMES else None
    except (NoConsensusError, DegenerateGeometryError):
        fit = None
    if fit is not None:
        size = float(np.ptp(fit.transform.apply(shifted.table.points), axis=0).max())
        fit = fit if size > LEAST_SIZE * options.threshold_mm else None
    return Trial(shifted, fit, options.threshold_mm)
