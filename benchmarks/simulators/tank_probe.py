"""Where the beams of a simulated tank's probe run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Probe"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Probe:
    """Where beams run: from an arc of a radius, or side by side down the columns where that is 0. Lengths in mm."""

    side_px: int = 300
    mm_per_px: float = 0.36
    radius_mm: float = 50.0
    half_angle: float = 0.5
    beams: int = 140

    @property
    def side_mm(self) -> float:
        """Of the square image."""
        return self.side_px * self.mm_per_px

    @property
    def apex_mm(self) -> Array:
        """Where an arc's beams would meet."""
        return np.array([0.5 * self.side_mm, -self.radius_mm * np.cos(self.half_angle)])

    def rays(self) -> tuple[Array, Array]:
        """Where beams start (B, 2), and where they go (B, 2)."""
        if self.radius_mm == 0:
            across = np.linspace(0, self.side_mm, self.beams)
            return np.column_stack([across, 0 * across]), np.tile([0.0, 1.0], (self.beams, 1))
        angle = np.linspace(-self.half_angle, self.half_angle, self.beams)
        way = np.column_stack([np.sin(angle), np.cos(angle)])
        return self.apex_mm + self.radius_mm * way, way

    def beam_of(self, places: Array) -> tuple[Array, Array]:
        """Of places (..., 2), mm: which beam, as a number with fractions, and how far along it, mm."""
        if self.radius_mm == 0:
            return places[..., 0] / self.side_mm * (self.beams - 1), places[..., 1]
        off = places - self.apex_mm
        angle = np.arctan2(off[..., 0], off[..., 1])
        beam = (angle / self.half_angle + 1) / 2 * (self.beams - 1)
        return beam, np.linalg.norm(off, axis=-1) - self.radius_mm
