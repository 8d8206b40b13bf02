"""Minimal samples of every kind of correspondence, of images and of volumes, with the scale unknown and known."""

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal.errors import DegenerateGeometryError
from sonocal.geometry import Similarity
from sonocal.registration import solvers
from tests.builders.correspondences import correspondences, planes_through, truth

SEEDS = st.integers(0, 2**32 - 1)
BATCH = 32
SIDE, KNOWN = 500.0, 0.4


@dataclass(frozen=True)
class Sample:
    """Rows of minimal problems (B, N, 3), (B, N, 4), and the similarity of each."""

    points: np.ndarray
    planes: np.ndarray
    truths: list[Similarity]

    def misses(self, solutions: solvers.Solutions) -> np.ndarray:
        """(B,): how far the best solution carries the points from the truth, in parts of the image's size."""
        found = solutions.matrices
        mapped = self.points[:, None] @ np.swapaxes(found[..., :3, :3], -1, -2) + found[..., None, :3, 3]
        wanted = np.stack([one @ x for one, x in zip(self.truths, self.points, strict=True)])
        off = np.linalg.norm(mapped - wanted[:, None], axis=-1).max(axis=-1)
        off = np.where(np.isnan(off), np.inf, off).min(axis=1)
        return off / (SIDE * np.array([one.scale for one in self.truths]))


@dataclass(frozen=True)
class Case:
    """A solver on samples of a kind."""

    name: str
    kind: str
    known: bool
    planar: bool

    def sample(self, seed: int) -> Sample:
        rows, scale = (6, KNOWN) if self.known else (7, None)
        made = [
            one_problem(self.kind, self.planar, rows, np.random.default_rng([seed, b]), scale)
            for b in range(BATCH)
        ]
        points, planes, truths = zip(*made, strict=True)
        return Sample(np.stack(points), np.stack(planes), list(truths))

    def solve(self, points: np.ndarray, planes: np.ndarray, scale: float = KNOWN) -> solvers.Solutions:
        if self.known:
            return solvers.three_quadrics(points, planes, scale=scale)
        if self.planar:
            return solvers.two_conics(np.ascontiguousarray(points[..., :2]), planes)
        return solvers.three_quadrics(points, planes)


COUNTS = {
    "point_plane": 7,
    "point_line": 4,
    "point_point": 3,
    "line_plane": 4,
    "line_line": 2,
    "plane_plane": 4,
}
CASES = [
    Case(
        f"{kind}, {'image' if planar else 'volume'}, scale {'known' if known else 'unknown'}",
        kind,
        known,
        planar,
    )
    for planar, kinds in (
        (True, ("point_plane", "point_line", "point_point", "line_plane")),
        (False, tuple(COUNTS)),
    )
    for kind in kinds
    for known in (False, True)
]
every_case = pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)


def one_problem(kind, planar, count, random, scale):
    """One correspondence's row after the other's, in turn, each beginning with another of its own."""
    true = truth(random)
    true = Similarity(true.rotation, true.translation, scale or true.scale)
    if planar:
        points, planes, each = image_rows(kind, true, random)
    else:
        rows = correspondences(kind, COUNTS[kind], true, random)
        points, planes, each = rows.points, rows.planes, np.diff(rows.first)
    first = np.concatenate([[0], np.cumsum(each)])
    order = [
        first[c] + (turn + c) % each[c]
        for turn in range(max(each))
        for c in range(len(each))
        if turn < each[c]
    ][:count]
    return points[order], planes[order], true


def image_rows(kind, true, random):
    """Points, planes, and rows of each correspondence of an image."""
    count = COUNTS[kind]
    each = {"point_plane": 1, "point_line": 2, "point_point": 3, "line_plane": 2}[kind]
    ends = random.uniform(0, SIDE, (count, 2, 3)) * [1, 1, 0]
    if kind == "line_plane":
        there = true @ ends.reshape(-1, 3)
        planes = planes_through(there[::2], random, along=there[1::2] - there[::2])
        return ends.reshape(-1, 3), np.repeat(planes, 2, axis=0), np.full(count, each)
    points = np.repeat(ends[:, 0], each, axis=0)
    if kind == "point_point":
        normals = np.tile(np.eye(3), (count, 1))
        return (
            points,
            np.column_stack([normals, -np.sum(normals * (true @ points), axis=1)]),
            np.full(count, each),
        )
    return points, planes_through(true @ points, random), np.full(count, each)


