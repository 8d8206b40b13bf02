"""Sightings that cannot be: outside of the image that they are of."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.observations.image_size import size_in_words

__all__ = ["outside_findings"]

# Noise takes points that lie at an image's edge beyond it, and lines are drawn on to where they end.
LEAST_PX, SHARE = 20.0, 0.05


def outside_findings(points_px: Array, size_px: Sequence[int] | None) -> Iterator[Diagnostic]:
    """Points (N, d), px, beyond the edges of an image by more than noise takes them: its size is another one.

    Args:
        points_px: (N, d).
        size_px: (d,), of the image; None: nothing is known of it.
    """
    if size_px is None or not len(points_px):
        return
    last = np.asarray(size_px) - 1.0
    beyond = np.maximum(LEAST_PX, SHARE * np.asarray(size_px))
    outside = np.any((points_px < -beyond) | (points_px > last + beyond), axis=1)
    if not outside.any():
        return
    low, high = points_px[outside].min(axis=0), points_px[outside].max(axis=0)
    reach = " and ".join(
        f"{a:.0f} to {b:.0f} along {axis}" for a, b, axis in zip(low, high, "uvw", strict=False)
    )
    yield Diagnostic(
        code="outside-image",
        severity="warning",
        message=(
            f"{np.count_nonzero(outside)} of {len(points_px)} sightings lie outside of the image's "
            f"{size_in_words(size_px)} px, at {reach}"
        ),
        advice="give the size of the images that the points were found in; errors are predicted at its corners",
    )
