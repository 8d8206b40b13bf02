"""What a caller of one solver sees: shapes, sentences, options."""

import numpy as np
import pytest

from sonocal.errors import DegenerateGeometryError, InputError
from sonocal.geometry import Similarity
from sonocal.registration import constraints, solvers

TRUTH = Similarity.from_rotvec([0.3, -1.2, 0.8], [12.0, -40.0, 75.0], 0.24)


def planar(count: int = 4, seed: int = 0):
    random = np.random.default_rng(seed)
    points = random.uniform(0, 500, (count, 2))
    directions = random.normal(size=(count, 3))
    on_line = TRUTH.apply(points)
    return points, np.stack([on_line - 20 * directions, on_line + 30 * directions], axis=1)


def spatial(count: int = 2, seed: int = 0):
    image = np.random.default_rng(seed).uniform(0, 500, (count, 2, 3))
    return image, TRUTH.apply(image)


def holds_truth(solutions, tolerance=1e-7):
    return np.abs(solutions.matrices - TRUTH.matrix).max(axis=(-2, -1))[: solutions.count].min() < tolerance


def test_one_problem_gives_one_answer_without_a_batch_axis():
    solutions = solvers.four_points(*planar())
    assert solutions.matrices.shape == (4, 4, 4)
    assert isinstance(solutions.count, int)
    assert holds_truth(solutions)


def test_leading_axes_are_kept():
    points, segments = planar()
    solutions = solvers.four_points(np.tile(points, (2, 3, 1, 1)), np.tile(segments, (2, 3, 1, 1, 1)))
    assert solutions.matrices.shape == (2, 3, 4, 4, 4)
    assert solutions.count.shape == (2, 3)


def test_lists_and_strided_arrays_are_taken_too():
    points, segments = planar()
    assert holds_truth(solvers.four_points(points.tolist(), np.asfortranarray(segments)))


@pytest.mark.parametrize("threads", [2, 3, 16])
def test_threads_change_nothing(threads):
    random = np.random.default_rng(1)
    points, segments = random.uniform(0, 500, (1000, 4, 2)), random.uniform(-200, 200, (1000, 4, 2, 3))
    for steps in (0, 2):
        one = solvers.four_points(points, segments, steps=steps)
        many = solvers.four_points(points, segments, steps=steps, threads=threads)
        np.testing.assert_array_equal(one.matrices, many.matrices)
        np.testing.assert_array_equal(one.count, many.count)


def test_shapes_that_do_not_fit_are_named():
    with pytest.raises(
        InputError, match=r"expected points_px \(..., 4, 2\) and .* got \(5, 2\) and \(5, 2, 3\)"
    ):
        solvers.four_points(*planar(5))


def test_a_value_that_is_not_finite_is_refused():
    points, segments = planar()
    points[1, 0] = np.nan
    with pytest.raises(InputError, match="the points must be finite"):
        solvers.four_points(points, segments)


def test_parallel_lines_are_refused_alone_and_counted_zero_in_a_batch():
    points, segments = planar()
    segments[:, 1] = segments[:, 0] + [0, 0, 50]
    with pytest.raises(
        DegenerateGeometryError, match=r"leave translation along \(0, 0, -?1\) free"
    ) as raised:
        solvers.four_points(points, segments)
    assert raised.value.code == "parallel-lines"
    assert solvers.four_points(points[None], segments[None]).count.tolist() == [0]


def test_lines_that_meet_leave_the_scale_free():
    image, needles = spatial()
    needles[:, 0] = [1.0, 2.0, 3.0]
    with pytest.raises(DegenerateGeometryError, match=r"growth about the point \(1, 2, 3\)"):
        solvers.two_lines(image, needles)


def test_noise_never_leaves_a_refined_sample_without_a_solution():
    random = np.random.default_rng(2)
    points, segments = map(np.stack, zip(*(planar(seed=s) for s in range(500)), strict=True))
    points = points + random.normal(size=points.shape)
    segments = segments + random.normal(size=segments.shape)
    assert (solvers.four_points(points, segments).count == 0).any()
    assert (solvers.four_points(points, segments, steps=2).count > 0).all()


