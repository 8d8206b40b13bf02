"""What one would write without sonocal for lines and planes on lines and planes, most of them wrong.

NumPy and SciPy alone. Both are told more than `register` is: lines and planes have directions with signs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.simulators.mixes import Array, Mix, Part, planes_through

# Directions of measured lines and planes are as good as this, rad.
DIRECTION_BOUND = 0.02
# Lines whose directions differ by less than this (sine) say little about their distance.
LEAST_SINE = 0.3
CONFIDENCE, MOST_SAMPLES = 0.9999, 10_000


@dataclasses.dataclass(frozen=True)
class Scene:
    """Lines and planes of both sides, as arrays.

    Attributes:
        points: (N, 3), source: three of each plane, two of each line.
        normals: (N, R, 3), target: what the points must not leave their planes or lines along (zeros fill up).
        places: (N, 3), target: a place on each plane or line.
        of: (N,): the correspondence that a point is of, lines first.
        lines: source and target (L, 2, 3), two points each.
        directions: source and target (C, 3): lines' directions and planes' normals.
    """

    points: Array
    normals: Array
    places: Array
    of: NDArray[np.int64]
    lines: tuple[Array, Array]
    directions: tuple[Array, Array]

    @classmethod
    def of_mix(cls, mix: Mix) -> Scene:
        """Of a part of lines on lines and one of planes on planes."""
        lines, walls = mix.parts
        planes = Part(walls.kind, planes_through(walls.source), planes_through(walls.target))
        along = [unit(side[:, 1] - side[:, 0]) for side in (lines.source, lines.target)]
        first, second = basis(along[1])
        at_lines = np.stack([first, second], axis=1)
        normals = planes.target[:, :3]
        at_planes = np.stack([normals, np.zeros_like(normals)], axis=1)
        feet, (u, v) = -planes.source[:, 3:] * planes.source[:, :3], basis(planes.source[:, :3])
        middle = lines.source.reshape(-1, 3).mean(axis=0)
        near = (
            middle
            - np.sum((middle - feet) * planes.source[:, :3], axis=1, keepdims=True) * planes.source[:, :3]
        )
        corners = near[:, None] + 250 * np.stack([u, v, -u - v], axis=1)
        count = len(lines)
        return cls(
            np.concatenate([lines.source.reshape(-1, 3), corners.reshape(-1, 3)]),
            np.concatenate([np.repeat(at_lines, 2, axis=0), np.repeat(at_planes, 3, axis=0)]),
            np.concatenate(
                [
                    np.repeat(lines.target[:, 0], 2, axis=0),
                    np.repeat(-planes.target[:, 3:] * normals, 3, axis=0),
                ]
            ),
            np.concatenate([np.repeat(np.arange(count), 2), count + np.repeat(np.arange(len(planes)), 3)]),
            (lines.source, lines.target),
            (np.concatenate([along[0], planes.source[:, :3]]), np.concatenate([along[1], normals])),
        )

    def away(self, matrix: Array) -> Array:
        """(N, R): distances of the moved points."""
        moved = self.points @ matrix[:3, :3].T + matrix[:3, 3] - self.places
        return np.asarray(np.einsum("nrk,nk->nr", self.normals, moved))

    def squares(self, matrix: Array) -> Array:
        """(C,): mean squared distance of each correspondence's points."""
        square = np.sum(self.away(matrix) ** 2, axis=1)
        return np.asarray(np.bincount(self.of, square) / np.bincount(self.of))


def unit(vectors: Array) -> Array:
    """Of length one."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def basis(directions: Array) -> tuple[Array, Array]:
    """Two unit vectors at right angles to each direction and each other."""
    first = unit(np.cross(directions, np.eye(3)[np.argmin(np.abs(directions), axis=1)]))
    return first, np.cross(directions, first)


def matrix_of(scale: float, rotation: Array, translation: Array) -> Array:
    """(4, 4)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = scale * rotation, translation
    return out


def truncated(
    solve: Callable[[Array], Array], squares: Callable[[Array], Array], count: int, bound: float
) -> tuple[Array, Array]:
    """Truncated least squares by graduated non-convexity (Yang, Antonante, Tzoumas and Carlone 2020)."""
    weights = np.ones(count)
    found = solve(weights)
    limit = bound**2
    hard = limit / max(2 * squares(found).max() - limit, 1e-300)
    for _ in range(100):
        square = squares(found)
        weights = np.clip(np.sqrt(limit * hard * (hard + 1) / np.maximum(square, 1e-300)) - hard, 0, 1)
        found = solve(weights)
        if np.all((weights == 0) | (weights == 1)):
            break
        hard *= 1.4
    return found, weights


def rotation_of(source: Array, target: Array) -> tuple[Array, Array]:
    """Directions know nothing of translation and scale: the rotation alone, and weights."""

    def solve(weights: Array) -> Array:
        u, _, v = np.linalg.svd((weights[:, None] * target).T @ source)
        return np.asarray(u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v)

    return truncated(
        solve, lambda turn: np.sum((target - source @ turn.T) ** 2, axis=1), len(source), DIRECTION_BOUND
    )


