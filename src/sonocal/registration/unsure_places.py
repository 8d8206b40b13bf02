"""Walls that are not where they are said to be: how far their own rows let an answer be off by it."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array
from sonocal.registration.fit import Fit
from sonocal.registration.mapped import MappedTargets
from sonocal.registration.uncertainty import point_jacobian
from sonocal.registration.whitened_targets import whitened_targets

__all__ = ["unsure_places"]

# Of what moving a wall does to the rows, the part that the transform must leave for its place to be told at all.
LEAST_TOLD = 1e-9


def unsure_places(mapped: MappedTargets, fit: Fit) -> Array:
    """(7, 7): what the tangent's covariance grows by where every plane may be elsewhere, as far as its rows allow.

        r = J d - B p + e        p: of each plane's three points, along its normal

    A plane that stays where it is wrong moves the answer by H B p, with H the fit. Of p the rows tell an estimate and
    its covariance, beside the transform; both count, since the answer was made without.

    Args:
        mapped: rows of planes alone, under the fit's transform.
        fit: of them.

    Source: the bias of a regression that leaves columns out (Seber and Lee, Linear Regression Analysis, 2003, 9.2).
    """
    table, k = mapped.table, len(fit.covariance)
    spanning = table.spanning_mm
    normals = np.cross(spanning[:, 1] - spanning[:, 0], spanning[:, 2] - spanning[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    which = np.unique(table.target, return_inverse=True)[1].reshape(-1)
    hot = (which[:, None] == np.arange(which.max() + 1)).astype(float)
    places = np.einsum("na,nt,nk->natk", normals, hot, mapped.shares).reshape(len(table), 3, -1)
    columns = np.concatenate(
        [point_jacobian(fit.transform, table.points, k), -places, mapped.residuals[:, :, None]], axis=2
    )
    white = whitened_targets(mapped, fit.inlier, columns, fit.levels).values
    size = np.maximum(np.linalg.norm(white[:, :k], axis=0), np.finfo(float).tiny)
    design, moved, residual = white[:, :k] / size, white[:, k:-1], white[:, -1]
    basis = np.linalg.svd(design, full_matrices=False)[0]
    left = moved - basis @ (basis.T @ moved)
    values, axes = np.linalg.eigh(left.T @ left)
    values = np.maximum(values, LEAST_TOLD * float(np.sum(moved**2)))
    freedom = max(len(residual) - k - moved.shape[1], 1)
    estimate = axes @ ((axes.T @ (left.T @ residual)) / values)
    unit = max(float(np.sum((residual - left @ estimate) ** 2)) / freedom, 1.0)
    unsure = unit * (axes / values) @ axes.T + np.outer(estimate, estimate)
    pulled = np.linalg.lstsq(design, moved, rcond=None)[0] / size[:, None]
    return np.asarray(pulled @ unsure @ pulled.T)
