"""Configurations that leave a motion free, recognised before a solver is asked (paper section 7)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import DegenerateGeometryError, NoConsensusError
from sonocal.registration.near_degeneracy import near_degeneracy
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = [
    "direction_spread",
    "refuse_apparent",
    "refuse_degenerate_lines",
    "refuse_free_motion",
]

# Angles (rad) and lengths (relative to the scene) below which lines count as exactly parallel, meeting or
# coplanar: at 100 mm they amount to 0.01 mm, which no tracker sees. Less exact cases are for the covariance.
EXACT_ANGLE = 1e-4
EXACT_LENGTH = 1e-5
# Least eigenvalue of J'J a row, in coordinates of order one, below which a motion is free.
FREE_INFORMATION = 1e-12
# Below this the configuration may be one of those above: their information is the square of their angle or length.
SUSPICIOUS_INFORMATION = 1e-5
# Share of what rows seem to say of a motion that noise may have given, at which nothing is said any more: from 0.47 on
# errors of answers through a narrow port are stated too small (benchmarks/degenerate.py). Of scans with tilts of 15
# degrees and more it is a thousandth, and a fortieth at most.
MOST_APPARENT = 0.45
# So few rows tell nothing of the noise; what is said of them is that none is left to check the answer.
FEWEST_TOLD = 4


def refuse_degenerate_lines(rows: PointLineRows, chosen: NDArray[np.bool_] | None = None) -> None:
    """Raise if the sightings leave a motion free, whatever the calibration.

    Args:
        rows: points and lines.
        chosen: (N,), those that count; None: all.

    Raises:
        DegenerateGeometryError: parallel lines, lines through one point, and in 2D coplanar lines or
            image points on one line; the sentence says what is free and what to scan next.
        NoConsensusError: none counts.

    Source: paper section 7.
    """
    if _count(rows, chosen) == 0:
        raise NoConsensusError(
            f"none of {len(rows)} rows is near its line; check that points are matched to the right lines",
            best_count=0,
        )
    extent = _core.extent(rows.core, chosen)
    if extent.direction_spread < EXACT_ANGLE:
        raise DegenerateGeometryError(
            f"all {_count(rows, chosen)} lines are parallel, so the image can slide along them; "
            "tilt the needle between sightings, by 30 degrees or more",
            code="parallel-lines",
        )
    size, _, thickness = extent.ends.tolist()
    if extent.meeting_distance < EXACT_LENGTH * size:
        x, y, z = extent.meeting
        raise DegenerateGeometryError(
            f"all {_count(rows, chosen)} lines pass through one point, ({x:.3g}, {y:.3g}, {z:.3g}) mm in the probe "
            "marker's frame, so the scale is free; move the needle sideways as well as turning it",
            code="lines-through-one-point",
        )
    if rows.dimension == 2:
        _refuse_flat_image(extent.points.tolist(), _count(rows, chosen), thickness < EXACT_LENGTH * size)


def _count(rows: PointLineRows | TargetRows, chosen: NDArray[np.bool_] | None) -> int:
    return len(rows) if chosen is None else int(np.count_nonzero(chosen))


def direction_spread(rows: PointLineRows) -> float:
    """Root mean square angle (rad, small angles) of the lines to their common direction."""
    return _core.extent(rows.core).direction_spread


def refuse_free_motion(least_information: float) -> None:
    """Raise if the fit's information matrix is singular, for whatever reason.

    Raises:
        DegenerateGeometryError: a motion of the image changes no distance.
    """
    if not least_information > FREE_INFORMATION:
        raise DegenerateGeometryError(
            "the rows that agree leave a motion of the image free; "
            "scan the needle tilted by 30 degrees or more, and at places all over the image",
            code="free-motion",
        )


def refuse_apparent(rows: PointLineRows | TargetRows, chosen: NDArray[np.bool_], apparent: float) -> None:
    """Raise if noise alone may have given what the rows seem to say of a motion.

    Noise turns configurations that leave a motion free into ones that seem to hold it. What it gives is known from
    its levels; where that is much of what there is, within three standard deviations, the answer is the noise's.

    Args:
        rows: points and lines, or whatever targets.
        chosen: (N,), those that were fitted.
        apparent: `Noise.apparent` of the fit.

    Raises:
        DegenerateGeometryError: with the code of the configuration that the rows are nearest to.
    """
    if apparent < MOST_APPARENT or np.count_nonzero(chosen) <= FEWEST_TOLD:
        return
    near = near_degeneracy(rows, chosen)
    if near is None:
        raise DegenerateGeometryError(
            f"what the {_count(rows, chosen)} rows that agree say of one motion of the image is no more than noise "
            "alone would give; scan needles or targets that are tilted to one another by 30 degrees or more, and at "
            "places all over the image",
            code="free-motion",
        )
    raise DegenerateGeometryError(
        f"{near.cause}, no further than noise alone may bring them, and of such that did so exactly {near.free}: any "
        f"error of the calibration would be stated too small; {near.advice}",
        code=near.code,
    )


def _refuse_flat_image(extents: list[float], count: int, coplanar: bool) -> None:
    along, across, _ = extents
    if along == 0:
        raise DegenerateGeometryError(
            f"all {count} rows have the same image point, so the image can turn about it; "
            "scan the needle at places all over the image",
            code="one-image-point",
        )
    if not coplanar and across >= EXACT_LENGTH * along:
        return
    what = (
        "lines lie in one plane, so their image points lie on one line"
        if coplanar
        else ("image points lie on one line")
    )
    raise DegenerateGeometryError(
        f"all {count} {what} and the image can turn about it; "
        "scan the needle at places all over the image, with tilts in two directions",
        code="coplanar-lines" if coplanar else "collinear-image-points",
    )
