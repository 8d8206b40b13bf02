"""A map of the image that is no similarity, as the similarity that is nearest to it all over an area."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sonocal.geometry import Array, Similarity, homogeneous_points

__all__ = ["nearest_similarity"]

# Places along each side of the area at which the two are compared.
PLACES = 21


def nearest_similarity(map_of: Callable[[Array], Array], area_px: Array) -> tuple[Similarity, float]:
    """The similarity that differs least from a map over an area, and by how much it differs at most, mm.

    Args:
        map_of: places (N, 3), mm, of points (N, d), px.
        area_px: (2, d).

    Source: Umeyama 1991.
    """
    sides = [np.linspace(low, high, PLACES) for low, high in area_px.T]
    points = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, len(sides))
    mapped, from_px = map_of(points), homogeneous_points(points)
    middle_px, middle_mm = from_px.mean(axis=0), mapped.mean(axis=0)
    left, sizes, right = np.linalg.svd((mapped - middle_mm).T @ (from_px - middle_px))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = (left * signs) @ right
    scale = float(sizes @ signs / np.sum((from_px - middle_px) ** 2))
    nearest = Similarity(rotation, middle_mm - scale * rotation @ middle_px, scale)
    return nearest, float(np.linalg.norm(nearest.apply(from_px) - mapped, axis=1).max())
