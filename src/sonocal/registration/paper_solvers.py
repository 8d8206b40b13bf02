"""The paper's own minimal solvers, by action matrices: for reference."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sonocal import _core
from sonocal.registration.solver_calls import PLANE, SPACE, Solutions, rows_of_plane, rows_of_space, solve

__all__ = ["paper_four_points", "paper_two_lines"]


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
    return solve(
        _core.paper_two_lines,
        (points, segments_mm),
        SPACE,
        rows_of_space,
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
    return solve(
        _core.paper_four_points,
        (points_px, segments_mm),
        PLANE,
        rows_of_plane,
        threads,
    )