@every_case
@given(seed=SEEDS)
@settings(max_examples=10, deadline=None)
def test_without_noise_the_truth_is_among_the_solutions(case, seed):
    sample = case.sample(seed)
    missed = sample.misses(case.solve(sample.points, sample.planes))
    assert np.median(missed) < 1e-9
    assert np.count_nonzero(missed > 1e-6) <= 1  # one in a thousand is nearly degenerate


@every_case
@given(seed=SEEDS)
@settings(max_examples=5, deadline=None)
def test_each_solution_solves_its_rows_and_has_the_scale_that_is_known(case, seed):
    sample = case.sample(seed)
    solutions = case.solve(sample.points, sample.planes)
    for b in range(BATCH):
        for matrix in solutions.matrices[b, : solutions.count[b]]:
            one = Similarity.from_matrix(matrix)
            left = (
                np.einsum("ij,ij->i", one @ sample.points[b], sample.planes[b, :, :3])
                + sample.planes[b, :, 3]
            )
            size = np.ptp(one @ sample.points[b], axis=0).max() + np.abs(sample.planes[b, :, 3]).max()
            assert np.abs(left).max() < 1e-6 * size
            assert not case.known or one.scale == pytest.approx(KNOWN, rel=1e-9)


@every_case
def test_a_batch_gives_what_its_problems_give_alone(case):
    sample = case.sample(1)
    together = case.solve(sample.points, sample.planes)
    for b in range(BATCH):
        alone = case.solve(sample.points[b : b + 1], sample.planes[b : b + 1])
        assert alone.count[0] == together.count[b]
        np.testing.assert_allclose(
            by_size(alone.matrices[0]), by_size(together.matrices[b]), rtol=1e-6, atol=1e-6, equal_nan=True
        )


def by_size(matrices):
    return matrices[np.argsort(matrices[:, 0, 0] + 0.37 * matrices[:, 1, 1] + 0.11 * matrices[:, 2, 0])]


@every_case
@given(seed=SEEDS)
@settings(max_examples=5, deadline=None)
def test_solutions_move_with_either_side(case, seed):
    random = np.random.default_rng(seed)
    sample, grown = case.sample(seed % 1000), float(np.exp(random.uniform(-3, 3)))
    source = Similarity(in_plane(random) if case.planar else Rotation.random(random_state=random).as_matrix(),
                        random.uniform(-300, 300, 3) * [1, 1, 0 if case.planar else 1], grown)  # fmt: skip
    target = Similarity(
        Rotation.random(random_state=random).as_matrix(), random.uniform(-500, 500, 3), 1 / grown
    )
    points = np.stack([source @ x for x in sample.points])
    if case.planar:
        points[..., 2] = 0
    planes = np.stack([moved_planes(target, p) for p in sample.planes])
    back = [target @ one @ source.inverse() for one in sample.truths]
    moved = Sample(points, planes, back)
    missed = moved.misses(case.solve(points, planes, KNOWN / grown**2)) / grown
    assert np.count_nonzero(missed > 1e-6) <= 1


def in_plane(random):
    return Rotation.from_rotvec([0, 0, random.uniform(-3, 3)]).as_matrix()


def moved_planes(target, planes):
    normals = planes[:, :3] @ target.rotation.T
    return np.column_stack([normals, target.scale * planes[:, 3] - normals @ target.translation])


@every_case
def test_no_solution_is_missed_that_newton_finds_from_anywhere(case):
    found = missing = 0
    sample = case.sample(3)
    solutions = case.solve(sample.points, sample.planes)
    for b in range(12):
        ours = solutions.matrices[b, : solutions.count[b]]
        for one in newton(sample.points[b], sample.planes[b], KNOWN if case.known else None):
            found += 1
            apart = np.abs(
                ours[:, :3, :3] / np.cbrt(np.linalg.det(one[:3, :3]))
                - one[:3, :3] / np.cbrt(np.linalg.det(one[:3, :3]))
            )
            missing += not np.any(apart.max(axis=(1, 2), initial=0) < 1e-4) if len(ours) else 1
    assert found >= 12
    assert missing == 0


