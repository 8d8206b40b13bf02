"""Refinement alone: from a start to the best answer on chosen rows."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import AxisScaled
from sonocal.registration.fit import Fit, Model, Weighting, fit_of
from sonocal.registration.rows import PointLineRows, transform_arrays

__all__ = ["refine_point_lines"]


def refine_point_lines(
    start: AxisScaled,
    rows: PointLineRows,
    chosen: NDArray[np.bool_] | None = None,
    *,
    model: Model = "similarity",
    weighting: Weighting = "likelihood",
    sigma_px: float | None = None,
    sigma_mm: float | None = None,
) -> Fit:
    """The best transform near a start, on chosen rows; what is minimised is said at `fit_point_lines`.

    Levenberg-Marquardt over rotation and log scale, with the translation following in closed form (variable
    projection), on the normal equations in coordinates of order one: an iteration costs the same for ten rows
    as for a million.

    Args:
        start: mm from px.
        rows: points and lines.
        chosen: (N,), the rows to fit; default: all.
        model: one scale, or one along u and one along v.
        weighting: what to minimise.
        sigma_px: noise of a point along every axis, px, where known.
        sigma_mm: noise of a segment's end point along every axis, mm, where known.

    Returns:
        The fit; `Fit.converged` says whether it came to rest.

    Source: paper section 8; Golub and Pereyra 1973.
    """
    chosen = np.ones(len(rows), dtype=bool) if chosen is None else np.ascontiguousarray(chosen)
    found = _core.refine(
        rows.points,
        rows.segments_mm,
        rows.codes(),
        rows.sigma_px,
        rows.sigma_mm,
        chosen,
        *transform_arrays(start),
        dimension=rows.dimension,
        model=model,
        weighting=weighting,
        level_px=rows.level_px(sigma_px),
        level_mm=rows.level_mm(sigma_mm),
    )
    return fit_of(found, model, weighting, chosen)
