"""Dots whose wires nobody named, as a calibration has them: which was which, and how often each wire was met."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.result import Calibration
from sonocal.errors import require
from sonocal.geometry import Array, needle_in_image
from sonocal.geometry.shown import brief
from sonocal.registration import Association

__all__ = ["LabelledDots", "WireHits", "next_best_in_words"]

# Powers of ten from which on it says no more how many.
MOST_POWERS = 100


@dataclass(frozen=True)
class WireHits:
    """How often a wire was met.

    Attributes:
        name: of the wire.
        seen: images in which a dot of it takes part in the calibration.
        crossed: images that it crosses, as the calibration has it: within the area that the calibration is of.
        rms_mm: of its dots from it; NaN without any.
    """

    name: str
    seen: int
    crossed: int
    rms_mm: float

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class LabelledDots:
    """Dots of images that may each be of any of several wires, and which wire each was taken for.

    Attributes:
        points_px: (N, 2), as the images have them.
        frame: (N,): the number of each one's image.
        wire: (N,): the wire of each that takes part in the calibration, an index into `names`; -1 for the others.
        residuals_mm: (N,): of those from their wire; NaN of the others.
        names: (L,), sorted.
        frames: (F,): numbers of images with dots.
        wires_mm: (F, L, 2, 3): the wires in them, in the probe marker's frame.
        association: what was found before anything was calibrated, how sure that is, and what is the next best.
    """

    points_px: Array
    frame: NDArray[np.int64]
    wire: NDArray[np.int64]
    residuals_mm: Array
    names: tuple[str, ...]
    frames: NDArray[np.int64]
    wires_mm: Array
    association: Association

    __repr__ = brief

    def crossings_px(self, calibration: Calibration, frame: int) -> Array:
        """(L, 2): where the wires cross an image as the calibration has it; NaN where it says nothing of one."""
        require("calibration", calibration, Calibration)
        here = np.flatnonzero(self.frames == frame)
        if not len(here):
            return np.full((len(self.names), 2), np.nan)
        met = needle_in_image(calibration.probe_from_image, self.wires_mm[here[0]])
        if calibration.sound is not None:  # images are as scanned
            met = calibration.sound.in_image(met)
        return np.asarray(met)

    def hits(self, calibration: Calibration) -> tuple[WireHits, ...]:
        """How often each wire was met, in the order of their names."""
        require("calibration", calibration, Calibration)
        low, high = calibration.area_px[:, :2]
        met = np.stack([self.crossings_px(calibration, int(one)) for one in self.frames])
        crossed = np.all((met >= low) & (met <= high), axis=2).sum(axis=0)
        return tuple(self._hits_of(i, name, int(crossed[i])) for i, name in enumerate(self.names))

    def _hits_of(self, wire: int, name: str, crossed: int) -> WireHits:
        own = self.wire == wire
        rms_mm = float(np.sqrt(np.mean(self.residuals_mm[own] ** 2))) if own.any() else np.nan
        return WireHits(name, len(np.unique(self.frame[own])), crossed, rms_mm)


def next_best_in_words(association: Association) -> str:
    """How far the next best explanation is."""
    one = association.second
    if one is None:
        return "no other labelling comes near"
    power = one.behind_nats / np.log(10)
    factor = f"10^{power:.0f}" if power < MOST_POWERS else f"over 10^{MOST_POWERS}"
    less = "as likely" if power < 1 else f"less likely by a factor of {factor}"
    return f"the next best is {one.name}, up to {one.apart_mm:.0f} mm away and {less}"