def newton(points, planes, scale, starts=200, steps=25):
    """Similarities (K, 4, 4) that solve all rows: Newton on turn, shift and growth from rotations everywhere."""
    random = np.random.default_rng(0)
    centre, size = points.mean(axis=0), np.linalg.norm(points - points.mean(axis=0), axis=1).max()
    x, n = (points - centre) / size, planes[:, :3]
    middle = np.linalg.lstsq(n, -planes[:, 3], rcond=None)[0]
    d = (planes[:, 3] + n @ middle) / size
    r = Rotation.random(starts, random_state=random).as_matrix()
    s = np.full(starts, scale) if scale else np.exp(random.uniform(-3, 1, starts))
    t = np.zeros((starts, 3))
    for _ in range(steps):
        arms = s[:, None, None] * np.einsum("kij,nj->kni", r, x)
        left = np.einsum("nj,knj->kn", n, arms + t[:, None]) + d
        j = np.concatenate([np.cross(arms, n), np.broadcast_to(n, arms.shape)], axis=2)
        if not scale:
            j = np.concatenate([j, np.einsum("nj,knj->kn", n, arms)[..., None]], axis=2)
        step = -np.linalg.solve(j, left[..., None])[..., 0]
        step *= np.minimum(1, 0.5 / np.maximum(np.linalg.norm(step[:, :3], axis=1), 1e-30))[:, None]
        r = Rotation.from_rotvec(step[:, :3]).as_matrix() @ r
        t = t + step[:, 3:6]
        if not scale:
            s = s * np.exp(np.clip(step[:, 6], -1, 1))
    left = np.einsum("nj,knj->kn", n, s[:, None, None] * np.einsum("kij,nj->kni", r, x) + t[:, None]) + d
    solved = (np.abs(left).max(axis=1) < 1e-12) & (np.linalg.norm(step, axis=1) < 1e-9) & (s > 1e-3)
    kept: list[np.ndarray] = []
    for a, b in zip(s[solved, None, None] * r[solved], t[solved], strict=True):
        matrix = np.eye(4)
        matrix[:3, :3] = a
        matrix[:3, 3] = middle + size * b - a @ centre
        if all(np.abs(a - one[:3, :3]).max() > 1e-6 for one in kept):
            kept.append(matrix)
    return kept


def nearest(points, places, scale=None):
    """Least squares of points on places by a singular value decomposition, (4, 4)."""
    x, y = points - points.mean(axis=0), places - places.mean(axis=0)
    u, values, v = np.linalg.svd(y.T @ x)
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ v))])
    out = np.eye(4)
    out[:3, :3] = (scale or np.sum(signs * values) / np.sum(x**2)) * (u * signs) @ v
    out[:3, 3] = places.mean(axis=0) - out[:3, :3] @ points.mean(axis=0)
    return out


@pytest.mark.parametrize("scale", [None, KNOWN])
@pytest.mark.parametrize("planar", [False, True])
@given(seed=SEEDS)
@settings(max_examples=20, deadline=None)
def test_three_points_are_carried_as_near_as_can_be(scale, planar, seed):
    random = np.random.default_rng(seed)
    points = random.uniform(0, SIDE, (BATCH, 3, 3)) * [1, 1, not planar]
    places = np.stack([truth(random) @ x for x in points]) + random.normal(
        size=points.shape
    ) * random.uniform(0, 50)
    solutions = solvers.three_points(points, places, scale=scale)
    assert np.array_equal(solutions.count, np.ones(BATCH))
    for b in range(BATCH):
        wanted = nearest(points[b], places[b], scale)
        np.testing.assert_allclose(
            solutions.matrices[b, 0], wanted, rtol=1e-6, atol=1e-6 * np.abs(wanted).max()
        )
        alone = solvers.three_points(points[b], places[b], scale=scale)
        np.testing.assert_array_equal(alone.matrices[0], solutions.matrices[b, 0])


def test_three_points_on_a_line_are_refused_alone_and_counted_zero_in_a_batch():
    points = np.outer([1.0, 2.0, 4.0], [3.0, 1.0, 0.5])
    places = np.random.default_rng(0).uniform(0, 100, (3, 3))
    with pytest.raises(DegenerateGeometryError, match="rotation about the points' line"):
        solvers.three_points(points, places)
    assert solvers.three_points(points[None], places[None]).count.tolist() == [0]


@pytest.mark.parametrize("planar", [False, True])
def test_planes_through_one_point_determine_all_that_a_known_scale_leaves(planar):
    case = Case("", "point_plane", known=True, planar=planar)
    sample = case.sample(5)
    carried = np.stack([one @ x for one, x in zip(sample.truths, sample.points, strict=True)])
    normals = np.cross(carried, np.roll(carried, 1, axis=1))
    planes = np.concatenate(
        [normals / np.linalg.norm(normals, axis=-1, keepdims=True), 0 * normals[..., :1]], axis=-1
    )
    missed = sample.misses(case.solve(sample.points, planes))
    assert np.count_nonzero(missed > 1e-6) <= 1
    assert solvers.three_quadrics(sample.points[0], planes[0], scale=KNOWN).count > 0
