"""A calibration whose lines are late by a lag that nobody knows: it is fitted beside the transform."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.options import Options
from sonocal.calibration.result import Calibration
from sonocal.calibration.rows import check_rows, line_distances, point_line_rows, split_rows
from sonocal.calibration.statistics import ErrorStatistics
from sonocal.calibration.widened import widened
from sonocal.errors import NoConsensusError, UnsupportedError
from sonocal.findings import Diagnostic
from sonocal.observations import Observations
from sonocal.registration.degeneracy import refuse_degenerate_lines
from sonocal.registration.rows import PointLineRows
from sonocal.setup_checks.lag_fit import LagFit, fit_lag
from sonocal.setup_checks.lag_search import MOST_ASKED_S, rough_lag
from sonocal.setup_checks.latency import LEAST_LAG_MM, SIGNIFICANT_LAG
from sonocal.setup_checks.moving_lines import moving_in_table
from sonocal.setup_checks.rows_in_time import RowsInTime

__all__ = ["LaggedTable", "lag_in_words", "lag_of_rows", "rows_at_lag", "with_lag", "without_lag"]

# Where the noise is to tell how far off a row may be.
THRESHOLD_MM = 5.0


@dataclass(frozen=True, eq=False)
class LaggedTable:
    """A table whose lines were taken from another moment.

    Attributes:
        lag: by how much.
        rows: all rows, with their lines there.
        known: (N,): those whose lines are known there.
    """

    lag: LagFit
    rows: Observations
    known: NDArray[np.bool_]

    def told_of(self, found: Calibration, fitted: Observations) -> Calibration:
        """The calibration of the rows that are known, with the lag, as that of all rows that were to be fitted."""
        found = with_lag(found, self.lag, fitted)
        options = found.provenance["options"] | {"latency_asked": "estimate"}
        found = replace(found, provenance=found.provenance | {"options": options})
        if self.known.all():
            return found
        given = self.rows.select(_fitted(self.rows, found.options))
        residuals = line_distances(found.probe_from_image, given)
        inlier = (residuals <= found.threshold_mm) & self.known[_fitted(self.rows, found.options)]
        fit = ErrorStatistics.of(residuals[inlier], len(given), int(inlier.sum()))
        return replace(found, fit=fit, residuals_mm=residuals, inlier=inlier)


def without_lag(
    observations: Observations, options: Options
) -> tuple[Observations, Observations | None, Options, LaggedTable | None]:
    """The rows to fit, those held out, how to fit them, and the lag that was undone in both, if one is asked for.

    Raises:
        InputError: there is no such split, or the table tells nothing of how its lines moved.
        DegenerateGeometryError: they did not, so that no lag shows; or the sightings leave a motion free.
        NoConsensusError: rows agree under no lag.
        UnsupportedError: a lag is asked for, and some of the targets are no lines.
    """
    given, held_out = split_rows(observations, options.fit_split, options.test_split)
    if options.latency is None:
        return given, held_out, options, None
    if not observations.lines_only:
        raise UnsupportedError(
            f"{observations.source}: has points or planes among its targets; a lag is estimated of lines alone: "
            "calibrate without --latency estimate"
        )
    check_rows(given, options.model)
    rows = moving_in_table(observations, point_line_rows(observations))
    lag = lag_of_rows(rows.select(_fitted(observations, options)), options, observations.source)
    moved = rows.lines.at(rows.track, rows.time + lag.latency_s)
    there = observations.with_sound(segments_mm=moved.spanning_mm)
    late = LaggedTable(lag, there, moved.usable)
    known = there.select(moved.usable)
    return *split_rows(known, options.fit_split, options.test_split), replace(options, latency=None), late


def rows_at_lag(observations: Observations, latency_s: float) -> Observations:
    """All rows of a table with their lines where they were a lag later."""
    rows = moving_in_table(observations, point_line_rows(observations))
    return observations.with_sound(segments_mm=rows.lines.at(rows.track, rows.time + latency_s).spanning_mm)


def lag_of_rows(rows: RowsInTime, options: Options, source: str) -> LagFit:
    """The lag of rows whose lines are known at any time: the best of some that are tried, then fitted.

    Raises:
        DegenerateGeometryError: the lines did not move, so that no lag shows; or the rows leave a motion free.
        NoConsensusError: rows agree under no lag.
    """
    threshold_mm = THRESHOLD_MM if options.threshold_mm == "auto" else float(options.threshold_mm)
    rough = rough_lag(rows, threshold_mm, options.model)
    if rough is None:
        assert isinstance(rows.table, PointLineRows)  # a mix has no lag asked for
        refuse_degenerate_lines(rows.table)
        raise NoConsensusError(
            f"{source}: rows agree under no lag up to {1e3 * MOST_ASKED_S:.0f} ms either way; calibrate without "
            "--latency estimate, to be told what else is wrong",
            best_count=0,
        )
    lag, fit = rough
    return fit_lag(rows, fit.transform, lag, options, threshold_mm)


def with_lag(calibration: Calibration, lag: LagFit, rows: Observations) -> Calibration:
    """The calibration with the lag that it was made under, its interval, and its part in the error predicted.

    Args:
        calibration: of rows whose lines were taken from where the lag leads.
        lag: what was found.
        rows: as it was fitted to them.
    """
    told = list(_changing(lag))
    found = (
        calibration.with_findings(told)
        if calibration.covariance is None
        else widened(calibration, calibration.covariance + lag.covariance, rows, told)
    )
    return replace(found, latency_s=lag.latency_s, latency_interval_s=lag.interval_s)


def lag_in_words(calibration: Calibration) -> str:
    """The lag that was undone, with its interval where it was estimated; "" where none was."""
    latency = calibration.latency_s
    if latency is None:
        return ""
    late = f"the tracker's stamps are {1e3 * latency:.1f} ms later than the images'"
    if calibration.latency_interval_s is None:
        return f"Lag: {late}, as was said; undone."
    low, high = calibration.latency_interval_s
    return (
        f"Lag: {late} ({1e3 * low:.1f} to {1e3 * high:.1f} ms, 95 %), estimated with the calibration; undone."
    )


def _changing(lag: LagFit) -> Iterator[Diagnostic]:
    """The finding of a lag that is another one at the scan's end than at its begin."""
    moved_mm = 0.5 * abs(lag.change_s) * lag.speed_mm_s
    if not (abs(lag.change_s) > SIGNIFICANT_LAG * lag.change_deviation_s and moved_mm > LEAST_LAG_MM):
        return
    begin, end = (1e3 * (lag.latency_s + part * lag.change_s) for part in (-0.5, 0.5))
    yield Diagnostic(
        code="latency",
        severity="warning",
        message=(
            f"the tracker's lag changes during the scan, from some {begin:.0f} ms at its begin to {end:.0f} ms at its "
            f"end; {1e3 * lag.latency_s:.0f} ms are undone throughout, which is off by up to {moved_mm:.1f} mm"
        ),
        advice="stamp images and poses by one clock; until then scan for a shorter time",
    )


def _fitted(observations: Observations, options: Options) -> NDArray[np.bool_]:
    """(N,): the rows that are to be fitted, by their split."""
    if options.fit_split is not None:
        return np.asarray(observations.split == options.fit_split)
    return np.asarray(observations.split != options.test_split)  # all, where none is held out
