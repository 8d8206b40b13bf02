"""Lines that are bent: off by an error that grows along them, one way for all rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.image_distortion import repeats, side_by_side
from sonocal.registration.mapped import MappedRows
from sonocal.registration.uncertainty import point_jacobian
from sonocal.registration.whitened import whitened

__all__ = ["Bend", "bend_of"]

# Of a column, what the transform does not take up, relative: less is rounding.
LEAST_SEEN = 1e-3
# Times the residuals: places along the lines that spread by less are noise, and show nothing that grows along them.
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
    noise_mm = float(np.sqrt(np.mean(mapped.distances[rows] ** 2) / 2.0))
    if mapped.along_mm[rows].std() < LEAST_SPREAD * noise_mm:
        return None
    white = whitened(mapped, rows, _columns(mapped, rows, parameters, levels[0]), levels)
    by_chance = np.einsum("naj,na->j", white[..., parameters : parameters + 3], white[..., -2])
    white = white.reshape(2 * len(rows), -1)
    place = np.repeat(mapped.along_mm[rows] / mapped.lengths_mm[rows], 2)[:, None]
    known, columns, residuals = white[:, :parameters], place * white[:, parameters:-2], white[:, -1]
    freedom = len(residuals) - parameters - columns.shape[1]
    if freedom < 1:
        return None
    basis = np.linalg.qr(known / np.linalg.norm(known, axis=0))[0]
    beyond, left = (one - basis @ (basis.T @ one) for one in (columns, residuals))
    sizes = np.linalg.norm(columns, axis=0)
    if not np.all(sizes > 0) or np.linalg.svd(beyond / sizes, compute_uv=False)[-1] < LEAST_SEEN:
        return None
    # The points' own noise moves their places along the lines, too, and is the same noise as in the residuals.
    found = np.linalg.solve(beyond.T @ beyond, beyond.T @ left - by_chance * freedom / len(residuals))
    rest = left - beyond @ found
    alike = repeats(mapped, rows, rest.reshape(-1, 2), groups)
    variance = max(float(rest @ rest), np.finfo(float).tiny) / freedom * alike
    ratio = float(np.sum((beyond @ found) ** 2)) / len(found) / variance
    return Bend(
        sag_mm=np.asarray(found, dtype=float),
        p_value=float(fdtrc(len(found), max(freedom / alike, 1.0), ratio)),
        moved=-np.asarray(np.linalg.lstsq(known, residuals - columns @ found, rcond=None)[0], dtype=float),
    )


def _columns(mapped: MappedRows, rows: NDArray[np.int64], parameters: int, level_px: float) -> Array:
    """(M, 3, k + 5), mm: derivatives by the tangent and by an offset, what noise has in common, and the residuals.

    In common: the covariance of a point's place along its segment, 0 to 1, with its residual.
    """
    table, along = mapped.table, mapped.directions[rows]
    jacobian = point_jacobian(mapped.transform, table.points[rows], parameters)
    axes = (mapped.transform.rotation * mapped.transform.scales)[:, : table.dimension]
    px = level_px * (np.ones(len(rows)) if table.sigma_px is None else table.sigma_px[rows])
    together = (along @ axes) @ axes.T
    together -= np.einsum("ni,ni->n", together, along)[:, None] * along
    together *= (px**2 / mapped.lengths_mm[rows])[:, None]
    offset = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
    return np.concatenate(
        [jacobian, offset, together[:, :, None], mapped.residuals[rows][:, :, None]], axis=2
    )
