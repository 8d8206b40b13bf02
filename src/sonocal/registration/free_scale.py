"""Rows that few agree of under a scale that was given, and far more once it is left free: the scale is wrong."""

from __future__ import annotations

import numpy as np

from sonocal.errors import DegenerateGeometryError, NoConsensusError
from sonocal.registration.best_fit import best_fit
from sonocal.registration.fit import Fit
from sonocal.registration.mirrored import far_more
from sonocal.registration.options import Options
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = ["freely_scaled"]

# Of all rows: a part that agrees by an error that it shares, such as a lag, may have any scale.
LEAST_SHARE = 1.0 / 3.0


def freely_scaled(rows: PointLineRows | TargetRows, options: Options, agreeing: int) -> Fit | None:
    """The fit with the scale free, where far more rows agree with it than with the known one.

    A scale may be so wrong that what agrees under it are other rows, by other errors: refined from there, a free scale
    ends near the wrong one. So it is a consensus of all rows.

    Args:
        rows: all of them.
        options: how they were fitted, with the scale known.
        agreeing: how many agreed.

    Returns:
        The fit; None where it refuses the rows, too, or hardly more agree.
    """
    try:
        fit = best_fit(rows, options.of_model("similarity"))[0]
    except (NoConsensusError, DegenerateGeometryError):
        return None
    freely = int(np.count_nonzero(fit.inlier))
    return fit if freely > LEAST_SHARE * len(rows) and far_more(freely, agreeing, len(rows)) else None
