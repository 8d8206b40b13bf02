"""Minimal and linear solvers: points, lines and planes to a similarity.

Every solver takes leading batch axes and runs them in compiled code; without any, it solves one problem.
Noise often leaves a minimal sample without a real solution. With ``steps=0`` such a sample has count 0;
with more, the nearest real candidates are refined on every equation: `four_points`, `two_conics` and `two_lines` then
always have one, `three_quadrics` misses one noisy sample in some 700.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal import _core
from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.registration.constraints import planes_of_lines, refuse_degenerate_rows

__all__ = [
    "Solutions",
    "four_points",
    "linear_lines",
    "linear_points",
    "paper_four_points",
    "paper_two_lines",
    "three_points",
    "three_quadrics",
    "two_conics",
    "two_lines",
]


# How messages name what a solver takes.
_PLANE = ("points_px (..., 4, 2)", "segments_mm (..., 4, 2, 3)")
_LINES = ("image_segments (..., 2, 2, 3)", "needle_segments (..., 2, 2, 3)")
_ROWS = ("points (..., N, 3)", "planes (..., N, 4), N >= 7 (6 where the scale is known)")
_FLAT = ("points_px (..., N, 2)", "planes (..., N, 4), N >= 7")
_PAIRS = ("points (..., 3, 3)", "places_mm (..., 3, 3)")
_SPACE = ("points (..., 4, 3)", "segments_mm (..., 4, 2, 3)")


@dataclass(eq=False, slots=True)  # not frozen: that costs half a microsecond a call
class Solutions:
    """The similarities that solve each problem of a batch.

    Attributes:
        matrices: (..., K, 4, 4), mm from px, `count` of them first and NaN after; s > 0, det R = +1.
        count: (...), or a number where one problem was given: how many there are; 0 where the problem is
            degenerate or noise leaves no real one.
    """

    matrices: Array
    count: NDArray[np.int64] | int


def four_points(
    points_px: ArrayLike,
    segments_mm: ArrayLike,
    *,
    steps: int = 0,
    scale: float | None = None,
    threads: int = 1,
) -> Solutions:
    """Similarities that carry four points of a plane onto four lines.

        A (x_i, y_i, 0, 1)^T on L_i, i = 1..4        |c1|^2 - |c2|^2 = 0,  c1 . c2 = 0

    Seven of the eight equations: the points' affine dependency leaves two unknowns, the two conics in
    them a quartic. Which equation is left out is chosen for conditioning.

    Args:
        points_px: (..., 4, 2), px.
        segments_mm: (..., 4, 2, 3), mm: two points on each line.
        steps: 0 for exact solutions of seven equations. Otherwise so many Gauss-Newton steps on all eight,
            from every solution and from the real part of every complex pair; best first.
        scale: mm per px where it is known (rigid); needs `steps`.
        threads: how many share a batch; the result is the same.

    Returns:
        Up to 4 solutions each.

    Raises:
        InputError: a shape or an option does not fit, or one problem given is not finite.
        DegenerateGeometryError: one problem given whose lines or points leave a motion free. In a batch
            such a row has count 0 instead.

    Source: the problem of paper section 6.2; compare `paper_four_points`.
    """
    return _solve(
        _core.four_points,
        (points_px, segments_mm),
        _PLANE,
        _rows_of_plane,
        steps,
        0.0 if scale is None else _known(scale, steps),
        threads,
    )


def two_lines(
    image_segments: ArrayLike,
    needle_segments: ArrayLike,
    *,
    steps: int = 0,
    scale: float | None = None,
    threads: int = 1,
) -> Solutions:
    """Similarities that carry two lines of the image onto two needles.

        A B_i = L_i, i = 1, 2        A = [[s R, t], [0, 1]]

    Closed form: directions give R up to half a turn about the common perpendicular, the perpendiculars'
    lengths give s, their middles t. All eight equations take part, so noise never leaves it without a
    solution.

    Args:
        image_segments: (..., 2, 2, 3), px: two points on each line.
        needle_segments: (..., 2, 2, 3), mm: two points on each needle.
        steps: Gauss-Newton steps on the distances of the image points from the needles; best first.
        scale: mm per px where it is known (rigid); needs `steps`.
        threads: how many share a batch; the result is the same.

    Returns:
        2 solutions each.

    Raises:
        InputError: a shape or an option does not fit, or one problem given is not finite.
        DegenerateGeometryError: one problem given whose lines are parallel or meet. In a batch such a row
            has count 0 instead.

    Source: closed form of the paper's section 5 problem; compare `paper_two_lines`.
    """
    return _solve(
        _core.two_lines,
        (image_segments, needle_segments),
        _LINES,
        _rows_of_lines,
        steps,
        0.0 if scale is None else _known(scale, steps),
        threads,
    )


def three_points(
    points: ArrayLike, places_mm: ArrayLike, *, scale: float | None = None, threads: int = 1
) -> Solutions:
    """The similarity that carries three points nearest to three places.

        sum_i |A x_i - y_i|^2 least

    Closed form: the quaternion of R is the eigenvector of a symmetric 4 x 4 matrix, s and t follow. All nine
    equations take part.

    Args:
        points: (..., 3, 3), px.
        places_mm: (..., 3, 3), mm.
        scale: mm per px where it is known (rigid).
        threads: how many share a batch; the result is the same.

    Returns:
        1 solution each.

    Raises:
        InputError: a shape or an option does not fit, or one problem given is not finite.
        DegenerateGeometryError: one problem given whose points or places lie on a line. In a batch such a row
            has count 0 instead.

    Source: Horn, Closed-form solution of absolute orientation using unit quaternions, 1987.
    """
    return _solve(
        _core.three_points,
        (points, places_mm),
        _PAIRS,
        _rows_of_places,
        0.0 if scale is None else _known(scale),
        threads,
        scale_known=scale is not None,
    )


def two_conics(
    points_px: ArrayLike, planes: ArrayLike, *, steps: int = 0, scale: float | None = None, threads: int = 1
) -> Solutions:
    """Similarities that bring seven points of an image into seven planes: whatever a 2D probe sees.

        n_i . A (u_i, v_i, 0, 1)^T + d_i = 0, i = 1..7        |c1|^2 - |c2|^2 = 0,  c1 . c2 = 0

    Lines of an image in planes are two rows each, points in planes one, points on lines two. Eliminates t, leaving
    four equations in the first two columns of s R: two conics in two unknowns, a quartic. The rows' order has no
    effect.

    Args:
        points_px: (..., N, 2), px, N >= 7. The first seven rows give the candidates.
        planes: (..., N, 4), mm: (n, d) with n . x + d = 0; weights of rows by |n| matter to `steps` alone.
        steps: Gauss-Newton steps on all N rows, from the real part of every complex pair too; best first.
        scale: mm per px where it is known (rigid); needs `steps`. `three_quadrics` solves six rows exactly then.
        threads: how many share a batch; the result is the same.

    Returns:
        Up to 4 solutions each.

    Raises:
        InputError: a shape or an option does not fit, or one problem given is not finite.
        DegenerateGeometryError: one problem given that leaves a motion free. In a batch such a row has
            count 0 instead.

    Source: the problem of paper section 6 for any planes; the conics are its eq. (20)-(21).
    """
    return _solve(
        _core.two_conics,
        (_with_zero(_array(points_px)), planes),
        _FLAT,
        _rows_as_given,
        steps,
        0.0 if scale is None else _known(scale, steps),
        threads,
    )


def three_quadrics(
    points: ArrayLike, planes: ArrayLike, *, steps: int = 0, scale: float | None = None, threads: int = 1
) -> Solutions:
    """Similarities that bring seven points into seven planes, whatever these come from; of a known scale, six.

        n_i . (A x_i) + d_i = 0, i = 1..7

    Eliminates t and the 1, leaving three equations in s R(q): three quadrics in the quaternion, a
    polynomial of degree 8, each root polished by Newton on the three equations. Where the scale is known, t
    alone is eliminated from six rows, and three equations in R(q) and the 1 are left. The rows' order has no
    effect, two points may share a line.

    Args:
        points: (..., N, 3), px, N >= 7, or 6 where the scale is known. The first rows give the candidates.
        planes: (..., N, 4), mm: (n, d) with n . x + d = 0; weights of rows by |n| matter to `steps` alone.
        steps: Gauss-Newton steps on all N rows, from near misses of the polynomial too; best first.
        scale: mm per px where it is known (rigid).
        threads: how many share a batch; the result is the same.

    Returns:
        Up to 8 solutions each.

    Raises:
        InputError: a shape or an option does not fit, or one problem given is not finite.
        DegenerateGeometryError: one problem given that leaves a motion free. In a batch such a row has
            count 0 instead.

    Source: Kukelova, Heller, Fitzgibbon 2016; the problem of paper section 5.3.
    """
    return _solve(
        _core.three_quadrics,
        (points, planes),
        _ROWS,
        _rows_as_given,
        steps,
        0.0 if scale is None else _known(scale),
        threads,
        scale_known=scale is not None,
    )


def paper_two_lines(points: ArrayLike, segments_mm: ArrayLike, *, threads: int = 1) -> Solutions:
    """The paper's 2line3D: four points on four lines in space, by the 8 x 8 action matrix.

    Two line-line correspondences are four points of which two share each needle; a 2D probe's four points
    are given in a plane z = k, k > 0 of the image's size (at k = 0 the paper's matrix C is singular), and
    the translation found is that of the shifted image. Reference, not recommendation: `two_lines` and
    `four_points` are a hundred times faster and do not fail.

    Args:
        points: (..., 4, 3), px.
        segments_mm: (..., 4, 2, 3), mm.
        threads: how many share a batch.

    Returns:
        Up to 8 solutions each.

    Raises:
        InputError: as `four_points`.
        DegenerateGeometryError: as `four_points`.

    Source: paper section 5.3, eq. (12)-(17), and section 6 for z = k.
    """
    return _solve(
        _core.paper_two_lines,
        (points, segments_mm),
        _SPACE,
        _rows_of_space,
        threads,
    )


def paper_four_points(points_px: ArrayLike, segments_mm: ArrayLike, *, threads: int = 1) -> Solutions:
    """The paper's 4point2D: four points of a plane on four lines, by the 4 x 4 action matrix.

    Args:
        points_px: (..., 4, 2), px.
        segments_mm: (..., 4, 2, 3), mm.
        threads: how many share a batch.

    Returns:
        Up to 4 solutions each.

    Raises:
        InputError: as `four_points`.
        DegenerateGeometryError: as `four_points`.

    Source: paper section 6.2, eq. (22)-(26); compare `four_points`.
    """
    return _solve(
        _core.paper_four_points,
        (points_px, segments_mm),
        _PLANE,
        _rows_of_plane,
        threads,
    )


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
    return _linear(_with_zero(_array(points_px)), planes, planar=True, threads=threads)


# Below this ratio of singular values a linear problem has a second solution.
SMALLEST_CONDITION = 1e-6


def _linear(points: ArrayLike, planes: ArrayLike, *, planar: bool, threads: int) -> Solutions:
    x, p = _array(points), _array(planes)
    fewest = 9 if planar else 12
    if x.ndim < 2 or x.shape[-2] < fewest:
        raise InputError(f"the linear solver needs {fewest} rows or more; got points of shape {x.shape}")
    matrices, count, condition = _call(
        _core.linear, (x, p), ("points (..., N, 3)", "planes (..., N, 4)"), planar, threads
    )
    free = ~(condition > SMALLEST_CONDITION)
    if free.ndim == 0:
        if free:
            refuse_degenerate_rows(x, p, linear=True)
        return Solutions(matrices, count)
    return Solutions(np.where(free[..., None, None, None], np.nan, matrices), np.where(free, 0, count))


def _solve(
    core: Callable[..., Any],
    arrays: tuple[ArrayLike, ArrayLike],
    names: tuple[str, str],
    rows: Callable[[Array, Array], tuple[Array, Array]],
    *options: float,
    scale_known: bool = False,
) -> Solutions:
    # The fast path is one try: shapes are checked by the compiled side, sentences are made when it objects.
    try:
        matrices, count = core(arrays[0], arrays[1], *options)
    except (TypeError, ValueError):
        arrays = (_array(arrays[0]), _array(arrays[1]))
        matrices, count = _call(core, arrays, names, *options)
    if count.__class__ is int and count == 0:
        refuse_degenerate_rows(*rows(_array(arrays[0]), _array(arrays[1])), scale_known=scale_known)
    return Solutions(matrices, count)


def _call(
    core: Callable[..., Any], arrays: tuple[Array, Array], names: tuple[str, str], *options: float
) -> Any:
    try:
        return core(*arrays, *options)
    except ValueError as error:
        if not str(error).startswith("shapes "):  # the options', whose sentence says all
            raise InputError(str(error)) from None
        raise InputError(
            f"expected {names[0]} and {names[1]} with the same leading axes; "
            f"got {arrays[0].shape} and {arrays[1].shape}"
        ) from None


def _rows_of_plane(points: Array, segments: Array) -> tuple[Array, Array]:
    return _rows_of_space(_with_zero(points), segments)


def _rows_of_space(points: Array, segments: Array) -> tuple[Array, Array]:
    return np.repeat(points, 2, axis=0), planes_of_lines(segments).reshape(8, 4)


def _rows_of_lines(image: Array, needles: Array) -> tuple[Array, Array]:
    return _rows_of_space(image.reshape(4, 3), np.repeat(needles, 2, axis=0))


def _rows_of_places(points: Array, places: Array) -> tuple[Array, Array]:
    normals = np.tile(np.eye(3), (3, 1))
    planes = np.column_stack([normals, -np.sum(normals * np.repeat(places, 3, axis=0), axis=1)])
    return np.repeat(points, 3, axis=0), planes


def _rows_as_given(points: Array, planes: Array) -> tuple[Array, Array]:
    return points, planes


def _known(scale: float, steps: int = 1) -> float:
    if not (scale > 0 and np.isfinite(scale)):
        raise InputError(f"a known scale is positive and finite, in mm per px; got {scale}")
    if steps < 1:
        raise InputError("a known scale overdetermines the problem; give steps=2 or more to fit it")
    return float(scale)


def _array(values: ArrayLike) -> Array:
    return np.ascontiguousarray(values, dtype=np.float64)


def _with_zero(points_px: Array) -> Array:
    if points_px.shape[-1:] != (2,):
        raise InputError(f"points_px must have shape (..., N, 2); got {points_px.shape}")
    return np.concatenate([points_px, np.zeros((*points_px.shape[:-1], 1))], axis=-1)
