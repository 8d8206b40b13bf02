"""Pictures of walls by another way than sonocal's simulation: a mirror a beam, envelopes summed; NumPy alone.

A wall is a row of mirrors along the beams of a linear array; each beam's echo is a Gaussian pulse at the depth where
the wall is, for some elevations of the slice, with the wall's other face and a bounce between array and wall behind.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["wall_picture"]

ELEVATIONS = np.linspace(-2, 2, 9)


def wall_picture(
    rng: np.random.Generator,
    *,
    shape: tuple[int, int] = (400, 360),
    tilt: float = 0.0,
    lean: float = 0.0,
    depth_px: float = 200.0,
    gain: float = 1.0,
    speckle: float = 0.01,
    pulse_px: float = 1.8,
    slice_px: float = 5.0,
) -> NDArray[np.uint8]:
    """Grey levels, of beams that run down the columns.

    Args:
        rng: draws speckle and fading.
        shape: (rows, columns).
        tilt: of the wall in the image, rad.
        lean: of the wall out of the image, rad.
        depth_px: of the wall in the middle column.
        gain: of amplitudes.
        speckle: amplitude of the speckle; of the wall it is 1.
        pulse_px: standard deviation of the pulse along the beam.
        slice_px: of the slice's thickness.
    """
    rows, cols = np.arange(shape[0])[:, None], np.arange(shape[1])
    at = depth_px + np.tan(tilt) * (cols - 0.5 * (shape[1] - 1))
    weights = np.exp(-0.5 * ELEVATIONS**2)
    weights /= weights.sum()
    fading = np.exp(
        0.4 * np.convolve(rng.normal(size=shape[1] + 60), np.ones(61) / np.sqrt(61), "valid")
    ) * np.cos(tilt)
    amplitude: NDArray[Any] = np.zeros(shape)
    for share, elevation in zip(weights, ELEVATIONS, strict=True):
        first = at + np.tan(lean) * slice_px * elevation
        for place, strength in ((first, 1.0), (first + 22.0, 0.45), (2 * first, 0.25)):
            amplitude += share * strength * fading * np.exp(-0.5 * ((rows - place) / pulse_px) ** 2)
    noise = speckle * rng.rayleigh(size=shape) + 1e-4
    grey = 255 * (1 + 20 * np.log10(gain * np.hypot(amplitude, noise)) / 60)
    return np.clip(grey, 0, 255).astype(np.uint8)