@pytest.mark.parametrize(
    "solve", [lambda **k: solvers.four_points(*planar(), **k), lambda **k: solvers.two_lines(*spatial(), **k)]
)
def test_a_known_scale_is_kept(solve):
    solutions = solve(steps=5, scale=0.25)
    found = solutions.matrices[: solutions.count, :3, :3]
    np.testing.assert_allclose(np.cbrt(np.linalg.det(found)), 0.25, rtol=1e-12)
    assert holds_truth(solve(steps=5, scale=0.24))


def test_a_known_scale_needs_steps():
    with pytest.raises(InputError, match="give steps=2 or more"):
        solvers.two_lines(*spatial(), scale=0.24)


def test_the_papers_planar_solver_finds_the_truth_as_ours_does():
    # Which of the eight equations goes differs, and with it the solutions other than the truth.
    problems = [planar(seed=seed) for seed in range(100)]
    for solve in (solvers.four_points, solvers.paper_four_points):
        assert sum(holds_truth(solve(*problem), 1e-5) for problem in problems) >= 99


def test_the_papers_general_solver_has_both_solutions_of_two_lines():
    found = 0
    for seed in range(200):
        image, needles = spatial(seed=seed)
        ours = solvers.two_lines(image, needles).matrices
        papers = solvers.paper_two_lines(image.reshape(4, 3), np.repeat(needles, 2, axis=0)).matrices
        apart = np.abs(ours[:, None] - papers[None]).max(axis=(2, 3))
        found += np.all(np.nanmin(apart, axis=1) < 1e-5)
    assert found >= 199


def test_real_solutions_of_the_papers_solvers_that_meet_all_equations_are_ours():
    for seed in range(100):
        image, needles = spatial(seed=seed)
        ours = solvers.two_lines(image, needles).matrices
        points, segments = image.reshape(4, 3), np.repeat(needles, 2, axis=0)
        rows = constraints.point_line(points, segments)
        for matrix in solvers.paper_two_lines(points, segments).matrices:
            mapped = rows.points @ matrix[:3, :3].T + matrix[:3, 3]
            left = np.einsum("ij,ij->i", rows.planes[:, :3], mapped) + rows.planes[:, 3]
            if np.abs(left).max() < 1e-9:
                assert np.abs(ours - matrix).max(axis=(1, 2)).min() < 1e-4


def test_the_papers_general_solver_finds_coplanar_points_at_z_k():
    found = 0
    for seed in range(50):
        points, segments = planar(seed=seed)
        lifted = np.column_stack([points, np.full(4, 500.0)])
        solutions = solvers.paper_two_lines(lifted, segments)
        matrices = solutions.matrices.copy()
        matrices[..., :3, 3] += 500.0 * matrices[..., :3, 2]
        found += holds_truth(solvers.Solutions(matrices, solutions.count), 1e-5)
    assert found >= 48


@pytest.mark.parametrize("count", [3, 10, 1000])
def test_linear_lines_are_exact_without_noise(count):
    constraint = constraints.line_line(*spatial(count))
    assert holds_truth(solvers.linear_lines(constraint.points, constraint.planes))


@pytest.mark.parametrize("count", [5, 10, 1000])
def test_linear_points_are_exact_without_noise(count):
    points, segments = planar(count)
    planes = constraints.planes_of_lines(segments).reshape(-1, 4)
    assert holds_truth(solvers.linear_points(np.repeat(points, 2, axis=0), planes))


def test_linear_lines_refuse_coplanar_points():
    points, segments = planar(20)
    constraint = constraints.point_line(np.column_stack([points, np.zeros(20)]), segments)
    with pytest.raises(DegenerateGeometryError):
        solvers.linear_lines(constraint.points, constraint.planes)


def test_planes_on_planes_hold_the_rotation_and_three_of_them_the_similarity_up_to_growth():
    random = np.random.default_rng(4)
    normals = random.normal(size=(4, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    offsets = random.uniform(-300, 300, (4, 1))
    moved = normals @ TRUTH.rotation.T
    target = np.hstack([moved, TRUTH.scale * offsets - moved @ TRUTH.translation[:, None]])
    source = np.hstack([normals, offsets])
    three, four = (constraints.plane_plane(source[:k], target[:k], size=100.0) for k in (3, 4))
    free = constraints.rank(three, TRUTH)
    assert free.rank == 6
    assert "growth" in free.motions[0]
    assert constraints.rank(four, TRUTH).rank == 7
    assert holds_truth(solvers.linear_lines(four.points, four.planes))
