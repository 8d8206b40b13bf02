"""Noise-free minimal problems with their truth, and the solvers that every law runs on."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sonocal.registration import constraints, solvers

IMAGE_SIZE = 500.0


@dataclass(frozen=True)
class Problem:
    """Four image points (B, 4, 3), a line for each (B, 4, 2, 3), and the similarity (B, 4, 4) between them."""

    points: np.ndarray
    segments: np.ndarray
    truth: np.ndarray

    def rows(self, count: int = 7) -> tuple[np.ndarray, np.ndarray]:
        """So many of the eight point-plane rows."""
        planes = constraints.planes_of_lines(self.segments).reshape(-1, 8, 4)
        points = np.repeat(self.points, 2, axis=1)
        return np.ascontiguousarray(points[:, :count]), np.ascontiguousarray(planes[:, :count])

    @property
    def scale(self) -> float:
        """Of all problems, mm per px."""
        return float(np.cbrt(np.linalg.det(self.truth[0, :3, :3]))) if len(self.truth) else 1.0

    def moved(self, mover: np.ndarray) -> "Problem":
        """The target side carried by a 4 x 4 similarity."""
        return replace(self, segments=apply(mover, self.segments), truth=mover @ self.truth)


@dataclass(frozen=True)
class Solver:
    """A solver under test; `planar` says which problems are its own."""

    name: str
    planar: bool
    solve: Callable[[Problem], solvers.Solutions]


def lines_of(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Two lines each: points 0, 1 and 2, 3 share one."""
    return problem.points.reshape(-1, 2, 2, 3), np.ascontiguousarray(problem.segments[:, ::2])


def plane_of(problem: Problem) -> np.ndarray:
    return np.ascontiguousarray(problem.points[..., :2])


def flat_rows(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    points, planes = problem.rows()
    return np.ascontiguousarray(points[..., :2]), planes


def at_scale(problem: Problem) -> solvers.Solutions:
    return solvers.three_quadrics(*problem.rows(6), scale=problem.scale)


ALL = [
    Solver("four_points", True, lambda p: solvers.four_points(plane_of(p), p.segments)),
    Solver("four_points, refined", True, lambda p: solvers.four_points(plane_of(p), p.segments, steps=3)),
    Solver("two_lines", False, lambda p: solvers.two_lines(*lines_of(p))),
    Solver("two_lines, refined", False, lambda p: solvers.two_lines(*lines_of(p), steps=2)),
    Solver("three_quadrics, planar", True, lambda p: solvers.three_quadrics(*p.rows())),
    Solver("three_quadrics, lines", False, lambda p: solvers.three_quadrics(*p.rows())),
    Solver("two_conics", True, lambda p: solvers.two_conics(*flat_rows(p))),
    Solver("two_conics, refined", True, lambda p: solvers.two_conics(*flat_rows(p), steps=3)),
    Solver("six rows, planar", True, at_scale),
    Solver("six rows, lines", False, at_scale),
]


def make(planar: bool, batch: int, seed: int, scale: float = 0.24, offset_px: float = 0.0) -> Problem:
    """Random problems of the paper's simulation: image of 500 px, needles of 400 mm at 0.24 mm per px."""
    random = np.random.default_rng(seed)
    offset = offset_px * np.array([1.0, 1.0, 0.0 if planar else 1.0])
    points = random.uniform(0, IMAGE_SIZE, (batch, 4, 3)) + offset
    if planar:
        points[..., 2] = 0
    truth = np.tile(np.eye(4), (batch, 1, 1))
    truth[:, :3, :3] = scale * rotations(random, batch)
    size = scale * IMAGE_SIZE
    truth[:, :3, 3] = random.uniform(-size, size, (batch, 3)) - truth[:, :3, :3] @ offset
    on_line = apply(truth, points)
    directions = random.normal(size=(batch, 4, 3))
    if not planar:
        directions = np.repeat((on_line[:, 1::2] - on_line[:, ::2]), 2, axis=1)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    first = on_line if planar else np.repeat(on_line[:, ::2], 2, axis=1)
    before = random.uniform(0, 3 * size, (batch, 4 if planar else 2, 1))
    before = before if planar else np.repeat(before, 2, axis=1)
    segments = np.stack([first - before * directions, first + (3.3 * size - before) * directions], axis=2)
    return Problem(points, segments, truth)


def rotations(random: np.random.Generator, count: int) -> np.ndarray:
    q, r = np.linalg.qr(random.normal(size=(count, 3, 3)))
    q = q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None]
    return q * np.linalg.det(q)[:, None, None]


def apply(matrices: np.ndarray, points: np.ndarray) -> np.ndarray:
    shaped = points.reshape(len(points), int(np.prod(points.shape[1:-1])), 3)
    mapped = shaped @ np.swapaxes(matrices[..., :3, :3], -1, -2) + matrices[..., None, :3, 3]
    return mapped.reshape(points.shape)


def misses(problem: Problem, solutions: solvers.Solutions) -> np.ndarray:
    """How far the best solution carries the image points from the truth, in parts of the image's size; (B,)."""
    size = np.cbrt(np.linalg.det(problem.truth[:, :3, :3])) * IMAGE_SIZE
    wanted = apply(problem.truth, problem.points)[:, None]
    matrices = solutions.matrices
    found = problem.points[:, None] @ np.swapaxes(matrices[..., :3, :3], -1, -2) + matrices[..., None, :3, 3]
    distance = np.linalg.norm(found - wanted, axis=-1).max(axis=-1)
    return np.where(np.isnan(distance), np.inf, distance).min(axis=1) / size
