"""Configurations that leave a motion free, recognised before a solver is asked (paper section 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import DegenerateGeometryError, NoConsensusError
from sonocal.geometry import Array, segment_directions
from sonocal.registration.rows import PointLineRows

__all__ = [
    "NearDegeneracy",
    "direction_spread",
    "near_degeneracy",
    "refuse_degenerate_lines",
    "refuse_free_motion",
]

# Angles (rad) and lengths (relative to the scene) below which lines count as exactly parallel, meeting or
# coplanar: at 100 mm they amount to 0.01 mm, which no tracker sees. Less exact cases are for the covariance.
EXACT_ANGLE = 1e-4
EXACT_LENGTH = 1e-5
# Least eigenvalue of J'J a row, in coordinates of order one, below which a motion is free.
FREE_INFORMATION = 1e-12
# Angle, and rms length relative to the scene, below which weakness is laid to a configuration.
NEAR_CONE_DEG = 30.0
NEAR = 0.15
# Below this the configuration may be one of those above: their information is the square of their angle or length.
SUSPICIOUS_INFORMATION = 1e-5


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


def _count(rows: PointLineRows, chosen: NDArray[np.bool_] | None) -> int:
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


@dataclass(frozen=True)
class NearDegeneracy:
    """Which of section 7's configurations the sightings are near to.

    Attributes:
        cause: in words, with the distance from it.
        advice: what to scan next.
    """

    cause: str
    advice: str


def near_degeneracy(rows: PointLineRows, chosen: NDArray[np.bool_]) -> NearDegeneracy | None:
    """The configuration that the sightings are nearest to, or None where they are far from all.

    Args:
        rows: points and lines.
        chosen: (N,), those that count.

    Source: paper section 7.
    """
    extent = _core.extent(rows.core, chosen)
    cone = _cone_deg(segment_directions(rows.segments_mm[chosen]), extent.common)
    size, _, thickness = extent.ends.tolist()
    along, across, _ = extent.points.tolist()
    meeting = extent.meeting_distance if cone > 0 else size
    found = [
        (
            cone / NEAR_CONE_DEG,
            f"all needles lie within {cone:.0f} deg of one direction",
            "add sightings with the needle tilted by 30 deg or more, in two directions",
        ),
        (
            meeting / (NEAR * size),
            f"all needles pass within {meeting:.2g} mm (rms) of one point",
            "add sightings with the needle moved sideways as well as turned",
        ),
    ]
    if rows.dimension == 2:
        flat = thickness < NEAR * size
        found += [
            (
                thickness / (NEAR * size),
                f"all needles lie within {thickness:.2g} mm (rms) of one plane",
                "add sightings with the needle tilted and moved out of that plane",
            ),
            (
                np.inf if flat else across / (NEAR * along),  # a plane's needles meet the image in a line
                f"all image points lie within {across:.2g} px (rms) of one line",
                "add sightings all over the image, with tilts in two directions",
            ),
        ]
    nearness, cause, advice = min(found)
    return NearDegeneracy(cause, advice) if nearness < 1 else None


def _cone_deg(directions: Array, common: Array) -> float:
    """Half the opening of the cone about the common direction that holds 95 % of the lines (N, 3), degrees."""
    return float(np.degrees(np.arccos(np.quantile(np.clip(np.abs(directions @ common), 0, 1), 0.05))))


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
