"""As few points, lines and planes as determine a similarity: every one that solves them."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sonocal import _core
from sonocal.registration.solver_calls import (
    FLAT,
    LINES,
    PAIRS,
    PLANE,
    ROWS,
    Solutions,
    array,
    known_scale,
    rows_as_given,
    rows_of_lines,
    rows_of_places,
    rows_of_plane,
    solve,
    with_zero,
)

__all__ = ["four_points", "three_points", "three_quadrics", "two_conics", "two_lines"]


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
    return solve(
        _core.four_points,
        (points_px, segments_mm),
        PLANE,
        rows_of_plane,
        steps,
        0.0 if scale is None else known_scale(scale, steps),
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
    return solve(
        _core.two_lines,
        (image_segments, needle_segments),
        LINES,
        rows_of_lines,
        steps,
        0.0 if scale is None else known_scale(scale, steps),
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
    return solve(
        _core.three_points,
        (points, places_mm),
        PAIRS,
        rows_of_places,
        0.0 if scale is None else known_scale(scale),
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
    return solve(
        _core.two_conics,
        (with_zero(array(points_px)), planes),
        FLAT,
        rows_as_given,
        steps,
        0.0 if scale is None else known_scale(scale, steps),
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
    return solve(
        _core.three_quadrics,
        (points, planes),
        ROWS,
        rows_as_given,
        steps,
        0.0 if scale is None else known_scale(scale),
        threads,
        scale_known=scale is not None,
    )
