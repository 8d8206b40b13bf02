"""The lag under which most rows agree, looked for before any consensus: beyond it no residual tells of a lag."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.best_fit import refined_fit
from sonocal.registration.fit import Fit
from sonocal.registration.mapped import mapped_rows
from sonocal.registration.options import Model, Options
from sonocal.registration.uncertainty import point_jacobian
from sonocal.setup_checks.lag_trials import Trial, lag_trials, some_sightings, tried_lag
from sonocal.setup_checks.latency import deviation_of, is_significant, latency_of, speed_of
from sonocal.setup_checks.motion import FEWEST_FRAMES, Motion
from sonocal.setup_checks.rows_in_time import RowsInTime, ShiftedRows, Table

__all__ = ["LEAST_AGREEING", "Lag", "find_lag", "rough_lag"]

# Lags tried to either side: of a frame grabber, a video chain, a tracker's filter; and how finely, where a fast hand
# moves by less than the threshold.
MOST_S, STEP_S = 0.3, 0.02
# And where a lag is asked for, that no chance has to be told from.
MOST_ASKED_S = 0.5
MOST_FRAMES, STEP_FRAMES = 6.0, 0.5
FEW_SAMPLES = 300
# Sightings that take part in the refinement, evenly from the whole scan: more make it no surer.
MOST_REFINED = 4000
REFINEMENTS = 6
# Standard deviations, over stretches of the scan, of what a lag gains: half of those that the lag itself must have,
# since the gain grows with its square.
SIGNIFICANT_GAIN = 2.0
# Share of the costs below which what is left is no drift that looks like a lag: that leaves most of itself.
MUCH = 0.5
STRETCHES = 12
# Share of the velocities' squares that may be noise: needles that stand still tell of no lag.
MOST_BY_NOISE = 0.75
# Share of rows, each of which is meant to be right, that agree under a lag that is one.
LEAST_AGREEING = 0.5
# Share of a step within which a refined lag has come to rest.
AT_REST = 1e-3


@dataclass(frozen=True, eq=False)
class Lag:
    """A lag under which the rows agree better than as they stand.

    Attributes:
        value: how much later the tracker stamps an instant than the images do, in units of time.
        deviation: its standard deviation.
        unit: "s" or "frames".
        speed: of the needle where it is seen, rms, across itself, mm a unit of time.
        agreeing, compared: rows that agree under the lag, of those whose lines are known under it and without.
        fit: the transform under the lag.
    """

    value: float
    deviation: float
    unit: str
    speed: float
    agreeing: int
    compared: int
    fit: Fit

    @property
    def moved_mm(self) -> float:
        """By how much the lag moves the needle at its usual speed."""
        return abs(self.value) * self.speed


def find_lag(
    rows: RowsInTime, threshold_mm: float, model: Model = "similarity", least: float = LEAST_AGREEING
) -> Lag | None:
    """The lag that explains more than chance; None where there is none, or where time or motion are missing.

    For each of some lags the lines are carried to where they were then, and fitted by consensus from few samples. The
    best is refined with the transform, and must leave the rows' costs lower over most stretches of the scan.

    Args:
        rows: and where their lines were at any moment.
        threshold_mm: rows within this distance agree.
        model: of the transform.
        least: share of the rows that must agree under the lag.
    """
    options = _searched_with(threshold_mm, model)
    most, step = (MOST_S, STEP_S) if rows.unit == "s" else (MOST_FRAMES, STEP_FRAMES)
    still, trials = lag_trials(rows, options, most, step)
    best = min(trials, key=lambda one: one.cost, default=still)
    if best.fit is None:
        return None
    found = _refined(rows.select(some_sightings(rows, MOST_REFINED)), best, options, step, most)
    return found if found is not None and found.agreeing >= least * found.compared else None


def rough_lag(rows: RowsInTime, threshold_mm: float, model: Model = "similarity") -> tuple[float, Fit] | None:
    """The lag of those tried, s, under which the rows agree best, none among them, and the fit; None: under none.

    Args:
        rows: and where their lines were at any moment.
        threshold_mm: rows within this distance agree.
        model: of the transform.
    """
    options = _searched_with(threshold_mm, model)
    still, trials = lag_trials(rows, options, MOST_ASKED_S, STEP_S)
    best = min((still, *trials), key=lambda one: one.cost)
    return None if best.fit is None else (float(best.shifted.lag), best.fit)


def _searched_with(threshold_mm: float, model: Model) -> Options:
    """A search needs no known scale: with one to find, it only looks among more answers."""
    free: Model = "similarity" if model == "rigid" else model
    return Options(threshold_mm=threshold_mm, model=free, max_samples=FEW_SAMPLES)


def _refined(rows: RowsInTime, best: Trial, options: Options, step: float, most: float) -> Lag | None:
    """The lag and the transform refined together, if they stand against chance."""
    assert best.fit is not None
    lag, fit = best.shifted.lag, best.fit
    motion = None
    for _ in range(REFINEMENTS):
        shifted = rows.shifted(lag)
        fit = _fitted(fit, shifted.table, options)
        motion = _motion(shifted, fit, rows.unit, best.threshold_mm)
        if motion is None:
            return None
        change = float(np.clip(latency_of(motion), -step, step))
        lag += change
        if abs(lag) > most + step:
            return None
        if abs(change) < AT_REST * step:
            break
    assert motion is not None
    found = Trial(rows.shifted(lag), None, best.threshold_mm)
    found = replace(found, fit=_fitted(fit, found.shifted.table, options))
    still = tried_lag(rows, 0.0, replace(options, max_samples=10 * FEW_SAMPLES))
    return _compared(rows.time, found, still, motion)


def _fitted(start: Fit, table: Table, options: Options) -> Fit:
    """The transform refined on the rows that agree with it; as it was, where none does."""
    assert options.threshold_mm != "auto"
    agreeing = mapped_rows(start.transform, table).distances <= options.threshold_mm
    return refined_fit(start.transform, table, agreeing, options) if agreeing.any() else start


def _compared(time: Array, found: Trial, still: Trial, motion: Motion) -> Lag | None:
    """The lag, if it is surer than chance and its rows' costs are lower over the stretches of the scan."""
    assert found.fit is not None
    common, ours, theirs = np.intersect1d(found.shifted.rows, still.shifted.rows, return_indices=True)
    before, after = still.costs[theirs], found.costs[ours]
    stretch = np.argsort(np.argsort(time[common], kind="stable")) * STRETCHES // max(len(common), 1)
    gains = np.bincount(stretch, before - after, minlength=STRETCHES).astype(float)
    if not _signed_rank(gains) > SIGNIFICANT_GAIN:
        return None
    agree, lag, deviation = after < 1.0, found.shifted.lag, deviation_of(motion)
    much = float(after[agree].sum()) < MUCH * float(before[agree].sum())
    if not is_significant(motion, lag, deviation, motion.residuals, may_drift=not much):
        return None
    return Lag(
        value=lag,
        deviation=deviation,
        unit=motion.unit,
        speed=speed_of(motion),
        agreeing=int(np.count_nonzero(agree)),
        compared=len(common),
        fit=found.fit,
    )


