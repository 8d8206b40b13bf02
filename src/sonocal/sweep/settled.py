"""From a transform that is near to one that its own candidates hold; of two needles that move as one, the upper."""

from __future__ import annotations

import numpy as np

from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.geometry import Array, AxisScaled
from sonocal.sweep.candidates import Candidates, Mask
from sonocal.sweep.twin import Twin, find_twin

__all__ = ["settled_at", "upper_of_two"]

ROUNDS = 10
MOST_ECHOES = 4
"""So many reverberations, one above the other, until the needle is reached."""
LEAST_OF_LOWER = 0.3
"""Of the images in which the lower one is seen: an upper one that is seen in fewer was hardly there."""


def settled_at(
    table: Candidates, transform: AxisScaled, fitted: Mask | None = None
) -> tuple[AxisScaled, Mask]:
    """Choose the nearest candidates and fit them, with an ever fitter threshold, until nothing changes.

    Args:
        table: the candidates.
        transform: where to start.
        fitted: the rows that this is the fit of, if of such: they are not fitted again.

    Returns:
        The fit of the chosen rows, and these.
    """
    chosen = table.nearest(transform)
    for _ in range(ROUNDS):
        closer = table.nearest(transform, table.fitting_threshold_mm(transform, chosen))
        if fitted is None or not np.array_equal(closer, fitted):
            transform, fitted = table.transform(closer), closer
        if np.array_equal(closer, chosen):
            break
        chosen = closer
    return transform, chosen


def upper_of_two(
    table: Candidates, transform: AxisScaled, chosen: Mask, across: Array | None
) -> tuple[Mask, Twin | None]:
    """Of two needles that move as one the upper one, which is nearer to the transducer; and where the other is."""
    if not table.has_twins:
        return chosen, None
    twin = find_twin(table, chosen, transform, across)
    for _ in range(MOST_ECHOES):
        if twin is None or not twin.is_above:
            break
        moved = transform.rotation @ twin.offset_mm
        above = AxisScaled(transform.rotation, transform.translation - moved, transform.scales)
        try:
            transform, upper = settled_at(table, above)
        except (NoConsensusError, DegenerateGeometryError, InputError):
            break
        if table.agreeing(upper) < LEAST_OF_LOWER * table.agreeing(chosen):
            break
        chosen, twin = upper, find_twin(table, upper, transform, across)
    return chosen, twin
