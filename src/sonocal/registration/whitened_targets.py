"""Residuals from whatever targets and their derivatives, made independent and of unit variance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.mapped import MappedTargets
from sonocal.registration.whitened import HUBER, LEAST_SHARE, across_lines

__all__ = ["WhiteTargets", "whitened_targets"]


class WhiteTargets(NamedTuple):
    """White numbers.

    Attributes:
        values: (R, C): of each, what the columns come to.
        row: (R,): a row of its sighting, as an index of the table.
    """

    values: Array
    row: NDArray[np.int64]


def whitened_targets(
    mapped: MappedTargets, chosen: NDArray[np.bool_], columns: Array, levels: tuple[float, float]
) -> WhiteTargets:
    """Vectors of rows as seen away from their targets, in units of the noise; sightings far out count less.

    A point's noise lies in the image, a spanning point's is alike all round, and points of a sighting share it by the
    shares that spanning points have of their places.

    Args:
        mapped: rows under the transform.
        chosen: (N,): those to look at, all of a sighting alike.
        columns: (N, 3, C), mm; the last column is the residual.
        levels: noise of a point along each axis, px, and of a spanning point, mm, each times the table's own columns;
            both 0 where rows weigh alike.
    """
    table = mapped.table
    rows = table.order[chosen[table.order]]
    sighting = table.sightings[rows]
    first = np.flatnonzero(np.diff(sighting, prepend=-1))
    counts = np.diff(first, append=len(rows))
    values, row = [], []
    for spans in (1, 2, 3):
        for count in np.unique(counts[table.spans[rows[first]] == spans]):
            some = first[(counts == count) & (table.spans[rows[first]] == spans)]
            at = rows[some[:, None] + np.arange(count)]
            white = _of_sightings(mapped, at, columns, levels)
            values.append(white.reshape(-1, columns.shape[2]))
            row.append(np.repeat(at[:, 0], white.shape[1]))
    white = np.concatenate(values)
    if levels == (0.0, 0.0):
        white = white / max(float(np.sqrt(np.mean(white[:, -1] ** 2))), np.finfo(float).tiny)
    return WhiteTargets(white, np.concatenate(row))


def _of_sightings(
    mapped: MappedTargets, at: NDArray[np.int64], columns: Array, levels: tuple[float, float]
) -> Array:
    """(G, c r, C): of sightings of one kind, whose c rows each are (G, c)."""
    basis = _normals(mapped, at[:, 0])
    groups, count, normals = *at.shape, basis.shape[1]
    both = np.einsum("gra,gcai->gcri", basis, columns[at]).reshape(groups, count * normals, -1)
    if levels == (0.0, 0.0):
        return np.asarray(both)
    covariance = _covariance(mapped, at, basis, levels).reshape(groups, count * normals, count * normals)
    white = np.linalg.solve(np.linalg.cholesky(covariance), both)
    size = np.sqrt(np.mean(white[..., -1] ** 2, axis=1))
    return np.asarray(white * np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, HUBER)))[:, None, None])


def _normals(mapped: MappedTargets, rows: NDArray[np.int64]) -> Array:
    """(G, r, 3): orthonormal directions away from targets of one kind."""
    spanning, spans = mapped.table.spanning_mm[rows], int(mapped.table.spans[rows[0]])
    if spans == 1:
        return np.asarray(np.broadcast_to(np.eye(3), (len(rows), 3, 3)))
    along = spanning[:, 1] - spanning[:, 0]
    if spans == 2:
        return across_lines(np.asarray(along / np.linalg.norm(along, axis=1, keepdims=True)))
    normal = np.cross(along, spanning[:, 2] - spanning[:, 0])
    return np.asarray((normal / np.linalg.norm(normal, axis=1, keepdims=True))[:, None])


def _covariance(
    mapped: MappedTargets, at: NDArray[np.int64], basis: Array, levels: tuple[float, float]
) -> Array:
    """(G, c, r, c, r), mm^2."""
    table, transform = mapped.table, mapped.transform
    scale = float(transform.scales.mean())
    px = levels[0] * (1.0 if table.sigma_px is None else table.sigma_px[at]) * np.ones(at.shape)
    mm = levels[1] * (1.0 if table.sigma_mm is None else table.sigma_mm[at[:, 0]]) * np.ones(len(at))
    # Points or targets without any noise would leave nothing to divide by.
    px = np.maximum(px, max(LEAST_SHARE * float(mm.mean()) / scale, np.finfo(float).tiny ** 0.25))
    mm = np.maximum(mm, LEAST_SHARE * scale * px.mean(axis=1))
    shares, normals = mapped.shares[at], np.eye(basis.shape[1])
    covariance = np.einsum("g,gak,gbk,rs->garbs", mm**2, shares, shares, normals)
    seen = basis @ (transform.rotation * transform.scales)[:, : table.dimension]
    own = seen @ np.swapaxes(seen, 1, 2)
    for place in range(at.shape[1]):
        covariance[:, place, :, place] += (px[:, place] ** 2)[:, None, None] * own
    return np.asarray(covariance)
