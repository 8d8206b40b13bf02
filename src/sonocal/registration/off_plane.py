"""Noise out of a 2D image's plane: a slice is thick, and what crosses it aslant is seen where it is in the slice."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.mapped import MappedRows
from sonocal.registration.uncertainty import point_jacobian
from sonocal.registration.whitened import whitened

__all__ = ["OffPlane", "off_plane_noise"]

FEWEST_TO_SPARE = 10
"""Residuals, without which no level besides the two of the fit is told."""


@dataclass(frozen=True, eq=False)
class OffPlane:
    """What the residuals say of it.

    Attributes:
        sigma_px: its standard deviation along the image's normal.
        score: standard deviations by which its score is more than noise of the image and the lines gives.
        covariance: (k, k): what it adds to the tangent's; no direction gets less.
    """

    sigma_px: float
    score: float
    covariance: Array


def off_plane_noise(
    mapped: MappedRows, chosen: NDArray[np.bool_], levels: tuple[float, float], parameters: int
) -> OffPlane | None:
    """The noise along the image's normal that makes residuals large where lines lean towards the image.

        r_i = J_i d + c_i a_i + e_i        c = W A w, of a point that is a off the image; W makes e white

    Of e and of a the variances make r'r and sum (c'r)^2 equal to their expectations after the fit has taken its
    part. The fit has weighed rows without a: its covariance grows by a^2 H C H' and shrinks by what e had of a.

    Args:
        mapped: rows of 2D images under the transform.
        chosen: (N,): those that were fitted.
        levels: noise of a point, px, and of a segment's end, mm; both 0 where rows weigh alike.
        parameters: k, of the transform's tangent.

    Returns:
        None of a volume, and where rows are too few.

    Source: Rao, Estimation of variance and covariance components (MINQUE), 1971; the score: Lin 1997.
    """
    rows = np.flatnonzero(chosen)
    freedom = 2 * len(rows) - parameters
    if mapped.table.dimension == 3 or freedom < FEWEST_TO_SPARE:
        return None
    normal = mapped.transform.rotation[:, 2] * float(mapped.transform.scales.mean())
    jacobian = point_jacobian(mapped.transform, mapped.table.points[rows], parameters)
    off = np.broadcast_to(normal[:, None], (len(rows), 3, 1))
    columns = np.concatenate([jacobian, off, mapped.residuals[rows][:, :, None]], axis=2)
    white = whitened(mapped, rows, columns, levels)
    # Unlike units of the tangent would make the inverse lose digits.
    size = np.linalg.norm(white[..., :parameters], axis=(0, 1))
    design, off, residual = white[..., :parameters] / size, white[..., -2], white[..., -1]
    of_all = design.reshape(-1, parameters)
    inverse = np.linalg.pinv(of_all.T @ of_all)
    residual = residual - design @ (inverse @ (of_all.T @ residual.reshape(-1)))
    pulls = np.einsum("nij,ni->nj", design, off)
    squares, taken = np.sum(off**2, axis=1), np.einsum("nj,jk,nk->n", pulls, inverse, pulls)
    both = pulls.T @ pulls
    once = float(np.sum(squares - taken))
    twice = float(np.sum(squares**2 - 2 * squares * taken) + np.trace(inverse @ both @ inverse @ both))
    beyond = twice - once**2 / freedom
    if not beyond > 0:
        return None
    unit = float(np.sum(residual**2)) / freedom
    more = float(np.sum(np.einsum("ni,ni->n", off, residual) ** 2)) - unit * once
    variance = max(more / beyond, 0.0)
    grown = variance * _no_less(inverse @ both @ inverse - once / freedom * inverse, inverse)
    return OffPlane(sqrt(variance), more / (unit * sqrt(2.0 * beyond)), grown / np.outer(size, size))


def _no_less(change: Array, covariance: Array) -> Array:
    """The part of a symmetric change (k, k) that makes a covariance larger, whatever the units."""
    values, axes = np.linalg.eigh(covariance)
    keep = values > 1e-12 * values.max()
    root, axes = np.sqrt(values[keep]), axes[:, keep]
    grown, turned = np.linalg.eigh((axes / root).T @ change @ (axes / root))
    back = (axes * root) @ turned
    return np.asarray((back * np.maximum(grown, 0.0)) @ back.T)
