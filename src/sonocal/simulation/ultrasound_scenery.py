"""What else shines in an image: compact echoes, interfaces and shadows that come and go."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array
from sonocal.simulation.ultrasound import Echo
from sonocal.simulation.ultrasound_probe import ProbeGeometry

__all__ = ["Scenery"]

LIFE_S = 1.0
COMPACT_DB = (-16.0, 1.0)
INTERFACE_DB = (-14.0, -3.0)


class Scenery:
    """Bright things that drift through the image while the probe moves over them.

    Args:
        geometry: the probe's.
        duration_s: of the sweep.
        compact: how many compact echoes are in view on average; some outshine a needle.
        interfaces: how many layers are in view on average; each casts a shadow.
        seed: of everything random.
    """

    def __init__(
        self,
        geometry: ProbeGeometry,
        duration_s: float,
        compact: float = 3.0,
        interfaces: float = 1.0,
        seed: int = 0,
    ) -> None:
        self._geometry = geometry
        rng = np.random.default_rng([seed, 1])
        self._compact = _Drifting(rng, compact, duration_s, COMPACT_DB)
        self._interfaces = _Drifting(rng, interfaces, duration_s, INTERFACE_DB)

    def echoes(self, time_s: float, rng: np.random.Generator) -> list[Echo]:
        """What is in view at a time."""
        found = [self._interface(*item, rng) for item in self._interfaces.at(time_s)]
        return found + [self._blob(*item, rng) for item in self._compact.at(time_s)]

    def _blob(self, place: Array, size: Array, amplitude: float, rng: np.random.Generator) -> Echo:
        centre = self._geometry.point_at(place[0], place[1], place[2])
        offsets = rng.normal(size=(12, 3)) * (0.2 + 1.0 * size)
        return Echo(centre + self._flat(offsets), np.full(12, amplitude / 4))

    def _interface(self, place: Array, size: Array, amplitude: float, rng: np.random.Generator) -> Echo:
        lateral = place[1] + (0.15 + 0.35 * size[0]) * np.linspace(-1, 1, 160)
        # A layer lies across the beam, a little tilted and curved.
        depth = (
            place[0]
            + 0.15 * (size[1] - 0.5) * (lateral - place[1])
            + 0.1 * size[2] * (lateral - place[1]) ** 2
        )
        if self._geometry.dimension == 2:
            points = self._geometry.point_at(depth, lateral)
        else:
            sweep = place[2] + 0.4 * np.linspace(-1, 1, 80)
            points = self._geometry.point_at(depth[:, None], lateral[:, None], sweep).reshape(-1, 3)
        strength = amplitude * (0.3 + 0.2 * rng.random(len(points)))
        return Echo(points, strength, shadow=0.6 if self._geometry.dimension == 2 else 0.0)

    def _flat(self, offsets: Array) -> Array:
        return offsets * ([1.0, 1.0, 0.0] if self._geometry.dimension == 2 else [1.0, 1.0, 1.0])


class _Drifting:
    """Things with a place that drifts and a brightness that swells and fades."""

    def __init__(
        self, rng: np.random.Generator, in_view: float, duration_s: float, decibel: tuple[float, float]
    ) -> None:
        # A bump of width LIFE_S is in view for about 2.5 of it.
        count = rng.poisson(in_view * (duration_s + 4 * LIFE_S) / (2.5 * LIFE_S))
        self._peak = rng.uniform(-2 * LIFE_S, duration_s + 2 * LIFE_S, count)
        self._place = rng.uniform([0.1, -0.9, -0.9], [0.95, 0.9, 0.9], (count, 3))
        self._speed = rng.normal(scale=[0.02, 0.06, 0.06], size=(count, 3))
        self._size = rng.random((count, 3))
        self._amplitude = 10 ** (rng.uniform(*decibel, count) / 20)

    def at(self, time_s: float) -> list[tuple[Array, Array, float]]:
        """(place, size, amplitude) of everything in view."""
        age = time_s - self._peak
        seen = np.flatnonzero(np.abs(age) < 2 * LIFE_S)
        fade = np.exp(-0.5 * (age / LIFE_S) ** 2)
        return [
            (self._place[i] + age[i] * self._speed[i], self._size[i], float(self._amplitude[i] * fade[i]))
            for i in seen
        ]
