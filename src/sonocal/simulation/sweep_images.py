"""Images of a simulated sweep, made when they are asked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.recording import Frames
from sonocal.recording.frames import Image
from sonocal.simulation.sweep_options import SweepOptions
from sonocal.simulation.ultrasound import Echo, Look, UltrasoundImager
from sonocal.simulation.ultrasound_probe import ProbeGeometry
from sonocal.simulation.ultrasound_scenery import Scenery

__all__ = ["SimulatedFrames", "draw_overlay"]

CLEAR_MM = 5.0
FAINT = 0.02  # amplitude below which another echo is lost in speckle


class SimulatedFrames(Frames):
    """Images of a needle, made when they are asked for, each from its own random numbers."""

    def __init__(
        self,
        geometry: ProbeGeometry,
        look: Look | None,
        options: SweepOptions,
        needle_mm: Array,
        visible: NDArray[np.bool_],
    ) -> None:
        self._geometry = geometry
        self._imager = UltrasoundImager(geometry, look)
        self._options, self._needle, self._visible = options, needle_mm, visible
        self._scenery = Scenery(
            geometry, len(visible) / options.rate_hz, options.compact, options.interfaces, options.seed
        )
        self.shape, self.dtype = geometry.size_px[::-1], np.dtype(np.uint8)

    def __len__(self) -> int:
        return len(self._visible)

    def read(self, index: int) -> Image:
        """Image `index`."""
        rng = np.random.default_rng([self._options.seed, 2, index])
        echoes = self._scenery.echoes(index / self._options.rate_hz, rng)
        if self._visible[index]:
            echoes.append(self._imager.needle(self._needle[index], rng))
        image = self._imager.image(echoes, rng)
        if self._options.overlay:
            draw_overlay(image)
        image.flags.writeable = False
        return image

    def apart(self, points_mm: Array) -> NDArray[np.bool_]:
        """(N,): whether the points (N, 2), one an image, are clear of other echoes, shadows and the fan's edge."""
        angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
        around = CLEAR_MM * np.column_stack([np.cos(angles), np.sin(angles)])
        clear = np.asarray(self._geometry.inside(points_mm[:, None] + around).all(axis=1))
        for index in np.flatnonzero(clear).tolist():
            point = points_mm[index]
            rng = np.random.default_rng([self._options.seed, 2, index])
            echoes = self._scenery.echoes(index / self._options.rate_hz, rng)
            clear[index] = all(
                _apart(self._geometry, e, point) for e in echoes if np.abs(e.amplitudes).max() > FAINT
            )
        return clear


def _apart(geometry: ProbeGeometry, echo: Echo, point_mm: Array) -> bool:
    """Whether a point is neither near an echo nor behind one that casts a shadow."""
    beams, place = geometry.beams_of(echo.points_mm), geometry.beams_of(np.append(point_mm, 0.0))
    near = (np.linalg.norm(echo.points_mm[:, :2] - point_mm, axis=1) < CLEAR_MM).any()
    under = (
        echo.shadow > 0
        and np.min(beams[:, 1]) < place[1] < np.max(beams[:, 1])
        and place[0] > beams[:, 0].min()
    )
    return not (near or under)


def draw_overlay(image: Image) -> None:
    """Draw over an image a ruler along the right edge and a block of strokes like text in the upper left corner."""
    rows, cols = image.shape[-2:]
    for row in range(rows // 10, rows, max(rows // 12, 4)):
        image[..., row : row + 2, cols - cols // 30 : cols - 6] = 230
    strokes = np.random.default_rng(0).random((7, 60)) < 0.5
    block = np.kron(strokes, np.ones((2, 2), dtype=bool))[: rows - 8, : cols - 8]
    image[..., 8 : 8 + block.shape[0], 8 : 8 + block.shape[1]][..., block] = 220
