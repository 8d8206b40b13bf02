"""Many rows that were left out, and agree among themselves: there are two calibrations, and one was given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sonocal.calibration.held_out import FAR
from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, area_places
from sonocal.registration.best_fit import best_fit
from sonocal.registration.fit import Fit
from sonocal.registration.options import Options
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = ["left_out_findings"]

# Of all rows: fewer left out are no match for those that agree. Fewer rows than that many fit anything.
LEAST_SHARE, FEWEST_ROWS = 1.0 / 3.0, 16
# Of those left out, that agree with one another: gross errors hardly do.
MOST = 0.7


def left_out_findings(
    table: PointLineRows | TargetRows, fit: Fit, options: Options, accepted: tuple[Array, float, str]
) -> Iterator[Diagnostic]:
    """Fits the rows that were left out, where they are many, and says how far off their answer is if they have one.

    Args:
        table: all rows.
        fit: of those that agree.
        options: how they were fitted.
        accepted: the area (2, d), the error that is accepted at its corners, mm, and what messages call the area.
    """
    left = ~fit.inlier
    count = int(np.count_nonzero(left))
    if count < max(FEWEST_ROWS, LEAST_SHARE * len(left)):
        return
    try:
        other = best_fit(table.select(left), replace(options, threshold_mm=fit.threshold_mm))[0]
    except (DegenerateGeometryError, NoConsensusError, InputError):
        return
    agreeing = int(np.count_nonzero(other.inlier))
    area, tolerance_mm, area_name = accepted
    corners = area_places(area)[:-1]
    apart = float(np.linalg.norm(other.transform @ corners - fit.transform @ corners, axis=-1).max())
    if agreeing < MOST * count or not other.plain or apart <= FAR * tolerance_mm:
        return
    yield Diagnostic(
        code="left-out-rows-agree",
        severity="warning",
        message=(
            f"{agreeing} of the {count} rows left out agree on another calibration, which lies up to {apart:.1f} mm "
            f"away at the corners of the {area_name}: which of the two is right cannot be told"
        ),
        advice=(
            "look for two definitions of a marker or a needle, or two settings of the scanner, in one scan, and "
            "calibrate each part alone"
        ),
    )
