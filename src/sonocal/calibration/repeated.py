"""Rows that repeat one another: a scan pasted twice, with or without the noise of a conversion, is one scan still."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.fit import FittedRows, fit_rows
from sonocal.calibration.mixed import target_distances
from sonocal.calibration.options import Options
from sonocal.calibration.result import Calibration
from sonocal.calibration.statistics import ErrorStatistics
from sonocal.findings import Diagnostic, Findings
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.registration.fit import Fit
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = ["Repeated", "fit_distinct", "repeated_rows"]

# Of the deviation of one row's residual along an axis: two sightings nearer than NEAR share their noise, which chance
# does to pairs of all nearness alike: then far more are up to WIDER times as far apart.
NEAR, WIDER, LEAST_MM = 0.5, 3.0, 1e-6
# In between the needle was at least that many deviations elsewhere: what rests is near itself by nature.
ELSEWHERE = 10.0
# Of all sightings, and how many, come back to a place to be called copies.
LEAST_SHARE, FEWEST = 0.1, 6
# Sightings whose neighbours are counted, and neighbours that are linked.
LOOKED_AT, LINKED = 300, 9


@dataclass(frozen=True, eq=False)
class Repeated:
    """What is left of rows once copies count once.

    Attributes:
        kept: (N,), rows of the first sighting of each that repeat one another.
        sightings: how many there are.
        distinct: how many differ.
    """

    kept: NDArray[np.bool_]
    sightings: int
    distinct: int

    def told_of(self, once: Calibration, rows: Observations) -> Calibration:
        """The calibration of the kept rows as that of all, with the finding that says so."""
        residuals = target_distances(once.probe_from_image, rows)
        inlier = residuals <= once.threshold_mm
        return replace(
            once,
            fit=ErrorStatistics.of(residuals[inlier], len(rows), int(inlier.sum())),
            residuals_mm=residuals,
            inlier=inlier,
            diagnostics=Findings(self.finding(), (once.diagnostics.__iter__,)),
            provenance={**once.provenance, "input": rows.source, "sha256": rows.sha256},
        )

    def finding(self) -> Iterator[Diagnostic]:
        """That rows repeat one another."""
        yield Diagnostic(
            code="repeated-rows",
            severity="warning",
            message=(
                f"rows repeat one another: {self.sightings} sightings are {self.distinct} that differ by more than a "
                "fraction of their noise; each counts once"
            ),
            advice="look for a scan that was pasted into the table twice; a copy is no second measurement",
        )


def fit_distinct(given: Observations, options: Options) -> tuple[Observations, FittedRows, Repeated | None]:
    """Fit rows of which those that repeat one another count once.

    Args:
        given: the sightings, copies among them or not.
        options: how to fit.

    Returns:
        The rows that were fitted, their fit, and what was left out; None: nothing was.

    Raises:
        SonocalError: as `fit_rows`.
    """
    fitted = fit_rows(given, options)
    repeated = repeated_rows(fitted.table, fitted.fit)
    if repeated is None:
        return given, fitted, None
    rows = given.select(repeated.kept)
    return rows, fit_rows(rows, options), repeated


def repeated_rows(table: PointLineRows | TargetRows, fit: Fit) -> Repeated | None:
    """Sightings to which the needle comes back far more nearly than noise allows; None: there are hardly any.

    Args:
        table: the fitted rows.
        fit: whose residuals say how large noise is.
    """
    if _plainly_distinct(table, fit):
        return None
    from scipy.spatial import cKDTree

    assert table.target is not None
    assert table.frame is not None
    sighting = _sightings(table)
    first = np.unique(sighting, return_index=True)[1]
    if len(first) < 2 * FEWEST or not fit.inlier.any():
        return None
    noise_mm = float(np.sqrt(np.mean(fit.residuals_mm[fit.inlier] ** 2) / 2.0))
    near = max(NEAR * noise_mm, LEAST_MM)
    target, time = table.target[first], table.frame[first]
    places = _places(table, sighting, first, float(fit.transform.scales.mean()))
    # Those of other targets are no copies, however near.
    spread = np.ptp(places, axis=0).max() + WIDER * near
    tree = cKDTree(np.column_stack([places, 2.0 * spread * target]))
    if not _has_copies(tree, near):
        return None
    copy_of = _linked(tree, near)
    back = _come_back(copy_of, places, target, time, max(ELSEWHERE * noise_mm, WIDER * near))
    if back < max(FEWEST, LEAST_SHARE * len(first)):
        return None
    kept = np.unique(copy_of, return_index=True)[1]
    return Repeated(np.isin(sighting, kept), len(first), len(kept))


def _plainly_distinct(table: PointLineRows | TargetRows, fit: Fit) -> bool:
    """A glance along one axis, on which copies are neighbours: whether hardly any neighbours have one segment."""
    ends = table.spanning_mm.reshape(len(table), -1)
    if table.sightings is not None:
        ends = ends[1:][table.sightings[1:] != table.sightings[:-1]]
    ends = ends[ends[:, 0].argsort()]
    steps = ends[1:] - ends[:-1]
    near = max(NEAR * NEAR * fit.squares_mm2 / max(int(np.count_nonzero(fit.inlier)), 1), LEAST_MM**2)
    alike = np.count_nonzero(np.einsum("nk,nk->n", steps, steps) <= 6.0 * near)
    return int(alike) < 0.5 * LEAST_SHARE * len(ends)


def _sightings(table: PointLineRows | TargetRows) -> NDArray[np.int64]:
    """(N,): a number a sighting, counted from 0."""
    return np.arange(len(table)) if table.sightings is None else table.sightings.astype(np.int64)


def _places(
    table: PointLineRows | TargetRows, sighting: NDArray[np.int64], first: NDArray[np.int64], scale: float
) -> Array:
    """(S, 3 + 3 K), mm: the middle of each sighting's points and what spans its target, as large as one's noise."""
    sums = np.zeros((len(first), 3))
    np.add.at(sums, sighting, table.points)
    middle = sums / np.bincount(sighting)[:, None]
    spanning = table.spanning_mm[first].reshape(len(first), -1)
    return np.concatenate([scale * middle, spanning / np.sqrt(3.0)], axis=1)


def _has_copies(tree: Any, near: float) -> bool:
    """Whether neighbours within `near` are many, and more than those up to `WIDER` times as far."""
    places = np.random.default_rng(0).permutation(tree.data)[:LOOKED_AT]
    nearest = tree.query(places, k=2, distance_upper_bound=near)[0][:, 1]
    if np.mean(np.isfinite(nearest)) < LEAST_SHARE:
        return False
    within, wider = (
        int(np.sum(tree.query_ball_point(places, radius, return_length=True) - 1))
        for radius in (near, WIDER * near)
    )
    return within > wider - within


def _linked(tree: Any, near: float) -> NDArray[np.int64]:
    """(S,): the group of sightings that are near one another, one over the other."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(tree.data)
    distance, other = tree.query(tree.data, k=min(LINKED, count), distance_upper_bound=near)
    one, place = np.nonzero(np.isfinite(distance))
    links = coo_matrix((np.ones(len(one)), (one, other[one, place])), shape=(count, count))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def _come_back(
    group: NDArray[np.int64],
    places: Array,
    target: NDArray[np.int32],
    time: NDArray[np.int32],
    elsewhere_mm: float,
) -> int:
    """How often a target is at a place again after it was elsewhere."""
    order = np.lexsort([time, target])
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order))
    by_group = np.lexsort([rank, group])
    pairs = group[by_group][1:] == group[by_group][:-1]
    before, after = by_group[:-1][pairs], by_group[1:][pairs]
    left = np.zeros(len(before), dtype=bool)
    for share in (0.25, 0.5, 0.75):
        between = order[(rank[before] + share * (rank[after] - rank[before])).astype(np.int64)]
        left |= np.linalg.norm(places[between] - places[before], axis=1) > elsewhere_mm
    return int(np.count_nonzero(left))
