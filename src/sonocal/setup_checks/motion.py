"""The rows that the checks over time look at, and the moments that both are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.observations import group_codes
from sonocal.registration.noise_in_columns import moved_by_noise
from sonocal.registration.uncertainty import point_jacobian
from sonocal.setup_checks.evidence import Evidence
from sonocal.setup_checks.rows_in_time import time_of, tracks_of

__all__ = ["FEWEST_FRAMES", "Motion", "motion_of", "ridged"]

FEWEST_FRAMES = 16
# A slip throws half of the rows out of the fit: they are looked at up to this many times its threshold.
GENEROUS = 4.0
# Of matrices with a unit diagonal: what keeps those that leave a motion free from having no inverse.
RIDGE = 1e-12


@dataclass(frozen=True, eq=False)
class Motion:
    """Rows (N) that take part, in the order given, with what the transform's k motions and time do to them.

    Attributes:
        rows: which of the observations they are.
        frame: (N,), counted from 0 in the order of time.
        number: (N,): the frame's number in the table.
        residuals: (N, 3), mm, across the line.
        displaced: (N, 3, k): what the motions do to the mapped point, mm a unit.
        jacobian: (N, 3, k): its part across the line.
        velocity: (N, 3), mm a unit of time: of the needle's point that was seen, across the line; 0 where unknown.
        usable: (N,): whether it is known.
        unit: of time: "s", or "frames".
        by_noise: (N, 2): what noise alone makes of the products of velocity with residual and with itself.
        pull_by_noise: (N, k): what the points' noise alone makes of the products of jacobian with residual.
    """

    rows: NDArray[np.int64]
    frame: NDArray[np.int64]
    number: NDArray[np.int64]
    residuals: Array
    displaced: Array
    jacobian: Array
    velocity: Array
    usable: NDArray[np.bool_]
    unit: str
    by_noise: Array | None = None
    pull_by_noise: Array | None = None

    @property
    def frames(self) -> int:
        """How many frames there are."""
        return int(self.frame.max()) + 1

    @property
    def parameters(self) -> int:
        """How many motions the transform has, k."""
        return int(self.jacobian.shape[2])

    @cached_property
    def moments(self) -> Array:
        """(N, k + 2, k + 2): of each row, products of jacobian, velocity and residual."""
        columns = np.concatenate(
            [self.jacobian, self.velocity[:, :, None], self.residuals[:, :, None]], axis=2
        )
        products = np.asarray(columns.swapaxes(1, 2) @ columns)
        if self.by_noise is not None:
            products[:, -2, -1] -= self.by_noise[:, 0]
            products[:, -1, -2] -= self.by_noise[:, 0]
            products[:, -2, -2] -= self.by_noise[:, 1]
        if self.pull_by_noise is not None:
            products[:, :-2, -1] -= self.pull_by_noise
            products[:, -1, :-2] -= self.pull_by_noise
        return products

    def summed(self, moments: Array, groups: NDArray[np.int64]) -> Array:
        """Moments (N, ...) of the rows' groups (N,), which are counted from 0 and all there, summed."""
        if len(groups) == groups[-1] + 1 and np.all(groups[1:] > groups[:-1]):
            return moments
        order = np.argsort(groups, kind="stable")
        first = np.searchsorted(groups[order], np.arange(int(groups.max()) + 1))
        return np.asarray(np.add.reduceat(moments[order], first, axis=0))


def motion_of(evidence: Evidence) -> Motion | None:
    """The rows that take part in checks over time; None where their frames are too few."""
    rows = np.flatnonzero(evidence.mapped.distances <= GENEROUS * evidence.threshold_mm)
    table = evidence.table
    assert table.frame is not None
    frame = table.frame[rows].astype(np.int64)
    if len(rows) < len(table):
        frame = group_codes(frame)
    if not len(rows) or frame.max() + 1 < FEWEST_FRAMES:
        return None
    displaced = point_jacobian(evidence.transform, table.points[rows], evidence.parameters)
    jacobian = evidence.mapped.across(rows, displaced)
    time, unit = time_of(evidence.observations, rows)
    velocity, usable = _velocities(evidence, rows, time)
    return Motion(
        rows=rows,
        frame=frame,
        number=evidence.observations.frame[rows],
        residuals=evidence.mapped.residuals[rows],
        displaced=displaced,
        jacobian=jacobian,
        velocity=velocity,
        usable=usable,
        unit=unit,
        pull_by_noise=_pull_by_noise(evidence, rows),
    )


def _pull_by_noise(evidence: Evidence, rows: NDArray[np.int64]) -> Array:
    """(N, k): the mean of J'r of each row that its point's noise alone makes, as both are of that point.

        E[J'r] = sigma_px^2 sum_k (P dJ/dx_k)' (P A e_k)        P: across the target

    Where motions leave little to tell, a slip would be seen in it.
    """

    def at(places: Array) -> Array:
        return point_jacobian(evidence.transform, places, evidence.parameters)

    pull = np.zeros((len(rows), evidence.parameters))
    for moved in moved_by_noise(evidence.mapped, rows, at, evidence.sigma_px):
        across = evidence.mapped.across(rows, moved)
        pull += np.einsum("nik,ni->nk", across[..., :-1], across[..., -1])
    return pull


def ridged(matrices: Array) -> Array:
    """Information matrices (..., k, k) with a unit diagonal, made to have an inverse."""
    return np.asarray(matrices + RIDGE * np.eye(matrices.shape[-1]))


def _velocities(evidence: Evidence, rows: NDArray[np.int64], time: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Velocity (N, 3) across the target of its point that was seen, from the sightings before and after."""
    spanning = evidence.table.spanning_mm[rows]
    track = tracks_of(evidence.observations, evidence.table)[rows]
    order = np.lexsort((time, track))
    ahead = (track[order[1:]] != track[order[:-1]]) | (time[order[1:]] > time[order[:-1]])
    order = order[np.concatenate([[True], ahead])]  # of sightings at one time the first
    inside = track[order[:-2]] == track[order[2:]]
    before, here, after = (part[inside] for part in (order[:-2], order[1:-1], order[2:]))
    change = (spanning[after] - spanning[before]) / (time[after] - time[before])[:, None, None]
    moved = np.einsum("nk,nki->ni", evidence.mapped.shares[rows[here]], change)
    velocity, usable = np.zeros((len(rows), 3)), np.zeros(len(rows), dtype=bool)
    velocity[here], usable[here] = evidence.mapped.across(rows[here], moved[:, :, None])[:, :, 0], True
    return velocity, usable
