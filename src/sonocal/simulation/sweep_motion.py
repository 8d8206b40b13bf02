"""How a hand moves a needle through the image, and a probe through the room: smooth and never the same twice."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sonocal.geometry import Array
from sonocal.simulation.ultrasound_probe import ProbeGeometry

__all__ = ["HandMotion"]

STEP_S = 0.02
MARGIN_S = 2.0
SLOW_S, QUICK_S = 0.5, 0.35
"""Times over which a hand forgets where it was: the probe's, and the needle's."""
TILT = 0.7
"""Standard deviation of the needle's slope against the image's normal."""

AZIMUTH = 1.5
"""Standard deviation of the direction from which a needle enters a volume, rad about the probe's axis."""
RIM, OFF_AXIS = 0.8, 0.65
"""Shares of a volume's half width: how far from its axis the needle's two points are, and at most the needle is."""


class HandMotion:
    """Motion as functions of time, defined a little beyond the sweep at both ends.

    Args:
        geometry: of the image the needle must meet.
        duration_s: of the sweep.
        rng: draws the motion.
    """

    def __init__(self, geometry: ProbeGeometry, duration_s: float, rng: np.random.Generator) -> None:
        self._geometry = geometry
        self._spline = _wander(rng, duration_s, [QUICK_S] * 10 + [SLOW_S] * 6)

    def needle(self, times: Array) -> Array:
        """(N, 2, 3) mm in the image's axes: two points of the needle, 20 mm or (3D) most of the view apart."""
        first, direction, second = self._line(times)
        if self._geometry.dimension == 2:
            return np.stack([first - 10 * direction, first + 10 * direction], axis=1)
        return np.stack([first, second], axis=1)

    def needle_ends(self, times: Array, length_mm: float) -> Array:
        """(N, 2, 3) mm in the image's axes: the needle's tip and hub."""
        first, direction, second = self._line(times)
        middle = first if self._geometry.dimension == 2 else 0.5 * (first + second)
        # The image is somewhere along the needle, not always at its middle.
        before = (0.2 + 0.5 * _uniform(self._spline(times)[:, 5]))[:, None] * length_mm
        return np.stack([middle - before * direction, middle + (length_mm - before) * direction], axis=1)

    def roll(self, times: Array) -> Array:
        """(N,) rad: of the needle about itself."""
        return np.asarray(2 * self._spline(times)[:, 6])

    def probe(self, times: Array) -> Array:
        """(N, 4, 4): tracker_from_probe."""
        from scipy.spatial.transform import Rotation

        values = self._spline(times)[:, 10:]
        poses = np.tile(np.eye(4), (len(times), 1, 1))
        poses[:, :3, :3] = Rotation.from_rotvec(0.4 * values[:, :3]).as_matrix()
        poses[:, :3, 3] = [50.0, -30.0, 900.0] + 30 * values[:, 3:]
        return poses

    def _line(self, times: Array) -> tuple[Array, Array, Array]:
        """A point of the needle in the image, its unit direction, and (3D) a second point."""
        values = self._spline(times)
        if self._geometry.dimension == 2:
            point = self._place(values[:, 0], values[:, 1])
            direction = np.column_stack([TILT * values[:, 2:4], np.ones(len(times))])
            return point, direction / np.linalg.norm(direction, axis=1, keepdims=True), point
        # Seen from the face the needle is a chord of the view: it goes in at a side, which changes, passes the
        # probe's axis at a distance, and is never along the beams for long.
        azimuth, off = AZIMUTH * values[:, 1], OFF_AXIS * (2 * _uniform(values[:, 2]) - 1)
        middle = off[:, None] * np.column_stack([-np.sin(azimuth), np.cos(azimuth)])
        half = np.sqrt(RIM**2 - off**2)[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
        first = self._place(values[:, 0], *(middle - half).T)
        second = self._place(values[:, 3], *(middle + half).T)
        direction = second - first
        return first, direction / np.linalg.norm(direction, axis=1, keepdims=True), second

    def _place(self, depth: Array, lateral: Array, sweep: Array | None = None) -> Array:
        """A place in the fan: evenly over its depth, and in 2D over its width, from normal deviates."""
        if sweep is not None:
            return self._geometry.point_at(0.12 + 0.75 * _uniform(depth), lateral, sweep)
        return self._geometry.point_at(0.08 + 0.86 * _uniform(depth), 1.8 * _uniform(lateral) - 0.9)


def _wander(rng: np.random.Generator, duration_s: float, memory_s: list[float]) -> Callable[[Array], Array]:
    """A spline of smooth normal deviates, one column a memory time."""
    from scipy.interpolate import CubicSpline
    from scipy.ndimage import gaussian_filter1d

    times = np.arange(-MARGIN_S, duration_s + MARGIN_S, STEP_S)
    columns = []
    for memory in memory_s:
        # White noise through a Gaussian of s steps has the variance 1 / (2 s sqrt(pi)).
        steps = memory / STEP_S
        noise = rng.standard_normal(len(times) + int(8 * steps))
        smooth = gaussian_filter1d(noise, steps)[int(4 * steps) :][: len(times)]
        columns.append(smooth * np.sqrt(2 * steps * np.sqrt(np.pi)))
    spline: Callable[[Array], Array] = CubicSpline(times, np.column_stack(columns))
    return spline


def _uniform(normal: Array) -> Array:
    """0 to 1, evenly, from normal deviates."""
    from scipy.special import ndtr

    return np.asarray(ndtr(normal))
