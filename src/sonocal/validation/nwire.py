"""The N-wire error as PLUS computes it, so that the two compare."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.held_out import independent_units
from sonocal.errors import InputError
from sonocal.geometry import Array, AxisScaled, homogeneous_points
from sonocal.observations import Observations, group_codes
from sonocal.validation.quantity import Quantity, trimmed_mean_quantity

__all__ = ["nwire_error", "nwire_errors"]

# PLUS leaves out the largest twentieth (ErrorConfidenceLevel of its probe calibration).
SHARE = 0.95


def nwire_error(
    probe_from_image: AxisScaled,
    observations: Observations,
    nwires: Sequence[tuple[str, str, str]],
    share: float = SHARE,
) -> Quantity:
    """Mean of the smallest 95 % of the distances to the middle wires' points, as PLUS reports it.

    Args:
        probe_from_image: mm from px.
        observations: rows whose targets are the wires.
        nwires: the targets (left, middle, right) of each N.
        share: of the errors that count, the smallest.

    Raises:
        InputError: no frame shows all three wires of an N.
    """
    errors, rows = nwire_errors(probe_from_image, observations, nwires)
    return trimmed_mean_quantity(
        "plus-nwire",
        "N-wire error as PLUS computes it",
        f"distance of the mapped middle point to where the side wires place it, mean of the smallest {100 * share:g} %",
        errors,
        independent_units(probe_from_image, observations)[rows],
        share=share,
    )


def nwire_errors(
    probe_from_image: AxisScaled, observations: Observations, nwires: Sequence[tuple[str, str, str]]
) -> tuple[Array, NDArray[np.int64]]:
    """The distance at each N in each frame, and its frame.

        e = |A p_m - (I_l + a (I_r - I_l))|,        a = |p_m - p_l| / |p_r - p_l|

    with I_l and I_r the points where the middle wire meets the left and the right one.

    Returns:
        Errors (M,) in mm, N after N, and the row (M,) of each middle point.
    """
    frame = group_codes(observations.split, observations.frame)
    errors, rows = [], []
    for names in nwires:
        left, middle, right = _rows_of(observations, frame, names)
        p_left, p_middle, p_right = (observations.points_px[rows] for rows in (left, middle, right))
        share = np.linalg.norm(p_middle - p_left, axis=1) / np.linalg.norm(p_right - p_left, axis=1)
        wires = observations.segments_mm
        meets_left, meets_right = (_meeting(wires[middle], wires[side]) for side in (left, right))
        expected = meets_left + share[:, None] * (meets_right - meets_left)
        errors.append(np.linalg.norm(probe_from_image.apply(homogeneous_points(p_middle)) - expected, axis=1))
        rows.append(middle)
    if not errors or not sum(map(len, errors)):
        raise InputError(
            f"{observations.source}: no frame shows all three wires of an N; give --nwire LEFT,MIDDLE,RIGHT with "
            f"names of the column target, which has {', '.join(np.unique(observations.target))}"
        )
    return np.concatenate(errors), np.concatenate(rows)


def _rows_of(
    observations: Observations, frame: NDArray[np.int64], names: tuple[str, str, str]
) -> list[NDArray[np.int64]]:
    """Rows of the three wires in the frames that show them all, in the order of the frames."""
    of_wire = [np.flatnonzero(observations.target == name) for name in names]
    common = set.intersection(*(set(frame[rows].tolist()) for rows in of_wire))
    kept = [rows[np.isin(frame[rows], list(common))] for rows in of_wire]
    first = [rows[np.unique(frame[rows], return_index=True)[1]] for rows in kept]
    return [np.asarray(rows, dtype=np.int64) for rows in first]


def _meeting(lines: Array, others: Array) -> Array:
    """Points (N, 3) halfway between the nearest points of two lines (N, 2, 3) each."""
    p, d = lines[:, 0], lines[:, 1] - lines[:, 0]
    q, e = others[:, 0], others[:, 1] - others[:, 0]
    dd, de, ee = (np.sum(a * b, axis=1) for a, b in ((d, d), (d, e), (e, e)))
    dq, eq = np.sum(d * (q - p), axis=1), np.sum(e * (q - p), axis=1)
    denominator = dd * ee - de**2
    along = (dq * ee - eq * de) / denominator
    across = (dq * de - eq * dd) / denominator
    return np.asarray((p + along[:, None] * d + q + across[:, None] * e) / 2.0)
