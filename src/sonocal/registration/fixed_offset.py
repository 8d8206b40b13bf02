"""An offset of all lines that is constant in a third frame, to which the lines' frame turns from row to row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.registration.mapped import MappedRows
from sonocal.registration.noise import stretch_length
from sonocal.registration.uncertainty import point_jacobian

__all__ = ["FixedOffset", "fixed_offset"]

# Stretches of frames that are left out in turn: enough for a covariance of three numbers, few enough to be long.
STRETCHES, FEWEST_FRAMES = 20, 60
# Where what is left wanders they are longer, so that they are independent of each other; of fewer than so many the
# covariance would be a guess, and whatever wanders would pass for an offset.
FEWEST_STRETCHES = 8
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
    order = np.unique(frame[chosen], return_inverse=True)[1].reshape(-1).astype(np.int32)
    if order.max(initial=0) + 1 < FEWEST_FRAMES:
        return None
    columns = _columns(mapped, chosen, rotations, parameters)
    # residual = line to point: an offset of the line takes away from it.
    residuals = -mapped.residuals[chosen]
    whole, pull = _squares(columns), np.einsum("nij,ni->j", columns, residuals)
    size = np.sqrt(np.maximum(np.diag(whole), np.finfo(float).tiny))
    if np.linalg.eigvalsh(whole / size[:, None] / size)[0] < LEAST_SEEN:
        return None
    found = np.linalg.solve(whole, pull)
    without = np.linalg.solve(whole[:parameters, :parameters], pull[:parameters])
    stretches = _independent(residuals - columns @ found, order)
    if stretches < FEWEST_STRETCHES:
        return None
    try:
        covariance = _left_out(columns, residuals, order * stretches // (order.max() + 1), parameters)
    except np.linalg.LinAlgError:  # the frame turned in one stretch alone
        return None
    offset = found[parameters:]
    return FixedOffset(
        offset_mm=offset,
        deviation_mm=float(np.sqrt(np.trace(covariance))),
        p_value=_p_value(offset, covariance, stretches),
        moved=without - found[:parameters],  # what is found is how far the transform is off
    )


def _independent(left: Array, order: NDArray[np.int32]) -> int:
    """Into how many stretches to cut, so that each is twice as long as what is left (M, 3) repeats itself."""
    by_time = np.argsort(order, kind="stable")
    return int(min(STRETCHES, (order.max() + 1) // (2 * stretch_length(left[by_time], order[by_time]))))


def _left_out(columns: Array, residuals: Array, stretch: NDArray[np.int32], parameters: int) -> Array:
    """(3, 3): the offset's covariance, of leaving out every stretch in turn."""
    count = int(stretch.max()) + 1
    within = [stretch == s for s in range(count)]
    information = np.stack([_squares(columns[s]) for s in within])
    pulls = np.stack([np.einsum("nij,ni->j", columns[s], residuals[s]) for s in within])
    others = information.sum(axis=0) - information, pulls.sum(axis=0) - pulls
    offsets = np.linalg.solve(others[0], others[1][..., None])[:, parameters:, 0]
    away = offsets - offsets.mean(axis=0)
    return np.asarray((count - 1) / count * away.T @ away)


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


def _p_value(offset: Array, covariance: Array, stretches: int) -> float:
    """Hotelling's test of an offset whose covariance rests on so many stretches."""
    from scipy.special import fdtrc

    squared = float(offset @ np.linalg.solve(covariance, offset))
    freedom = stretches - len(offset)
    return float(fdtrc(len(offset), freedom, squared * freedom / (len(offset) * (stretches - 1))))