def _signed_rank(gains: Array) -> float:
    """Wilcoxon's signed-rank statistic of gains (S,) against none, in standard deviations.

    A lag throws some stretches out of the fit altogether and hardly shows in others: signs and ranks tell of both.
    """
    ranks = np.argsort(np.argsort(np.abs(gains))) + 1.0
    return float(np.sum(np.sign(gains) * ranks) / np.sqrt(np.sum(ranks**2)))


def _motion(shifted: ShiftedRows, fit: Fit, unit: str, threshold_mm: float) -> Motion | None:
    """What the transform's motions and time do to the rows that agree; None where they are too few or too slow."""
    mapped = mapped_rows(fit.transform, shifted.table)
    agree = np.flatnonzero(mapped.distances <= threshold_mm)
    assert shifted.table.frame is not None
    if len(np.unique(shifted.table.frame[agree])) < FEWEST_FRAMES:
        return None
    displaced = point_jacobian(fit.transform, shifted.table.points[agree], len(fit.covariance))
    shares = mapped.shares[agree]
    moved = np.einsum("nk,nki->ni", shares, shifted.moved.velocities[agree])
    frame = np.unique(shifted.table.frame[agree], return_inverse=True)[1].reshape(-1).astype(np.int64)
    velocity = mapped.across(agree, moved[:, :, None])[:, :, 0]
    by_noise = _by_noise(shifted, agree, shares)
    if by_noise[:, 1].sum() > MOST_BY_NOISE * np.sum(velocity**2):
        return None
    return Motion(
        rows=shifted.rows[agree],
        frame=frame,
        number=frame,
        residuals=mapped.residuals[agree],
        displaced=displaced,
        jacobian=mapped.across(agree, displaced),
        velocity=velocity,
        usable=np.full(len(agree), True),
        unit=unit,
        by_noise=by_noise,
    )


def _by_noise(shifted: ShiftedRows, rows: NDArray[np.int64], shares: Array) -> Array:
    """(M, 2): products of velocity with residual and itself that noise gives, over all directions across targets."""
    moved, directions = shifted.moved, 4.0 - shifted.table.spans[rows]
    across = (directions * np.sum(shares**2, axis=1))[:, None]
    # A residual has the noise of the line taken away.
    return np.asarray(across * np.stack([-moved.coupling[rows], moved.unrest[rows]], axis=1))