def distances(lines: Array, pairs: tuple[Array, Array]) -> tuple[Array, Array]:
    """Between the lines of each pair, and the sine of their angle: no rotation or translation changes either."""
    along = unit(lines[:, 1] - lines[:, 0])
    normal = np.cross(along[pairs[0]], along[pairs[1]])
    sine = np.linalg.norm(normal, axis=1)
    between = lines[pairs[0], 0] - lines[pairs[1], 0]
    return np.abs(np.sum(between * normal, axis=1)) / np.maximum(sine, 1e-12), sine


def scale_of(scene: Scene, sound: NDArray[np.bool_], bound_mm: float) -> float:
    """Distances between lines, which most pairs agree on: adaptive voting, as TEASER's."""
    source, target = (side[sound[: len(side)]] for side in scene.lines)
    pairs = np.triu_indices(len(source), 1)
    here, sine = distances(source, pairs)
    there, _ = distances(target, pairs)
    usable = (sine > LEAST_SINE) & (here > 0.05 * here.max())
    ratio, width = there[usable] / here[usable], bound_mm / here[usable]
    ends = np.concatenate([ratio - width, ratio + width])
    order = np.argsort(ends)
    step = np.repeat([1, -1], len(ratio))[order]
    best = ends[order][np.argmax(np.cumsum(step))]
    near = np.abs(ratio - best) <= width
    return float(np.sum(ratio[near] / width[near] ** 2) / np.sum(1 / width[near] ** 2))


def teaser_like(scene: Scene, bound_mm: float) -> Array:
    """Rotation, then scale, then translation, each by truncated least squares (Yang, Shi and Carlone 2021)."""
    rotation, weights = rotation_of(*scene.directions)
    scale = scale_of(scene, weights > 0.5, bound_mm)
    start = matrix_of(scale, rotation, np.zeros(3))
    gaps = scene.away(start)

    def solve(weights: Array) -> Array:
        weighted = weights[scene.of][:, None, None] * scene.normals
        normal = np.einsum("nri,nrj->ij", weighted, scene.normals)
        right = -np.einsum("nri,nr->i", weighted, gaps)
        return np.linalg.lstsq(normal, right, rcond=None)[0]  # where nothing agrees, zero

    def squares(translation: Array) -> Array:
        return scene.squares(matrix_of(scale, rotation, translation))

    translation, _ = truncated(solve, squares, len(np.bincount(scene.of)), bound_mm)
    return matrix_of(scale, rotation, translation)


def of_two_lines(source: Array, target: Array) -> Array | None:
    """Directions give the rotation, distances the scale, the perpendiculars' middles the translation."""
    frames, middles, lengths = [], [], []
    for lines in (source, target):
        a, b = unit(lines[:, 1] - lines[:, 0])
        normal, between = np.cross(a, b), lines[1, 0] - lines[0, 0]
        square = normal @ normal
        if square < 1e-8:
            return None
        along = np.cross(between, b) @ normal / square, np.cross(between, a) @ normal / square
        middles.append(0.5 * (lines[0, 0] + along[0] * a + lines[1, 0] + along[1] * b))
        lengths.append(between @ normal / np.sqrt(square))
        frames.append(np.column_stack([unit(a + b), unit(a - b), unit(np.cross(a + b, a - b))]))
    scale = lengths[1] / lengths[0]
    if not scale > 0:
        return None
    rotation = frames[1] @ frames[0].T
    return matrix_of(scale, rotation, middles[1] - scale * rotation @ middles[0])


def refined(scene: Scene, start: Array, sound: NDArray[np.bool_]) -> Array:
    """SciPy's Levenberg-Marquardt over the correspondences that are sound."""
    chosen = sound[scene.of]
    part = dataclasses.replace(
        scene, points=scene.points[chosen], normals=scene.normals[chosen], places=scene.places[chosen]
    )
    scale = np.cbrt(np.linalg.det(start[:3, :3]))
    turn = Rotation.from_matrix(start[:3, :3] / scale).as_rotvec()

    def matrix(v: Array) -> Array:
        return matrix_of(float(np.exp(v[6])), Rotation.from_rotvec(v[:3]).as_matrix(), v[3:6])

    found = least_squares(
        lambda v: part.away(matrix(v)).ravel(),
        np.r_[turn, start[:3, 3], np.log(scale)],
        method="lm",
        x_scale="jac",
    )
    return matrix(found.x)


def ransac(scene: Scene, bound_mm: float, seed: int) -> Array:
    """Two lines a sample, until one without outliers has been drawn; then least squares on what agrees."""
    random = np.random.default_rng(seed)
    count, best, found = len(scene.lines[0]), np.inf, np.eye(4)
    needed, tried = MOST_SAMPLES, 0
    while tried < needed:
        tried += 1
        pair = random.choice(count, 2, replace=False)
        matrix = of_two_lines(scene.lines[0][pair], scene.lines[1][pair])
        if matrix is None:
            continue
        square = scene.squares(matrix)
        score = np.sum(np.minimum(square, bound_mm**2))
        if score < best:
            best, found = score, matrix
            clean = np.mean(square[:count] <= bound_mm**2) ** 2
            needed = min(
                MOST_SAMPLES, int(np.log(1 - CONFIDENCE) / np.log1p(-min(max(clean, 1e-9), 1 - 1e-9))) + 1
            )
    for _ in range(3):
        found = refined(scene, found, scene.squares(found) <= bound_mm**2)
    return found
