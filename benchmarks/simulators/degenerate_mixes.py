"""Mixes that leave a motion free, or would without noise, and the like that do not. NumPy and SciPy alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.simulators.trust_scans import Array, mapped

SCALE, SIDE = 0.24, 500.0
SIGHTINGS = 60

Made = tuple[Array, Array, Array]
"""Truth (4, 4), points of every sighting (C, P, 3), px, and what spans its target (C, K, 3), mm."""


def truth_of(rng: np.random.Generator) -> Array:
    """A map of px to mm."""
    truth = np.eye(4)
    truth[:3, :3] = SCALE * Rotation.random(random_state=rng).as_matrix()
    truth[:3, 3] = rng.uniform(-80, 80, 3)
    return truth


def seen(rng: np.random.Generator, points: int, dimension: int) -> Array:
    """(C, P, 3), px: anywhere in the image."""
    return rng.uniform(20, SIDE - 20, (SIGHTINGS, points, 3)) * ([1, 1, 0] if dimension == 2 else [1, 1, 1])


def through(places: Array, normals: Array, rng: np.random.Generator) -> Array:
    """(C, 3, 3): three points about places (C, 3) of planes with normals (C, 3)."""
    axes = np.linalg.svd(normals[:, None])[2][:, 1:]
    about = 2 * np.pi / 3 * np.arange(3) + rng.uniform(0, 2 * np.pi, (len(places), 1))
    corners = np.stack([np.cos(about), np.sin(about)], axis=-1) @ axes
    return places[:, None] + 80 * corners


def wall_sightings(rng: np.random.Generator, dimension: int, normal: Callable[[Array], Array]) -> Made:
    """Lines of a 2D image, or three points of a volume, on planes whose normals (C, 3) are those of the lines' ways."""
    truth = truth_of(rng)
    points = seen(rng, 2 if dimension == 2 else 3, dimension)
    there = mapped(truth, points)
    along = there[:, 1] - there[:, 0]
    normals = normal(along) if dimension == 2 else np.cross(along, there[:, 2] - there[:, 0])
    return truth, points, through(there[:, 0], normals / np.linalg.norm(normals, axis=1, keepdims=True), rng)


def any_walls(rng: np.random.Generator, dimension: int) -> Made:
    """Walls of all directions: nothing is wrong."""
    return wall_sightings(rng, dimension, lambda along: np.cross(along, rng.normal(size=along.shape)))


def parallel_walls(rng: np.random.Generator, dimension: int) -> Made:
    """Walls of one direction, at any depth."""
    truth, normal = truth_of(rng), rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    points = seen(rng, 2 if dimension == 2 else 3, dimension)
    pixel = truth[:3, :3].T @ normal / SCALE**2
    pixel[2] = 0 if dimension == 2 else pixel[2]
    for place in range(1, points.shape[1]):
        away = (points[:, place] - points[:, 0]) @ pixel
        points[:, place] -= away[:, None] * pixel / (pixel @ pixel)
    return truth, points, through(mapped(truth, points[:, 0]), np.tile(normal, (SIGHTINGS, 1)), rng)


def one_place(rng: np.random.Generator, dimension: int) -> Made:
    """One bead that is at rest in the probe's frame: one point, again and again."""
    truth = truth_of(rng)
    points = np.repeat(seen(rng, 1, dimension)[:1], SIGHTINGS, axis=0)
    return truth, points, mapped(truth, points)


def beads_on_a_line(rng: np.random.Generator, dimension: int) -> Made:
    """Beads that are all seen on one line of the image."""
    truth, ends = truth_of(rng), seen(rng, 1, dimension)[:2, 0]
    points = (ends[0] + rng.uniform(0, 1, (SIGHTINGS, 1)) * (ends[1] - ends[0]))[:, None]
    return truth, points, mapped(truth, points)


def any_beads(rng: np.random.Generator, dimension: int) -> Made:
    """Beads anywhere in the image: nothing is wrong."""
    truth, points = truth_of(rng), seen(rng, 1, dimension)
    return truth, points, mapped(truth, points)


def walls_through_a_point(rng: np.random.Generator, dimension: int) -> Made:
    """Walls that all pass through one point, so that the image can grow about it."""
    truth = truth_of(rng)
    points = seen(rng, 2 if dimension == 2 else 3, dimension)
    port = mapped(truth, np.array([SIDE / 2, SIDE / 2, 0.3 * SIDE]))
    if dimension == 3:  # three points of a plane through it
        middle = np.array([SIDE / 2, SIDE / 2, 0.3 * SIDE])
        normals = rng.normal(size=(SIGHTINGS, 3))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        away = np.einsum("cpi,ci->cp", points - middle, normals)
        points = points - away[:, :, None] * normals[:, None]
    there = mapped(truth, points)
    normals = np.cross(there[:, 0] - port, there[:, 1] - port)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return truth, points, through(np.tile(port, (SIGHTINGS, 1)), normals, rng)


KINDS: dict[str, tuple[Callable[[np.random.Generator, int], Made], str]] = {
    "walls of all directions": (any_walls, ""),
    "parallel walls": (parallel_walls, "shift"),
    "walls through one point": (walls_through_a_point, "scale"),
    "beads anywhere": (any_beads, ""),
    "beads on one line": (beads_on_a_line, "turn"),
    "one bead at rest": (one_place, "turn"),
}
"""How each is made, and what is free in it."""


def with_noise(
    made: Made, rng: np.random.Generator, dimension: int, sigma_px: float, sigma_mm: float
) -> Made:
    """Noise on both sides."""
    truth, points, spanning = made
    off = sigma_px * rng.normal(size=points.shape) * ([1, 1, 0] if dimension == 2 else [1, 1, 1])
    return truth, points + off, spanning + sigma_mm * rng.normal(size=spanning.shape)
