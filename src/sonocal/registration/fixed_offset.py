"""An offset of all lines that is constant in a third frame, to which the lines' frame turns from row to row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.mapped import MappedRows
from sonocal.registration.uncertainty import point_jacobian

__all__ = ["FixedOffset", "fixed_offset"]

# Stretches of frames that are left out in turn: enough for a covariance of three numbers, few enough to be long.
STRETCHES, FEWEST_FRAMES = 20, 60
# Of the directions that the offset's frame was turned through, relative to the greatest: less is not seen.
LEAST_SEEN = 1e-6


@dataclass(frozen=True, eq=False)
class FixedOffset:
    """What the residuals say of it.

    Attributes:
        offset_mm: (3,), in the third frame.
        deviation_mm: of its length, by leaving out stretches of frames in turn.
        p_value: of no offset.
        moved: (k,), the tangent from the fit without it to the fit with it.
    """

    offset_mm: Array
    deviation_mm: float
    p_value: float
    moved: Array


def fixed_offset(
    mapped: MappedRows, chosen: NDArray[np.bool_], rotations: Array, parameters: int
) -> FixedOffset | None:
    """The offset b that goes best with a small motion d of the transform.

        r_i = P_i (J_i d + R_i b)        P_i across the line

    Residuals of neighbouring frames go together: the offset's covariance is that of leaving out stretches of
    frames in turn (Busing, Meijer and van der Leeden 1999), not that of independent rows.

    Args:
        mapped: rows under the transform.
        chosen: (N,): those to look at.
        rotations: (N, 3, 3), from the third frame to the lines' own.
        parameters: k, of the transform's tangent.

    Returns:
        The offset, or None where rows are too few, or the frame hardly turned, so that the transform takes it up.
    """
    frame = mapped.table.frame
    assert frame is not None
    order = np.unique(frame[chosen], return_inverse=True)[1].reshape(-1)
    if order.max(initial=0) + 1 < FEWEST_FRAMES:
        return None
    stretch = order * STRETCHES // (order.max() + 1)
    columns = _columns(mapped, chosen, rotations, parameters)
    # residual = line to point: an offset of the line takes away from it.
    residuals = -mapped.residuals[chosen]
    information = np.stack([_squares(columns[stretch == s]) for s in range(STRETCHES)])
    pulls = np.stack(
        [np.einsum("nij,ni->j", columns[stretch == s], residuals[stretch == s]) for s in range(STRETCHES)]
    )
    whole, pull = information.sum(axis=0), pulls.sum(axis=0)
    size = np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
    if np.linalg.eigvalsh(whole / size[:, None] / size)[0] < LEAST_SEEN:
        return None
    found = np.linalg.solve(whole, pull)
    without = np.linalg.solve(whole[:parameters, :parameters], pull[:parameters])
    left_out = np.linalg.solve(whole - information, (pull - pulls)[..., None])[:, parameters:, 0]
    away = left_out - left_out.mean(axis=0)
    covariance = (STRETCHES - 1) / STRETCHES * away.T @ away
    offset = found[parameters:]
    return FixedOffset(
        offset_mm=offset,
        deviation_mm=float(np.sqrt(np.trace(covariance))),
        p_value=_p_value(offset, covariance),
        moved=without - found[:parameters],  # what is found is how far the transform is off
    )


def _columns(mapped: MappedRows, chosen: NDArray[np.bool_], rotations: Array, parameters: int) -> Array:
    """(M, 3, k + 3): derivatives of the residuals, across the lines, by the transform and by the offset.

    The point moves with the transform, and away from a line that is offset: signs are those of the offset.
    """
    jacobian = -point_jacobian(mapped.transform, mapped.table.points[chosen], parameters)
    both = np.concatenate([jacobian, rotations[chosen]], axis=2)
    along = mapped.directions[chosen]
    return np.asarray(both - along[:, :, None] * np.einsum("ni,nij->nj", along, both)[:, None, :])


def _squares(columns: Array) -> Array:
    return np.asarray(np.einsum("nij,nik->jk", columns, columns))


def _p_value(offset: Array, covariance: Array) -> float:
    """Hotelling's test of an offset whose covariance rests on so many stretches."""
    from scipy.special import fdtrc

    squared = float(offset @ np.linalg.solve(covariance, offset))
    freedom = STRETCHES - len(offset)
    return float(fdtrc(len(offset), freedom, squared * freedom / (len(offset) * (STRETCHES - 1))))
