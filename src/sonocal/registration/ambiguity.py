"""A second answer that fits as well: what nearly parallel lines leave to a 2D image."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array, AxisScaled, Similarity, segment_directions
from sonocal.registration.fit import Fit, Model
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.rows import PointLineRows

__all__ = ["mirrored_answer"]

# Lines further apart than this tell an image from its mirror in any noise worth calibrating with.
WIDEST_CONE_DEG = 40.0


def mirrored_answer(rows: PointLineRows, fit: Fit) -> Fit | None:
    """The fit of the image mirrored in the plane across the lines' common direction, refined; None if it is no other.

    Parallel lines only see the image's projection along them, which an image tilted forwards and one tilted
    backwards share: c1 and c2 lose nothing by a change of sign of their parts along the lines. Lines that are
    nearly parallel decide between the two by little, and noise can decide otherwise.

    Args:
        rows: points of a 2D image and their lines.
        fit: the answer, whose agreeing rows are fitted again.

    Returns:
        The other answer, or None where the lines differ in direction, the image is that of a 3D probe, or
        refinement leads back to the answer.
    """
    if rows.dimension == 3:
        return None
    directions = segment_directions(rows.segments_mm[fit.inlier])
    values, vectors = np.linalg.eigh(directions.T @ directions / len(directions))
    if np.degrees(np.sqrt(max(values[0] + values[1], 0.0))) > WIDEST_CONE_DEG:
        return None
    mirror = np.eye(3) - 2.0 * np.outer(vectors[:, 2], vectors[:, 2])
    first, second = (mirror @ fit.transform.rotation[:, :2]).T
    rotation = np.column_stack([first, second, np.cross(first, second)])
    centre = rows.points[fit.inlier].mean(axis=0)
    start = _similar(rotation, fit.transform, fit.model)
    moved = fit.transform.apply(centre) - start.apply(centre) + start.translation
    start = type(start)(start.rotation, moved, start.scale if isinstance(start, Similarity) else start.scales)
    other = refine_point_lines(
        start,
        rows,
        fit.inlier,
        model=fit.model,
        weighting=fit.weighting,
        sigma_px=fit.sigma_px,
        sigma_mm=fit.sigma_mm,
    )
    apart = np.linalg.norm(other.transform.apply(rows.points) - fit.transform.apply(rows.points), axis=1)
    turned = np.linalg.norm(other.transform.rotation - fit.transform.rotation)
    return other if turned > SAME_ROTATION and apart.max() > 0 else None


# Frobenius norm: refinement that comes this near has come back.
SAME_ROTATION = 1e-3


def _similar(rotation: Array, transform: AxisScaled, model: Model) -> AxisScaled:
    if model == "similarity":
        assert isinstance(transform, Similarity)
        return Similarity(rotation, transform.translation, transform.scale)
    return AxisScaled(rotation, transform.translation, transform.scales)
