"""Points, lines and planes seen twice: in a source's units, and in mm after a similarity.

Whatever has an extent is measured as one would: a line by two points of it, a plane by three points about a place
on it, each with noise along every axis, and not at the same places on both sides. NumPy and SciPy alone: what
judges an estimator shares nothing with it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]

# The source is a cube of so many units, of so many mm each.
SIDE, MM_PER_UNIT = 500.0, 0.4
# Points that measure a line or a plane lie about so far from its middle, mm.
REACH_MM = 50.0


@dataclasses.dataclass(frozen=True)
class Part:
    """Correspondences of one kind.

    Attributes:
        kind: a name of `KINDS`.
        source: points (N, 3), segments (N, 2, 3) or three points of each plane (N, 3, 3).
        target: likewise, mm.
    """

    kind: str
    source: Array
    target: Array

    def __len__(self) -> int:
        return len(self.source)


@dataclasses.dataclass(frozen=True)
class Mix:
    """Correspondences with known truth.

    Attributes:
        truth: (4, 4), mm from the source's units.
        parts: a kind each.
        corners: (8, 3), of the source's cube.
    """

    truth: Array
    parts: tuple[Part, ...]
    corners: Array


@dataclasses.dataclass(frozen=True)
class Noise:
    """Standard deviations along every axis: of a source point, in mm, and of a target point, mm."""

    source_mm: float = 0.2
    target_mm: float = 0.2


class Scene:
    """A truth, and what is seen of it."""

    def __init__(self, seed: Sequence[int], noise: Noise) -> None:
        self.random = np.random.default_rng(seed)
        self.noise = noise
        self.truth = np.eye(4)
        self.truth[:3, :3] = MM_PER_UNIT * Rotation.random(random_state=self.random).as_matrix()
        self.truth[:3, 3] = self.random.uniform(-150, 150, 3)

    def places(self, count: int) -> Array:
        """(count, 3) anywhere in the source."""
        return self.random.uniform(0, SIDE, (count, 3))

    def directions(self, count: int) -> Array:
        """(count, 3) unit vectors."""
        found = self.random.normal(size=(count, 3))
        return found / np.linalg.norm(found, axis=1, keepdims=True)

    def source(self, points: Array) -> Array:
        """Points (..., 3) as measured in the source."""
        return points + self.noise.source_mm / MM_PER_UNIT * self.random.normal(size=points.shape)

    def target(self, points: Array) -> Array:
        """Points (..., 3) of the source as measured in mm."""
        moved = points @ self.truth[:3, :3].T + self.truth[:3, 3]
        return moved + self.noise.target_mm * self.random.normal(size=points.shape)

    def on_lines(self, places: Array, along: Array) -> Array:
        """(N, 2, 3): two points of each line, on either side of a place."""
        reach = (
            REACH_MM / MM_PER_UNIT * self.random.uniform(0.5, 1.5, (len(places), 2, 1)) * [[[-1.0], [1.0]]]
        )
        return places[:, None] + reach * along[:, None]

    def on_planes(self, places: Array, normals: Array) -> Array:
        """(N, 3, 3): three points of each plane, about a place."""
        first = np.cross(normals, self.directions(len(normals)))
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        axes = np.stack([first, np.cross(normals, first)], axis=1)
        angles = self.random.uniform(0, 2 * np.pi, (len(places), 1)) + 2 * np.pi / 3 * np.arange(3)
        around = np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ axes
        return (
            places[:, None]
            + REACH_MM / MM_PER_UNIT * self.random.uniform(0.7, 1.3, (len(places), 3, 1)) * around
        )


def planes_through(points: Array) -> Array:
    """(N, 4): the planes of three points (N, 3, 3) each."""
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.column_stack([normals, -np.sum(normals * points[:, 0], axis=1)])


def point_plane(scene: Scene, count: int) -> tuple[Array, Array]:
    """Points, and planes that were touched near them."""
    points, normals = scene.places(count), scene.directions(count)
    near = scene.on_planes(points, normals)[:, 0]
    return scene.source(points), scene.target(scene.on_planes(near, normals))


def image_point_plane(scene: Scene, count: int) -> tuple[Array, Array]:
    """Points of an image, and planes that were touched near them."""
    points, normals = scene.places(count) * [1, 1, 0], scene.directions(count)
    near = scene.on_planes(points, normals)[:, 0]
    return scene.source(points) * [1, 1, 0], scene.target(scene.on_planes(near, normals))


def point_line(scene: Scene, count: int) -> tuple[Array, Array]:
    """Points of a volume on lines."""
    points = scene.places(count)
    return scene.source(points), scene.target(scene.on_lines(points, scene.directions(count)))


def image_point_line(scene: Scene, count: int) -> tuple[Array, Array]:
    """Points of an image on lines; what moves a point stays in the image."""
    points = scene.places(count) * [1, 1, 0]
    seen = scene.source(points) * [1, 1, 0]
    return seen, scene.target(scene.on_lines(points, scene.directions(count)))


def point_point(scene: Scene, count: int) -> tuple[Array, Array]:
    """Points."""
    points = scene.places(count)
    return scene.source(points), scene.target(points)


def line_line(scene: Scene, count: int) -> tuple[Array, Array]:
    """Lines, by other points of each on either side."""
    points, along = scene.places(count), scene.directions(count)
    return scene.source(scene.on_lines(points, along)), scene.target(scene.on_lines(points, along))


def line_plane(scene: Scene, count: int) -> tuple[Array, Array]:
    """Lines in planes."""
    points, normals = scene.places(count), scene.directions(count)
    along = np.cross(normals, scene.directions(count))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    near = scene.on_planes(points, normals)[:, 0]
    return scene.source(scene.on_lines(points, along)), scene.target(scene.on_planes(near, normals))


def plane_plane(scene: Scene, count: int) -> tuple[Array, Array]:
    """Planes, touched at other places on either side."""
    points, normals = scene.places(count), scene.directions(count)
    near = scene.on_planes(points, normals)[:, 0]
    return scene.source(scene.on_planes(points, normals)), scene.target(scene.on_planes(near, normals))


def image_point_point(scene: Scene, count: int) -> tuple[Array, Array]:
    """Points of an image, on known points."""
    points = scene.places(count) * [1, 1, 0]
    return scene.source(points) * [1, 1, 0], scene.target(points)


def image_line_plane(scene: Scene, count: int) -> tuple[Array, Array]:
    """Planes that an image shows as lines: two points of each, half an image apart at least."""
    ends = scene.random.uniform(0, SIDE, (count, 2, 3)) * [0.4, 1, 0] + [[0, 0, 0], [0.6 * SIDE, 0, 0]]
    along = ends[:, 1] - ends[:, 0]
    normals = np.cross(along, scene.directions(count))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    near = scene.on_planes(ends.mean(axis=1), normals)[:, 0]
    return scene.source(ends) * [1, 1, 0], scene.target(scene.on_planes(near, normals))


KINDS: dict[str, Callable[[Scene, int], tuple[Array, Array]]] = {
    one.__name__: one
    for one in (
        point_plane,
        image_point_plane,
        point_line,
        image_point_line,
        point_point,
        line_line,
        line_plane,
        plane_plane,
        image_point_point,
        image_line_plane,
    )
}


def mix_of(kinds: dict[str, int], seed: int, noise: Noise | None = None, *, related: bool = True) -> Mix:
    """So many correspondences of each kind.

    Args:
        kinds: how many of which of `KINDS`.
        seed: of everything random.
        noise: of points; None: 0.2 mm on either side, a thousandth of the source's width.
        related: False: sources and targets are of scenes that have nothing to do with each other.
    """
    noise = noise or Noise()
    here = Scene((seed, 0), noise)
    there = here if related else Scene((seed, 1), noise)
    parts = []
    for kind, count in kinds.items():
        source, target = KINDS[kind](here, count)
        parts.append(Part(kind, source, target if related else KINDS[kind](there, count)[1]))
    corners = SIDE * np.indices((2, 2, 2)).reshape(3, -1).T.astype(float)
    return Mix(here.truth, tuple(parts), corners)


def with_strangers(mix: Mix, share: float, seed: int) -> Mix:
    """The mix with a share of the targets taken from a scene of its own."""
    random, there = np.random.default_rng((seed, 2)), Scene((seed, 3), Noise())
    parts = []
    for part in mix.parts:
        strange = random.random(len(part)) < share
        other = KINDS[part.kind](there, len(part))[1]
        target = np.where(strange.reshape(-1, *[1] * (part.target.ndim - 1)), other, part.target)
        parts.append(dataclasses.replace(part, target=target))
    return dataclasses.replace(mix, parts=tuple(parts))
