"""Any number of rows to the numbers of a transform linearly, then the nearest similarity."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sonocal import _core
from sonocal.errors import InputError
from sonocal.registration.constraints import refuse_degenerate_rows
from sonocal.registration.solver_calls import Solutions, array, call, with_zero

__all__ = ["linear_lines", "linear_points"]


# Below this ratio of singular values a linear problem has a second solution.
SMALLEST_CONDITION = 1e-6


def linear_lines(points: ArrayLike, planes: ArrayLike, *, threads: int = 1) -> Solutions:
    """The paper's 3line3D for any number of rows: the 13 numbers of A linearly, then the nearest similarity.

    Centred and scaled, by normal equations: the error is 1e-16 times the squared condition number.

    Args:
        points: (..., N, 3), px, N >= 12 and not coplanar.
        planes: (..., N, 4), mm: (n, d) with n . x + d = 0; see `constraints` for lines and points.
        threads: how many share a batch.

    Returns:
        One solution, or none where the linear estimate mirrors or vanishes.

    Raises:
        InputError: a shape does not fit, or there are too few rows.
        DegenerateGeometryError: one problem given whose rows leave the 13 numbers undetermined.

    Source: paper section 5.2, eq. (10).
    """
    return _linear(points, planes, planar=False, threads=threads)


def linear_points(points_px: ArrayLike, planes: ArrayLike, *, threads: int = 1) -> Solutions:
    """The paper's 5point2D for any number of rows: c1, c2 and t linearly, then the nearest similarity.

    Args:
        points_px: (..., N, 2), px, N >= 9.
        planes: (..., N, 4), mm: (n, d) with n . x + d = 0; two for each point on a line.
        threads: how many share a batch.

    Returns:
        One solution, or none where the linear estimate vanishes.

    Raises:
        InputError: a shape does not fit, or there are too few rows.
        DegenerateGeometryError: one problem given whose rows leave the 10 numbers undetermined.

    Source: paper section 6.1, eq. (18)-(21).
    """
    return _linear(with_zero(array(points_px)), planes, planar=True, threads=threads)


def _linear(points: ArrayLike, planes: ArrayLike, *, planar: bool, threads: int) -> Solutions:
    x, p = array(points), array(planes)
    fewest = 9 if planar else 12
    if x.ndim < 2 or x.shape[-2] < fewest:
        raise InputError(f"the linear solver needs {fewest} rows or more; got points of shape {x.shape}")
    matrices, count, condition = call(
        _core.linear, (x, p), ("points (..., N, 3)", "planes (..., N, 4)"), planar, threads
    )
    free = ~(condition > SMALLEST_CONDITION)
    if free.ndim == 0:
        if free:
            refuse_degenerate_rows(x, p, linear=True)
        return Solutions(matrices, count)
    return Solutions(np.where(free[..., None, None, None], np.nan, matrices), np.where(free, 0, count))
