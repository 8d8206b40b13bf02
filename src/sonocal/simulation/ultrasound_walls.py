"""What flat walls look like: a mirror, seen through a slice that has a thickness, with echoes of itself behind it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array
from sonocal.simulation.ultrasound import Echo, Look
from sonocal.simulation.ultrasound_probe import ProbeGeometry

__all__ = ["WallLook", "wall_echo"]

ELEVATIONS = np.linspace(-2.5, 2.5, 21)
"""Standard deviations of the slice's profile at which a wall is looked at."""


@dataclass(frozen=True)
class WallLook:
    """How a wall appears; dB are of amplitude, 0 dB is white.

    Attributes:
        wall_db: of a wall across the beam.
        specular: angle over which it falls off, rad (standard deviation): a mirror throws a slanted beam elsewhere.
        oblique_db: what is left of it when it is far from across the beam: no wall is quite smooth.
        roughness: share of its echo with a phase of its own.
        behind_mm, behind_db: of the wall's other face: a line below the first, parallel to it.
        twice_db: of what goes to the wall and back twice: a line at twice the depth, tilted twice as much.
        fading_db: slow variation of the brightness along it (standard deviation).
    """

    wall_db: float = 6.0
    specular: float = 0.25
    oblique_db: float = -20.0
    roughness: float = 0.3
    behind_mm: float = 4.0
    behind_db: float = -8.0
    twice_db: float = -14.0
    fading_db: float = 3.0


def wall_echo(
    plane: Array, geometry: ProbeGeometry, look: Look, wall: WallLook, rng: np.random.Generator
) -> list[Echo]:
    """The wall's first echo, and those that come after it.

    Args:
        plane: (4,), ``n . x + d = 0``, mm of the image's axes.
        geometry: of the image.
        look: of the image: its slice's thickness.
        wall: of the wall.
        rng: draws phases and fading.
    """
    points, weights = _patches(plane, geometry, look)
    if not len(points):
        return []
    away = geometry.beam_directions(points)
    across = np.abs(away @ plane[:3])
    tilt = np.arccos(np.clip(across, 0, 1))
    left = 10 ** (wall.oblique_db / 20)
    fading = 10 ** (wall.fading_db / 20 * _slow(points, rng))
    rough = 1 + wall.roughness * (rng.normal(size=len(points)) + 1j * rng.normal(size=len(points))) / np.sqrt(
        2
    )
    size = weights * fading * rough * (left + (1 - left) * np.exp(-0.5 * (tilt / wall.specular) ** 2))
    ways = [
        (np.zeros(len(points)), wall.wall_db),
        (wall.behind_mm / np.maximum(across, 0.3), wall.wall_db + wall.behind_db),
        (_from_face(points, geometry), wall.wall_db + wall.twice_db),
    ]
    flat = [1.0, 1.0, 0.0 if geometry.dimension == 2 else 1.0]
    return [
        Echo(
            (points + further[:, None] * away) * flat,
            size * 10 ** (decibel / 20) * np.exp(2j * np.pi * rng.random()),
        )
        for further, decibel in ways
    ]


def _patches(plane: Array, geometry: ProbeGeometry, look: Look) -> tuple[Array, Array]:
    """Points of the wall where beams run, and their share of its brightness: 1 is one wall's."""
    size = np.array([*geometry.size_px, 1][:3]) * geometry.scale_mm_per_px
    middle = 0.5 * size * [1, 1, geometry.dimension == 3]
    normal, distance = plane[:3], float(plane[:3] @ middle + plane[3])
    if geometry.dimension == 3:
        step = 2 * look.axial_mm
        points = _over(middle - distance * normal, np.linalg.svd(normal[None])[2][1:], 0.9 * size.max(), step)
        return _within(points, np.full(len(points), (step / look.lateral_mm[1]) ** 2 / (2 * np.pi)), geometry)
    slope = np.hypot(*normal[:2])
    if slope < 1e-6:
        return np.empty((0, 3)), np.empty(0)
    along, down = np.array([-normal[1], normal[0], 0.0]) / slope, np.array([*normal[:2], 0.0]) / slope
    step = look.axial_mm
    line = _over(middle - distance / slope * down, along[None], size.max(), step)
    depth = geometry.beams_of(line)[:, 0] / (geometry.samples - 1)
    sigma = np.interp(depth, [0, 1], look.elevation_mm)
    elevation = sigma[:, None] * ELEVATIONS
    share = np.exp(-0.5 * ELEVATIONS**2)
    # Out of the slice's middle the wall is nearer or further.
    points = line[:, None] - (elevation * normal[2] / slope)[..., None] * down
    points[..., 2] = elevation
    weights = np.broadcast_to(
        share / share.sum() * step / (np.sqrt(2 * np.pi) * look.lateral_mm[1]), elevation.shape
    )
    return _within(points.reshape(-1, 3), weights.reshape(-1), geometry)


def _over(middle: Array, along: Array, reach: float, step: float) -> Array:
    """(N, 3): a line's or a plane's points about one of it."""
    ticks = np.arange(-reach, reach, step)
    grid = np.stack(np.meshgrid(*[ticks] * len(along), indexing="ij"), axis=-1).reshape(-1, len(along))
    return np.asarray(middle + grid @ along)


def _within(points: Array, weights: Array, geometry: ProbeGeometry) -> tuple[Array, Array]:
    beams = geometry.beams_of(points * [1, 1, geometry.dimension == 3])
    keep = ((beams >= 0) & (beams <= np.array(geometry.grid_shape) - 1)).all(axis=1)
    return points[keep], weights[keep]


def _from_face(points: Array, geometry: ProbeGeometry) -> Array:
    """(N,), mm: from the transducer's face along the beam."""
    return np.asarray(geometry.beams_of(points)[:, 0] / (geometry.samples - 1) * geometry.depth_mm)


def _slow(points: Array, rng: np.random.Generator) -> NDArray[np.float64]:
    """(N,): of some waves some tens of mm long, of standard deviation 1."""
    waves = rng.normal(scale=2 * np.pi / 60.0, size=(4, 3))
    phases = points @ waves.T + 2 * np.pi * rng.random(4)
    return np.asarray(np.cos(phases).sum(axis=1) / np.sqrt(2.0))
