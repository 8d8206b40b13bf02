"""Whether chance leads a calibration and a place, or a place alone, through what so many images show."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array
from sonocal.sweep.agreeing import CLUTTER_FRAMES

__all__ = ["away_mm", "enough_images", "may_be_chance"]

LEAST_SHARE, LEAST_ROWS = 0.15, 20
"""Of the images, that must agree on a calibration and a place at once: in fewer chance may."""


def enough_images(images: int) -> float:
    """How many of so many must agree."""
    return max(LEAST_SHARE * images, min(LEAST_ROWS, 0.8 * images))


def may_be_chance(agreeing: int, images: int, by_chance: float, free: int) -> bool:
    """Whether as many would agree with some answer had images and poses nothing in common.

    Neighbouring images that show the same clutter count once.

    Args:
        agreeing: images that agree.
        images: that were looked at.
        by_chance: images that agree when points of an image are taken for those of others.
        free: an answer can be led through what any so many images show.

    Source: a-contrario model estimation (Moisan and Stival 2004).
    """
    from scipy.special import bdtrc, gammaln

    if agreeing < max(enough_images(images), free + 1):
        return True
    combinations = gammaln(images + 1) - gammaln(images - free + 1) - gammaln(free + 1)
    chance = min(by_chance / images, 1.0)
    tail = max(bdtrc(agreeing - free - 1, images - free, chance), np.finfo(float).tiny)
    return bool(combinations + np.log(tail) / CLUTTER_FRAMES > 0)


def away_mm(points: Array, spanning_mm: Array) -> Array:
    """(...,): how far points (..., 3) are from what (..., K, 3) spans: a point, a line or a plane without ends."""
    off = points - spanning_mm[..., 0, :]
    spans = spanning_mm.shape[-2]
    if spans == 1:
        return np.asarray(np.linalg.norm(off, axis=-1))
    sides = spanning_mm[..., 1:, :] - spanning_mm[..., :1, :]
    if spans == 2:
        along = sides[..., 0, :] / np.linalg.norm(sides[..., 0, :], axis=-1, keepdims=True)
        return np.asarray(np.linalg.norm(np.cross(off, along), axis=-1))
    normal = np.cross(sides[..., 0, :], sides[..., 1, :])
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    return np.asarray(np.abs(np.sum(off * normal, axis=-1)))
