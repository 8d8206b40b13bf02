"""Configurations that leave a motion free, recognised before a solver is asked (paper section 7)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import DegenerateGeometryError, NoConsensusError
from sonocal.geometry import Array, segment_directions
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = [
    "NearDegeneracy",
    "direction_spread",
    "near_degeneracy",
    "nearly_degenerate",
    "refuse_apparent",
    "refuse_degenerate_lines",
    "refuse_free_motion",
    "refuse_nearly_degenerate",
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
# Of that, what is so near that it, and nothing else, is why no calibration is found: 0.3 mm in 150 mm of a needle's
# length turn it by a tenth of this, 1 mm about a port is two thirds of it.
NEAREST = 0.15
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


@dataclass(frozen=True)
class NearDegeneracy:
    """Which of section 7's configurations the sightings are near to.

    Attributes:
        cause: in words, with the distance from it.
        advice: what to scan next.
        code: of the refusal of the configuration itself.
        free: what the configuration leaves free, in words.
        nearness: distance from it, 1 where it is too far off to be blamed.
    """

    cause: str
    advice: str
    code: str
    free: str
    nearness: float


def near_degeneracy(rows: PointLineRows, chosen: NDArray[np.bool_]) -> NearDegeneracy | None:
    """The configuration that the sightings are nearest to, or None where they are far from all.

    Args:
        rows: points and lines.
        chosen: (N,), those that count.

    Source: paper section 7.
    """
    extent = _core.extent(rows.core, chosen)
    size, _, thickness = extent.ends.tolist()
    cone = _cone_deg(segment_directions(rows.segments_mm[chosen]), extent.common)
    found = [_near_parallel(cone), _near_meeting(extent.meeting_distance if cone > 0 else size, size)]
    if rows.dimension == 2:
        found += [_near_plane(thickness, size)]
        if thickness >= NEAR * size:  # a plane's needles meet the image in a line
            found += [_near_image_line(*extent.points.tolist()[:2])]
    nearest = min(found, key=lambda near: near.nearness)
    return nearest if nearest.nearness < 1 else None


def nearly_degenerate(rows: PointLineRows) -> NearDegeneracy | None:
    """The configuration that all rows are so near to that no fit of them can be sound; None where there is none."""
    near = near_degeneracy(rows, np.ones(len(rows), dtype=bool))
    return near if near is not None and near.nearness < NEAREST else None


def refuse_nearly_degenerate(rows: PointLineRows, found: str) -> None:
    """Raise if all rows are so near to a configuration of section 7 that no fit of them can be sound.

    Args:
        rows: points and lines.
        found: why the fit is not, in words.

    Raises:
        DegenerateGeometryError: with the configuration's code.
    """
    near = nearly_degenerate(rows)
    if near is not None:
        raise DegenerateGeometryError(
            f"{near.cause}, and of lines that did so exactly {near.free}; {found.partition(';')[0]}; {near.advice}",
            code=near.code,
        )


def _near_parallel(cone_deg: float) -> NearDegeneracy:
    return NearDegeneracy(
        cause=f"all needles lie within {cone_deg:.2g} deg of one direction",
        advice="add sightings with the needle tilted by 30 deg or more, in two directions",
        code="parallel-lines",
        free="the image can slide along them",
        nearness=cone_deg / NEAR_CONE_DEG,
    )


def _near_meeting(distance_mm: float, size_mm: float) -> NearDegeneracy:
    return NearDegeneracy(
        cause=f"all needles pass within {distance_mm:.2g} mm (rms) of one point",
        advice="add sightings with the needle moved sideways as well as turned",
        code="lines-through-one-point",
        free="the scale is free",
        nearness=distance_mm / (NEAR * size_mm),
    )


def _near_plane(thickness_mm: float, size_mm: float) -> NearDegeneracy:
    return NearDegeneracy(
        cause=f"all needles lie within {thickness_mm:.2g} mm (rms) of one plane",
        advice="add sightings with the needle tilted and moved out of that plane",
        code="coplanar-lines",
        free="the image can turn about the line in which it meets that plane",
        nearness=thickness_mm / (NEAR * size_mm),
    )


def _near_image_line(along_px: float, across_px: float) -> NearDegeneracy:
    return NearDegeneracy(
        cause=f"all image points lie within {across_px:.2g} px (rms) of one line",
        advice="add sightings all over the image, with tilts in two directions",
        code="collinear-image-points",
        free="the image can turn about that line",
        nearness=across_px / (NEAR * along_px) if along_px > 0 else 0.0,
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
    near = near_degeneracy(rows, chosen) if isinstance(rows, PointLineRows) else None
    if near is None:
        raise DegenerateGeometryError(
            f"what the {_count(rows, chosen)} rows that agree say of one motion of the image is no more than noise "
            "alone would give; scan the needle tilted by 30 degrees or more, and at places all over the image",
            code="free-motion",
        )
    raise DegenerateGeometryError(
        f"{near.cause}, no further than noise alone may bring them, and of lines that did so exactly {near.free}: any "
        f"error of the calibration would be stated too small; {near.advice}",
        code=near.code,
    )


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
