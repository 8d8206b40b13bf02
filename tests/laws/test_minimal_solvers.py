"""What every minimal solver keeps to, stated once and run on all of them."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.builders.minimal_problems import (
    ALL,
    Problem,
    Solver,
    make,
    misses,
    rotations,
)

BATCH = 64
ROUNDING = 1e-6

every_solver = pytest.mark.parametrize("solver", ALL, ids=lambda s: s.name)
seeds = st.integers(0, 2**32 - 1)


def assert_solved(solver: Solver, problem: Problem) -> None:
    """A random problem in ten thousand is nearly degenerate, and loses digits to that."""
    missed = misses(problem, solver.solve(problem))
    assert np.median(missed) < 1e-9
    assert np.count_nonzero(missed > ROUNDING) <= 1


def reordered(problem: Problem, order: tuple[int, ...]) -> Problem:
    rows = list(order)
    return replace(
        problem,
        points=np.ascontiguousarray(problem.points[:, rows]),
        segments=np.ascontiguousarray(problem.segments[:, rows]),
    )


@every_solver
@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_the_truth_is_among_the_solutions(solver, seed):
    assert_solved(solver, make(solver.planar, BATCH, seed))


@every_solver
@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_every_solution_is_a_similarity_and_the_rest_is_nan(solver, seed):
    problem = make(solver.planar, BATCH, seed)
    solutions = solver.solve(problem)
    there = np.arange(solutions.matrices.shape[1]) < solutions.count[:, None]
    assert np.isnan(solutions.matrices[~there]).all()
    found = solutions.matrices[there]
    scale = np.cbrt(np.linalg.det(found[:, :3, :3]))
    assert (scale > 0).all()
    rotation = found[:, :3, :3] / scale[:, None, None]
    assert np.abs(np.swapaxes(rotation, 1, 2) @ rotation - np.eye(3)).max() < 1e-12
    assert np.array_equal(found[:, 3], np.broadcast_to([0, 0, 0, 1.0], (len(found), 4)))


def keeps_lines(solver, order):
    """Solvers of two lines are given each line's two points side by side."""
    return "two_lines" not in solver.name or set(order[:2]) in ({0, 1}, {2, 3})


@every_solver
def test_the_points_order_has_no_effect(solver):
    for order in permutations(range(4)):
        if keeps_lines(solver, order):
            assert_solved(solver, reordered(make(solver.planar, BATCH, seed=3), order))


@every_solver
def test_a_needle_has_no_direction(solver):
    problem = make(solver.planar, BATCH, seed=4)
    for line in range(4):
        segments = problem.segments.copy()
        turned = [line] if solver.planar else [line // 2 * 2, line // 2 * 2 + 1]
        segments[:, turned] = segments[:, turned, ::-1]
        assert_solved(solver, replace(problem, segments=segments))


@every_solver
@pytest.mark.parametrize("unit", [1e-4, 1e-2, 1e2, 1e4])
def test_the_unit_of_length_has_no_effect(solver, unit):
    mover = np.diag([unit, unit, unit, 1.0])
    assert_solved(solver, make(solver.planar, BATCH, seed=5).moved(mover))


@every_solver
@pytest.mark.parametrize("scale", [1e-4, 1e-2, 1.0, 1e2, 1e4])
def test_scales_over_eight_decades_are_found(solver, scale):
    assert_solved(solver, make(solver.planar, BATCH, seed=6, scale=scale))


@every_solver
@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_moving_the_probe_marker_moves_the_solutions_with_it(solver, seed):
    random = np.random.default_rng(seed)
    mover = np.eye(4)
    mover[:3, :3] = rotations(random, 1)[0]
    mover[:3, 3] = random.uniform(-1000, 1000, 3)
    assert_solved(solver, make(solver.planar, BATCH, seed).moved(mover))


@every_solver
def test_an_image_origin_far_away_costs_digits_but_no_solution(solver):
    assert_solved(solver, make(solver.planar, BATCH, seed=7, offset_px=1e4))


@every_solver
@pytest.mark.parametrize("axis", range(3))
def test_round_rotations_are_found(solver, axis):
    for quarter_turns in range(4):
        problem = make(solver.planar, BATCH, seed=8)
        angle = quarter_turns * np.pi / 2
        turn = np.eye(4)
        turn[:3, :3] = np.roll(
            np.roll(
                [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]], axis, 0
            ),
            axis,
            1,
        )
        truth = problem.truth.copy()
        truth[:, :3, :3] = 0.24 * turn[:3, :3]
        assert_solved(solver, _with_truth(problem, truth))


def _with_truth(problem: Problem, truth: np.ndarray) -> Problem:
    """The same image and lines' shapes under another similarity."""
    mover = truth @ np.linalg.inv(problem.truth)
    ends = np.concatenate([problem.segments.reshape(BATCH, -1, 3), np.ones((BATCH, 8, 1))], axis=-1)
    segments = (ends @ np.swapaxes(mover, 1, 2))[..., :3].reshape(problem.segments.shape)
    return replace(problem, segments=np.ascontiguousarray(segments), truth=truth)


@every_solver
def test_a_needle_through_the_markers_origin_is_no_special_case(solver):
    problem = make(solver.planar, BATCH, seed=9)
    for line in range(4):
        mover = np.tile(np.eye(4), (BATCH, 1, 1))
        mover[:, :3, 3] = -0.5 * (problem.segments[:, line, 0] + problem.segments[:, line, 1])
        segments = problem.segments + mover[:, None, None, :3, 3]
        assert_solved(solver, replace(problem, segments=segments, truth=mover @ problem.truth))


@pytest.mark.parametrize("solver", [s for s in ALL if s.planar], ids=lambda s: s.name)
def test_needles_that_tilt_in_one_plane_only_are_enough(solver):
    problem = make(planar=True, batch=BATCH, seed=10)
    on_line = problem.points @ np.swapaxes(problem.truth[:, :3, :3], 1, 2) + problem.truth[:, None, :3, 3]
    angles = np.random.default_rng(0).uniform(0, np.pi, (BATCH, 4))
    directions = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    segments = np.stack([on_line - 100 * directions, on_line + 100 * directions], axis=2)
    assert_solved(solver, replace(problem, segments=segments))


@every_solver
@pytest.mark.parametrize("batch", [0, 1, 7, 20_000])
def test_batches_of_any_size_are_solved(solver, batch):
    problem = make(solver.planar, batch, seed=11)
    solutions = solver.solve(problem)
    assert solutions.matrices.shape[0] == len(solutions.count) == batch
    assert np.count_nonzero(misses(problem, solutions) > ROUNDING) <= batch * 1e-4


@every_solver
@pytest.mark.parametrize("spoilt", [0, 5, 16])
def test_a_nan_spoils_its_own_problem_alone(solver, spoilt):
    problem = make(solver.planar, 17, seed=12)
    whole = solver.solve(problem)
    segments = problem.segments.copy()
    segments[spoilt, 0, 0, 0] = np.nan
    if not solver.planar:
        segments[spoilt, 1] = segments[spoilt, 0]
    broken = solver.solve(replace(problem, segments=segments))
    others = np.arange(17) != spoilt
    assert broken.count[spoilt] == 0
    assert np.isnan(broken.matrices[spoilt]).all()
    np.testing.assert_array_equal(broken.count[others], whole.count[others])
    np.testing.assert_array_equal(broken.matrices[others], whole.matrices[others])
