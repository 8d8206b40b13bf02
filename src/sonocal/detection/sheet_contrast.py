"""Whether a sheet is brighter than what is before and behind it, of all sections across it together.

In speckle every section has a brightest place, and where these happen to lie in a row they pass for an echo. Of all
sections at once, each looked at where the sheet is and not where it is brightest, nothing is left of that.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.detection.sheet_echo import STEP_PX, sampled
from sonocal.geometry import Array

__all__ = ["sheet_contrast"]

ON_PX, BEFORE_PX, BEHIND_PX = 1.0, 3.0, 2.0
"""What is the sheet's own, and from where on it is not."""
LEAST_GREY, LEAST_DEVIATIONS = 8.0, 5.0
"""Walls stand out by 45 grey levels and 13 deviations and more, what speckle makes by 15 and 4 at the most."""


def sheet_contrast(
    grey: NDArray[np.float32],
    mask: NDArray[np.bool_],
    stations: Array,
    normal: Array,
    *,
    reach: float,
    correlated: float,
) -> float:
    """Grey levels by which a sheet is brighter than its surroundings, in most of its sections; 0 if that may be noise.

    Args:
        grey: an image or a volume.
        mask: where to look.
        stations: (N, D), (u, v[, w]), on the sheet.
        normal: (D,): away from the transducer.
        reach: how far to look, px, either way.
        correlated: how many sections share what they show.
    """
    steps = np.arange(-reach, reach + STEP_PX / 2, STEP_PX)
    whole = np.all(sampled(mask.astype(np.float32), stations, normal, steps) > 0.99, axis=1)
    if not whole.any():
        return 0.0
    sections = sampled(grey, stations[whole], normal, steps)
    usual = np.median(sections, axis=0)
    before, behind = steps < -BEFORE_PX, steps > BEHIND_PX
    on = np.argmax(np.where(np.abs(steps) <= ON_PX, usual, -np.inf))
    contrast = usual[on] - max(np.median(usual[before]), usual[behind].min())
    # Where all around is black, the speckle of a band tells how much its own sections differ.
    noise = max(sections[:, before].std(), sections[:, on].std()) / np.sqrt(
        max(len(sections) / correlated, 1.0)
    )
    return float(contrast) if contrast >= max(LEAST_GREY, LEAST_DEVIATIONS * noise) else 0.0
