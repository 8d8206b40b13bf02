"""Registration of any mix of points, lines and planes, as someone sees it who has never heard of ultrasound."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from sonocal import registration as reg
from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.geometry import Similarity
from tests.builders.correspondences import ENOUGH, correspondences, truth

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("kind", ENOUGH)
@given(seed=SEEDS)
@settings(max_examples=15)
def test_each_kind_alone_determines_the_similarity(kind, seed):
    random = np.random.default_rng(seed)
    true = truth(random)
    found = reg.register(correspondences(kind, ENOUGH[kind], true, random))
    np.testing.assert_allclose(found.target_from_source.matrix, true.matrix, atol=1e-5)
    assert found.inlier.all()
    assert len(found.residuals_mm) == ENOUGH[kind]


@given(seed=SEEDS, kinds=st.lists(st.sampled_from(sorted(ENOUGH)), min_size=2, max_size=5))
@settings(max_examples=30)
def test_any_mix_determines_it_in_any_order(seed, kinds):
    random = np.random.default_rng(seed)
    true = truth(random)
    parts = [correspondences(kind, 4, true, random) for kind in kinds]
    for ordered in (parts, parts[::-1]):
        found = reg.register(reg.rows(*ordered)).target_from_source
        np.testing.assert_allclose(found.matrix, true.matrix, atol=1e-5)


@given(seed=SEEDS)
@settings(max_examples=15)
def test_gross_outliers_are_left_out(seed):
    random = np.random.default_rng(seed)
    true = truth(random)
    sound = [
        correspondences(kind, 10, true, random, noise=0.1)
        for kind in ("point_plane", "line_plane", "point_point")
    ]
    wrong = correspondences("point_point", 8, truth(random), random)
    found = reg.register(reg.rows(*sound, wrong), threshold_mm=1.0)
    assert not found.inlier[30:].any()
    assert found.inlier[:30].sum() >= 29
    alone = reg.register(reg.rows(*sound), threshold_mm=1.0)
    np.testing.assert_allclose(found.target_from_source.matrix, alone.target_from_source.matrix, atol=1e-6)


@pytest.mark.parametrize("kinds", [("point_plane", "line_line", "point_point"), ("point_point",)])
@given(seed=SEEDS)
@settings(max_examples=10)
def test_scipy_finds_no_better_fit_and_of_points_the_same_covariance(seed, kinds):
    random = np.random.default_rng(seed)
    true = truth(random)
    mix = reg.rows(*(correspondences(kind, 12, true, random, noise=0.2) for kind in kinds))
    found = reg.register(mix, robust=False, weighting="geometric")

    def residuals(v):
        moved = Similarity.from_rotvec(v[:3], v[3:6], float(np.exp(v[6]))) @ mix.points
        return np.einsum("ij,ij->i", mix.planes[:, :3], moved) + mix.planes[:, 3]

    from scipy.spatial.transform import Rotation

    start = found.target_from_source
    start_v = np.concatenate(
        [Rotation.from_matrix(start.rotation).as_rotvec(), start.translation, [np.log(start.scale)]]
    )
    best = least_squares(residuals, start_v, x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    assert np.sum(residuals(start_v) ** 2) <= np.sum(best.fun**2) * (1 + 1e-9)
    if len(kinds) > 1:
        return
    spare = len(mix) - 7
    assert found.freedom == spare
    theirs = np.linalg.inv(best.jac.T @ best.jac) * np.sum(best.fun**2) / spare
    # Translation and scale have the same tangent; the rotation's differs in its chart.
    np.testing.assert_allclose(found.covariance[3:, 3:], theirs[3:, 3:], rtol=1e-4, atol=1e-12)


def test_lines_on_lines_take_the_same_road_as_a_3d_probe():
    random = np.random.default_rng(1)
    true = truth(random)
    rows = correspondences("line_line", 8, true, random, noise=0.3)
    assert rows.lines is not None
    assert rows.lines.dimension == 3
    both = reg.rows(rows, correspondences("line_line", 4, true, random, noise=0.3))
    assert both.lines is not None
    assert both.lines.sightings.max() == 11
    found = reg.register(both, weighting="geometric")
    general = reg.register(reg.Rows(both.points, both.planes, both.first), threshold_mm=5.0)
    np.testing.assert_allclose(found.target_from_source.matrix, general.target_from_source.matrix, atol=1e-6)
    # One level of noise there, two here: of a line and of its points.
    ratio = np.diag(general.covariance) / np.diag(found.covariance)
    assert np.all((ratio > 0.2) & (ratio < 5))


@pytest.mark.parametrize(
    ("kind", "count", "determined"),
    [("point_plane", 5, 5), ("point_line", 3, 6), ("line_plane", 3, 6), ("plane_plane", 2, 5)],
)
def test_too_few_are_refused_with_their_rank(kind, count, determined):
    random = np.random.default_rng(3)
    with pytest.raises(
        DegenerateGeometryError, match=f"determine {determined} of 7 motions; free: |leave .* free"
    ):
        reg.register(correspondences(kind, count, truth(random), random))


def test_three_planes_leave_growth_about_their_common_point():
    random = np.random.default_rng(4)
    true = truth(random)
    with pytest.raises(DegenerateGeometryError, match="growth about the point"):
        reg.register(correspondences("plane_plane", 3, true, random))
    rows = reg.rows(
        correspondences("plane_plane", 3, true, random), correspondences("point_plane", 1, true, random)
    )
    np.testing.assert_allclose(reg.register(rows).target_from_source.matrix, true.matrix, atol=1e-6)


def test_correspondences_that_have_nothing_to_do_with_each_other_are_refused():
    random = np.random.default_rng(5)
    with pytest.raises(NoConsensusError, match="no similarity brings more than"):
        reg.register(
            reg.point_point(random.uniform(0, 500, (20, 3)), random.uniform(0, 500, (20, 3))),
            threshold_mm=0.1,
            max_samples=500,
        )


def test_what_cannot_be_registered_is_said_in_one_sentence():
    points = np.zeros((3, 3))
    with pytest.raises(InputError, match="pair up"):
        reg.point_point(points, np.zeros((2, 3)))
    with pytest.raises(InputError, match="finite"):
        reg.register(reg.point_point(points, np.full((3, 3), np.nan)))
    with pytest.raises(InputError, match="threshold in mm"):
        random = np.random.default_rng(6)
        reg.register(correspondences("point_point", 4, truth(random), random), threshold_mm="auto")


def test_without_refinement_the_consensus_answers():
    random = np.random.default_rng(7)
    true = truth(random)
    rows = correspondences("line_line", 6, true, random, noise=0.5)
    raw, refined = (reg.register(rows, refine=refine, weighting="geometric") for refine in (False, True))
    assert np.sum(refined.residuals_mm**2) <= np.sum(raw.residuals_mm**2) * (1 + 1e-9)


@pytest.mark.parametrize("kind", ENOUGH)
@given(seed=SEEDS)
@settings(max_examples=10)
def test_pairs_exchanged_at_random_are_refused(kind, seed):
    random = np.random.default_rng(seed)
    here, there = (correspondences(kind, 20, truth(random), random) for _ in range(2))
    swapped = {
        "planes": there.planes,
        "lines": None if here.lines is None else replace(here.lines, segments_mm=there.lines.segments_mm),
    }
    with pytest.raises(NoConsensusError, match=r"chance|no similarity brings |no calibration brings"):
        reg.register(replace(here, **swapped), threshold_mm=1.0)


@given(seed=SEEDS)
def test_three_pairs_of_points_have_the_similarity_of_least_squares(seed):
    """However badly they fit: a local answer of all rows is none."""
    random = np.random.default_rng(seed)
    source, target = random.uniform(-1, 1, (2, 3, 3))
    x, y = source - source.mean(axis=0), target - target.mean(axis=0)
    values = np.linalg.svd(y.T @ x, compute_uv=False)  # of three points the last one vanishes
    least = np.sum(y**2) - np.sum(values) ** 2 / np.sum(x**2)
    rows = reg.point_point(source, target)
    found = reg.register(reg.Rows(rows.points, rows.planes, rows.first), robust=False)
    assert np.sum(found.residuals_mm**2) == pytest.approx(least, rel=1e-6, abs=1e-12)
