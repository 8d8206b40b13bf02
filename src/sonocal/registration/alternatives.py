"""Other similarities that fit correspondences as well as the one that was found."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array, Similarity
from sonocal.registration import solvers
from sonocal.registration.constraints import Rows
from sonocal.registration.uncertainty import point_covariance

__all__ = ["alternatives_to"]

# Samples of seven rows, each of which gives up to eight starts: an answer that one sample in ten leads to is missed
# once in five hundred times.
SAMPLES = 60
# Steps to rest on all rows, from a start that only seven of them gave.
STEPS = 40
# Many rows say no more of whether another answer fits: those of so many are looked at.
MOST_ROWS = 400
# Apart by more than this part of the points' size, answers are two.
APART = 1e-3
# Of the scale found: what shrinks the source to a point is no answer.
SHRUNK = 1e-3
# Of the points' size: seven rows fit exactly, up to rounding, in several ways.
EXACT = 1e-8


def alternatives_to(
    found: Similarity,
    covariance: Array | None,
    rows: Rows,
    *,
    weights: Array | None = None,
    scale: float | None = None,
    seed: int = 0,
) -> tuple[Similarity, ...]:
    """Similarities, far from the one that was found, at which the sum of squares is not significantly greater.

    Least squares on all rows from the minimal solutions of random samples of them; an answer stays where the residuals'
    variance under it is not excluded by F at 95 %.

    Args:
        found: the answer.
        covariance: (7, 7), of its tangent: an answer within three deviations of it is no other. None: not known.
        rows: the correspondences that agree with it.
        weights: (N,), what rows' residuals are multiplied by; None: all alike.
        scale: where it is known.
        seed: of the samples.

    Returns:
        The others, best first.
    """
    random = np.random.default_rng(seed)
    count = len(rows)
    kept = np.sort(random.permutation(count)[:MOST_ROWS])
    points, planes = rows.points[kept], rows.planes[kept]
    if weights is not None:
        planes = planes * weights[kept, None]
    order = np.argsort(random.random((SAMPLES, len(kept))), axis=1)
    solved = solvers.three_quadrics(points[order], planes[order], steps=STEPS, scale=scale)
    matrices = solved.matrices[np.arange(solved.matrices.shape[1]) < np.atleast_1d(solved.count)[:, None]]
    starts = [
        Similarity.from_matrix(one) for one in matrices if np.linalg.norm(one[:3, 0]) > SHRUNK * found.scale
    ]
    size = float(np.ptp(found @ points, axis=0).max())
    least = max(_squares(found, points, planes), (EXACT * size) ** 2)
    most = _most(least, len(kept), 7 if scale is None else 6)
    ranked = sorted(((_squares(one, points, planes), one) for one in starts), key=lambda pair: pair[0])
    others: list[Similarity] = []
    within = np.full(len(points), APART * size)
    sure = within if covariance is None else np.maximum(within, 3.0 * _deviations(found, covariance, points))
    for one in (one for squares, one in ranked if squares <= most):
        if _apart(one, found, points, sure) and all(_apart(one, other, points, within) for other in others):
            others.append(one)
    return tuple(others)


def _squares(similarity: Similarity, points: Array, planes: Array) -> float:
    residuals = np.einsum("ij,ij->i", similarity @ points, planes[:, :3]) + planes[:, 3]
    return float(residuals @ residuals)


def _most(least: float, rows: int, parameters: int) -> float:
    """The greatest sum of squares that the least one does not exclude."""
    from scipy.special import fdtri

    spare = rows - parameters
    if spare <= 0:
        return least
    return least * (1.0 + parameters / spare * float(fdtri(parameters, spare, 0.95)))


def _deviations(similarity: Similarity, covariance: Array, points: Array) -> Array:
    """(N,), mm: of mapped points."""
    return np.asarray(np.sqrt(np.trace(point_covariance(similarity, covariance, points), axis1=1, axis2=2)))


def _apart(one: Similarity, other: Similarity, points: Array, within: Array) -> bool:
    return bool(np.any(np.linalg.norm(one @ points - other @ points, axis=1) > within))
