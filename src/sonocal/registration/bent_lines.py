"""Lines that are bent: off by an error that grows along them, one way for all rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.image_distortion import repeats, side_by_side, taken_up
from sonocal.registration.mapped import MappedRows
from sonocal.registration.noise_in_columns import ABOVE_NOISE, noise_beyond
from sonocal.registration.uncertainty import point_jacobian
from sonocal.registration.whitened import whitened

__all__ = ["Bend", "bend_of", "columns_at"]

# Of the columns, what the transform does not take up, relative: less is rounding.
LEAST_SEEN = 1e-3
# Times the residuals: places along the lines that spread by less show nothing that grows along them.
LEAST_SPREAD = 4.0


@dataclass(frozen=True, eq=False)
class Bend:
    """How the lines of all rows are bent, fitted beside the transform.

    Attributes:
        sag_mm: (3,), from one end of the segment to the other, in the lines' frame.
        p_value: of straight lines.
        moved: (k,), the tangent from the fit without it to the fit with it.
    """

    sag_mm: Array
    p_value: float
    moved: Array


def bend_of(
    mapped: MappedRows,
    chosen: NDArray[np.bool_],
    *,
    levels: tuple[float, float],
    parameters: int,
    groups: list[NDArray[np.int64]],
) -> Bend | None:
    """The bend that goes best with a small motion d of the transform.

        r_i = P_i (J_i d + t_i b) + e_i        t_i: the place along the segment, 0 to 1

    An error that all rows share is a shift, and taken up. Of how it changes along the lines the slope shows most: a
    bow of the few centimetres that are seen is small, and a test that looks for its square, too, sees less.

    Args:
        mapped: rows under the transform.
        chosen: (N,): those to look at.
        levels: noise of a point, px, and of a segment's end, mm; both 0 where rows weigh alike.
        parameters: k, of the transform's tangent.
        groups: (N,) each: of rows that may share an error.

    Returns:
        None where no row is to spare, or the places along the segments are too alike.
    """
    from scipy.special import fdtrc

    rows = side_by_side(mapped, chosen)
    at = partial(columns_at, mapped, rows, parameters)
    own = mapped.residuals[rows][:, :, None]
    together = np.concatenate([at(mapped.table.points[rows]), own], axis=2)
    white = whitened(mapped, rows, together, levels).reshape(2 * len(rows), -1)
    known, columns, residuals = white[:, :parameters], white[:, parameters:-1], white[:, -1]
    freedom = len(residuals) - parameters - columns.shape[1]
    if freedom < 1:
        return None
    basis, taken = taken_up(known, columns)
    beyond, left = columns - known @ taken, residuals - basis @ (basis.T @ residuals)
    own, common = noise_beyond(mapped, rows, at, taken, levels)
    sizes, ways = np.linalg.svd(beyond, full_matrices=False)[1:]
    # Of the bends those alone that show in places along the lines well beyond noise, the points' and what is left.
    least = np.maximum(
        ABOVE_NOISE**2 * np.einsum("wi,ij,wj->w", ways, own, ways), LEAST_SEEN**2 * np.sum(columns**2)
    )
    left_over = float(left @ left) / float(np.median(mapped.lengths_mm[rows])) ** 2
    least = np.maximum(least, LEAST_SPREAD**2 * left_over)
    ways, sizes = ways[sizes**2 > least], sizes[sizes**2 > least]
    if not len(ways):
        return None
    pull = beyond.T @ left - common
    found = ways.T @ (ways @ pull / sizes**2)
    rest = left - beyond @ found
    alike = repeats(mapped, rows, rest.reshape(-1, 2), groups)
    variance = max(float(rest @ rest), np.finfo(float).tiny) / freedom * alike
    ratio = float(np.sum((beyond @ found) ** 2)) / len(ways) / variance
    return Bend(
        sag_mm=np.asarray(found, dtype=float),
        p_value=float(fdtrc(len(ways), max(freedom / alike, 1.0), ratio)),
        moved=-np.asarray(np.linalg.lstsq(known, residuals - columns @ found, rcond=None)[0], dtype=float),
    )


def columns_at(mapped: MappedRows, rows: NDArray[np.int64], parameters: int, points: Array) -> Array:
    """(M, 3, k + 3), mm: derivatives by the tangent and by the bend, of rows that are seen at points (M, 3), px."""
    axes = mapped.transform.rotation * mapped.transform.scales
    moved = (points - mapped.table.points[rows]) @ axes.T
    along = mapped.along_mm[rows] + np.einsum("ni,ni->n", moved, mapped.directions[rows])
    place = along / mapped.lengths_mm[rows]
    jacobian = point_jacobian(mapped.transform, points, parameters)
    return np.concatenate([jacobian, place[:, None, None] * np.eye(3)], axis=2)
