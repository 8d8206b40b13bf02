"""A straight sheet through places of an echo, robustly; and as many points of it as span it, whose errors are apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = ["Sheet", "fit_sheet"]

ROUNDS = 12
TUKEY = 4.7
"""Standard deviations from which a place takes no part."""
LEAST_SIGMA_PX = 0.03
FLOOR_PX2 = 0.01
"""Of a point's variance: what the scatter of a wall's sections does not show, such as a bent surface."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A line of an image or a plane of a volume.

    Attributes:
        middle: (D,), px.
        normal: (D,): unit.
        spanning_px: (D, D): points that span it, well apart.
        covariance_px2: (D, D, D): of each, across the sheet; along it a point means nothing.
        used: (N,): which places took part.
        sigma_px: of a place about the sheet.
    """

    middle: Array
    normal: Array
    spanning_px: Array
    covariance_px2: Array
    used: NDArray[np.bool_]
    sigma_px: float


def fit_sheet(places: Array, normal: Array, correlated: float) -> Sheet:
    """A sheet by iteratively reweighted least squares (Tukey) of what places are off along a normal.

    Its points are those at which the errors of the fitted sheet are independent of one another: in units of the places'
    own spread along it two at +-1, three at 2^(1/2) in directions a third of a turn apart.

    Args:
        places: (N, D).
        normal: (D,): roughly, of the sheet.
        correlated: how many places share their error.
    """
    axes = np.vstack([np.linalg.svd(normal[None])[2][1:], normal])  # along the sheet, and across it
    local = (places - places.mean(axis=0)) @ axes.T
    along, across = local[:, :-1], local[:, -1]
    design = np.column_stack([np.ones(len(places)), along])
    weight = np.ones(len(places))
    for _ in range(ROUNDS):
        solved = _weighted(design, across, weight)
        off = across - design @ solved
        sigma = max(LEAST_SIGMA_PX, 1.4826 * float(np.median(np.abs(off))))
        weight = np.clip(1 - (off / (TUKEY * sigma)) ** 2, 0, None) ** 2
    used = weight > 0
    count = max(float(weight.sum()) / correlated, len(normal) + 1.0)
    points = _independent(along, weight)
    heights = np.column_stack([np.ones(len(points)), points]) @ solved
    spanning = places.mean(axis=0) + np.column_stack([points, heights]) @ axes
    tilted = np.append(-solved[1:], 1.0) @ axes
    tilted = tilted / np.linalg.norm(tilted)
    variance = len(normal) * sigma**2 / count + FLOOR_PX2
    covariance = np.broadcast_to(variance * np.outer(tilted, tilted), (len(points), len(normal), len(normal)))
    return Sheet(spanning.mean(axis=0), tilted, spanning, covariance, used, sigma)


def _weighted(design: Array, across: Array, weight: Array) -> Array:
    root = np.sqrt(weight)
    return np.asarray(np.linalg.lstsq(root[:, None] * design, root * across, rcond=None)[0])


def _independent(along: Array, weight: Array) -> Array:
    """(D, D - 1): places along the sheet where a weighted fit's errors are uncorrelated.

    cov(x, y) = (1 + x S^-1 y) sigma^2 / N = 0        S: the places' own covariance
    """
    middle = np.average(along, axis=0, weights=weight)
    off = along - middle
    spread, turn = np.linalg.eigh((weight * off.T) @ off / weight.sum())
    if along.shape[1] == 1:
        corners = np.array([[-1.0], [1.0]])
    else:
        angles = 2 * np.pi / 3 * np.arange(3)
        corners = np.sqrt(2.0) * np.column_stack([np.cos(angles), np.sin(angles)])
    return np.asarray(middle + (corners * np.sqrt(np.maximum(spread, 1e-9))) @ turn.T)
