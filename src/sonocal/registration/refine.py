"""Refinement alone: from a start to the best answer on chosen rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import AxisScaled
from sonocal.registration.fit import Fit, fit_of
from sonocal.registration.options import Options
from sonocal.registration.rows import PointLineRows, to_core

__all__ = ["refine_point_lines"]


def refine_point_lines(
    start: AxisScaled, rows: PointLineRows, chosen: NDArray[np.bool_] | None, options: Options
) -> Fit:
    """The best transform near a start, on chosen rows; what is minimised is said at `fit_point_lines`.

    Levenberg-Marquardt over rotation and log scale, with the translation following in closed form (variable
    projection), on the normal equations in coordinates of order one: an iteration costs the same for ten rows
    as for a million.

    Args:
        start: mm from px.
        rows: points and lines.
        chosen: (N,), the rows to fit; None: all.
        options: model, weighting and what is known of the noise; the rest is for who looks for a start.

    Returns:
        The fit; `Fit.converged` says whether it came to rest.

    Source: paper section 8; Golub and Pereyra 1973.
    """
    chosen = np.ones(len(rows), dtype=bool) if chosen is None else np.ascontiguousarray(chosen)
    found = _core.refine(rows.core, chosen, to_core(start), rows.core_options(options))
    return fit_of(found, options, chosen)
