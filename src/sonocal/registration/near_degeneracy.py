"""Configurations of paper section 7 that sightings are near to, by name: why an answer is weak, or there is none."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import DegenerateGeometryError
from sonocal.geometry import Array, segment_directions
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = ["NearDegeneracy", "near_degeneracy", "nearly_degenerate", "refuse_nearly_degenerate"]

# Angle, and rms length relative to the scene, below which weakness is laid to a configuration.
NEAR_CONE_DEG = 30.0
NEAR = 0.15
# Of that, what is so near that it, and nothing else, is why no calibration is found: 0.3 mm in 150 mm of a needle's
# length turn it by a tenth of this, 1 mm about a port is two thirds of it.
NEAREST = 0.15
# Of a scene that is a point, as one bead at rest.
LEAST_SIZE_MM = 50.0


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


def near_degeneracy(rows: PointLineRows | TargetRows, chosen: NDArray[np.bool_]) -> NearDegeneracy | None:
    """The configuration that the sightings are nearest to, or None where they are far from all.

    Args:
        rows: points and lines, or whatever targets.
        chosen: (N,), those that count.

    Source: paper section 7.
    """
    found = _of_mix(rows.select(chosen)) if isinstance(rows, TargetRows) else _of_lines(rows, chosen)
    nearest = min(found, key=lambda near: near.nearness)
    return nearest if nearest.nearness < 1 else None


def _of_lines(rows: PointLineRows, chosen: NDArray[np.bool_]) -> list[NearDegeneracy]:
    extent = _core.extent(rows.core, chosen)
    size, _, thickness = extent.ends.tolist()
    cone = _cone_deg(segment_directions(rows.segments_mm[chosen]), extent.common)
    found = [_near_parallel(cone), _near_meeting(extent.meeting_distance if cone > 0 else size, size)]
    if rows.dimension == 2:
        found += [_near_plane(thickness, size)]
        if thickness >= NEAR * size:  # a plane's needles meet the image in a line
            found += [_near_image_line(*extent.points.tolist()[:2])]
    return found


def _of_mix(rows: TargetRows) -> list[NearDegeneracy]:
    """Of the planes that points are held by: three that meet in a point, two in a line, one."""
    held = rows.constraints.planes
    normals, offsets = held[:, :3], held[:, 3]
    least = float(np.sqrt(max(np.linalg.eigvalsh(normals.T @ normals / len(normals))[0], 0.0)))
    meeting = np.linalg.lstsq(normals, -offsets, rcond=1e-6)[0]
    distance = float(np.sqrt(np.mean((normals @ meeting + offsets) ** 2)))
    size = float(np.sqrt(np.mean(np.sum((rows.spanning_mm - meeting) ** 2, axis=2))))
    along, across = np.linalg.svd(rows.points - rows.points.mean(axis=0), compute_uv=False)[:2]
    root = float(np.sqrt(len(rows)))
    return [
        # Twice the root mean square is what 95 % are within.
        _near_parallel(float(np.degrees(np.arcsin(min(2.0 * least, 1.0)))), "targets"),
        _near_meeting(distance, max(size, LEAST_SIZE_MM), "targets"),
        _near_image_line(float(along) / root, float(across) / root),
    ]


def nearly_degenerate(rows: PointLineRows | TargetRows) -> NearDegeneracy | None:
    """The configuration that all rows are so near to that no fit of them can be sound; None where there is none."""
    near = near_degeneracy(rows, np.ones(len(rows), dtype=bool))
    return near if near is not None and near.nearness < NEAREST else None


def refuse_nearly_degenerate(rows: PointLineRows | TargetRows, found: str) -> None:
    """Raise if all rows are so near to a configuration of section 7 that no fit of them can be sound.

    Args:
        rows: points and lines, or whatever targets.
        found: why the fit is not, in words.

    Raises:
        DegenerateGeometryError: with the configuration's code.
    """
    near = nearly_degenerate(rows)
    if near is not None:
        raise DegenerateGeometryError(
            f"{near.cause}, and of such that did so exactly {near.free}; {found.partition(';')[0]}; {near.advice}",
            code=near.code,
        )


def _near_parallel(cone_deg: float, what: str = "needles") -> NearDegeneracy:
    return NearDegeneracy(
        cause=f"all {what} lie within {cone_deg:.2g} deg of one direction",
        advice="add sightings with the needle tilted by 30 deg or more, in two directions"
        if what == "needles"
        else "add sightings tilted by 30 deg or more, in two directions; where walls fade then, of cross-wires",
        code="parallel-lines",
        free="the image can slide along them",
        nearness=cone_deg / NEAR_CONE_DEG,
    )


def _near_meeting(distance_mm: float, size_mm: float, what: str = "needles") -> NearDegeneracy:
    return NearDegeneracy(
        cause=f"all {what} pass within {distance_mm:.2g} mm (rms) of one point",
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


def _cone_deg(directions: Array, common: Array) -> float:
    """Half the opening of the cone about the common direction that holds 95 % of the lines (N, 3), degrees."""
    return float(np.degrees(np.arccos(np.quantile(np.clip(np.abs(directions @ common), 0, 1), 0.05))))
