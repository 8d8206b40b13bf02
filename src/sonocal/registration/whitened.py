"""Residuals across the lines and their derivatives, made independent and of unit variance."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.mapped import MappedRows

__all__ = ["across_lines", "whitened"]

HUBER = 4.0  # standard deviations, as in the refinement
# Points or ends without any noise would leave nothing to divide by.
LEAST_SHARE = 1e-3


def across_lines(directions: Array) -> Array:
    """(N, 2, 3): two axes across each line of directions (N, 3)."""
    least = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, least)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def whitened(
    mapped: MappedRows, rows: NDArray[np.int64], columns: Array, levels: tuple[float, float]
) -> Array:
    """Vectors of each row as seen across its line, in units of the noise; rows far out count less.

    A point's noise lies in the image, an end's is alike all round, and rows of one sighting share that of its ends.

    Args:
        mapped: rows under the transform.
        rows: (M,): indices of those to look at, rows of one sighting side by side.
        columns: (M, 3, C), mm; the last column is the residual.
        levels: noise of a point along each axis, px, and of an end of a segment, mm, each times the table's own
            columns; both 0 where rows weigh alike.

    Returns:
        (M, 2, C).
    """
    across = across_lines(mapped.directions[rows])
    both = across @ columns
    if levels == (0.0, 0.0):
        size = np.sqrt(np.mean(both[..., -1] ** 2, axis=1))
        return _limited(both / max(float(np.sqrt(np.mean(size**2))), np.finfo(float).tiny))
    seen, ends = _deviations(mapped, rows, across, levels)
    sighting = rows if mapped.table.dimension == 2 else mapped.table.sightings[rows]  # type: ignore[index]
    counts = np.unique(sighting, return_counts=True)[1]
    first = np.cumsum(counts) - counts
    for count in np.unique(counts):
        at = first[counts == count][:, None] + np.arange(count)
        covariance = np.einsum("gae,gbe,kl->gakbl", ends[at], ends[at], np.eye(2))
        own = seen[at] @ np.swapaxes(seen[at], 2, 3)
        for place in range(count):
            covariance[:, place, :, place] += own[:, place]
        root = np.linalg.cholesky(covariance.reshape(len(at), 2 * count, 2 * count))
        both[at] = np.linalg.solve(root, both[at].reshape(len(at), 2 * count, -1)).reshape(both[at].shape)
    return _limited(both)


def _deviations(
    mapped: MappedRows, rows: NDArray[np.int64], across: Array, levels: tuple[float, float]
) -> tuple[Array, Array]:
    """What a point's noise is across the line (M, 2, d), and what either end's is at the point (M, 2), mm."""
    table, axes = mapped.table, mapped.transform.rotation * mapped.transform.scales
    px = levels[0] * (np.ones(len(rows)) if table.sigma_px is None else table.sigma_px[rows])
    mm = levels[1] * (np.ones(len(rows)) if table.sigma_mm is None else table.sigma_mm[rows])
    least = LEAST_SHARE * (float(mm.mean()) / float(mapped.transform.scales.mean()))
    px = np.maximum(px, max(least, np.finfo(float).tiny ** 0.25))
    place = mapped.along_mm[rows] / mapped.lengths_mm[rows]
    seen = (across @ axes[:, : table.dimension]) * px[:, None, None]
    # A point's noise has no part out of a 2D image: a line in it would have none across, were there none of its ends.
    mm = np.maximum(mm, LEAST_SHARE * px * float(mapped.transform.scales.mean()))
    return seen, np.stack([1.0 - place, place], axis=1) * mm[:, None]


def _limited(both: Array) -> Array:
    """The rows (M, 2, C) by Huber's weights."""
    size = np.sqrt(np.mean(both[..., -1] ** 2, axis=1))
    return np.asarray(both * np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, HUBER)))[:, None, None])
