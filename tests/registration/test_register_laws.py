"""Registration of any mix: what moving, scaling, exchanging and repeating do to it; planes and ranks by algebra."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import registration as reg
from sonocal.errors import InputError
from sonocal.geometry import Similarity
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 2**32 - 1)
units = st.sampled_from([1e-2, 1.0, 40.0])


def parts_of(random, true, noise=0.05):
    """Points on planes, on lines and on points, by one similarity."""
    points = random.uniform(0, 200, (18, 3))
    places = true @ points + noise * random.normal(size=(18, 3))
    normals = random.normal(size=(6, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    planes = np.column_stack([normals, -np.sum(normals * places[:6], axis=1)])
    along = random.normal(size=(6, 3))
    lines = np.stack([places[6:12] - along, places[6:12] + 2 * along], axis=1)
    return points, planes, lines, places[12:]


def mix(points, planes, lines, places):
    return reg.rows(
        reg.point_plane(points[:6], planes),
        reg.point_line(points[6:12], lines),
        reg.point_point(points[12:], places),
    )


def carried_planes(planes, mover):
    normals = planes[:, :3] @ mover.rotation.T
    feet = mover @ (-planes[:, 3:] * planes[:, :3])
    return np.column_stack([normals, -np.sum(normals * feet, axis=1)])


@given(seeds, units)
@settings(max_examples=15)
def test_carrying_the_target_carries_the_answer(seed, unit):
    random = np.random.default_rng(seed)
    points, planes, lines, places = parts_of(random, random_similarity(seed % 1000))
    mover = random_similarity(seed % 997, scale=unit)
    here = reg.register(mix(points, planes, lines, places), robust=False)
    there = reg.register(
        mix(points, carried_planes(planes, mover), mover @ lines, mover @ places), robust=False
    )
    expected = (mover @ here.target_from_source).matrix
    np.testing.assert_allclose(there.target_from_source.matrix, expected, atol=1e-6 * np.abs(expected).max())
    np.testing.assert_allclose(there.residuals_mm, unit * here.residuals_mm, rtol=1e-3, atol=1e-6 * unit)


@given(seeds, units)
@settings(max_examples=15)
def test_carrying_the_source_is_taken_back(seed, unit):
    random = np.random.default_rng(seed)
    points, planes, lines, places = parts_of(random, random_similarity(seed % 1000))
    mover = random_similarity(seed % 991, scale=unit)
    here = reg.register(mix(points, planes, lines, places), robust=False)
    there = reg.register(mix(mover @ points, planes, lines, places), robust=False)
    together = there.target_from_source @ mover
    np.testing.assert_allclose(together @ points, here.target_from_source @ points, atol=1e-5)
    np.testing.assert_allclose(there.residuals_mm, here.residuals_mm, atol=1e-5)


@given(seeds)
@settings(max_examples=15)
def test_points_on_points_either_way_are_inverse_without_noise(seed):
    random = np.random.default_rng(seed)
    true = random_similarity(seed % 1000)
    points = random.uniform(0, 100, (8, 3))
    places = true @ points
    forth = reg.register(reg.point_point(points, places)).target_from_source
    back = reg.register(reg.point_point(places, points)).target_from_source
    np.testing.assert_allclose((back @ forth).matrix, np.eye(4), atol=1e-6)


@given(seeds)
@settings(max_examples=15)
def test_correspondences_given_twice_change_nothing(seed):
    random = np.random.default_rng(seed)
    points, _, _, places = parts_of(random, random_similarity(seed % 1000))
    rows = reg.point_point(points[12:], places)
    once, twice = (reg.register(one, robust=False) for one in (rows, reg.rows(rows, rows)))
    np.testing.assert_allclose(
        twice.target_from_source.matrix, once.target_from_source.matrix, rtol=1e-6, atol=1e-6
    )
    np.testing.assert_allclose(twice.covariance, once.covariance, rtol=1e-4, atol=1e-9)
    assert twice.freedom == once.freedom


@given(seeds)
@settings(max_examples=15)
def test_the_seed_does_not_matter_where_the_answer_is_clear(seed):
    random = np.random.default_rng(seed)
    rows = mix(*parts_of(random, random_similarity(seed % 1000)))
    found = [reg.register(rows, seed=one).target_from_source.matrix for one in (0, 1, seed)]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found[2], found[0], rtol=1e-6, atol=1e-6)


@given(seeds)
def test_the_planes_of_a_line_hold_both_its_ends_and_stand_at_right_angles(seed):
    segments = np.random.default_rng(seed).normal(size=(5, 2, 3)) * 100
    planes = reg.planes_of_lines(segments)
    assert planes.shape == (5, 2, 4)
    normals = planes[..., :3]
    np.testing.assert_allclose(
        normals @ np.swapaxes(normals, 1, 2), np.tile(np.eye(2), (5, 1, 1)), atol=1e-12
    )
    on_both = np.einsum("nij,nkj->nik", segments, normals) + planes[:, None, :, 3]
    np.testing.assert_allclose(on_both, 0, atol=1e-10)
    point = np.random.default_rng(seed + 1).normal(size=3) * 100
    squares = np.sum((normals @ point + planes[..., 3]) ** 2, axis=1)
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    distance = np.linalg.norm(np.cross(point - segments[:, 0], along), axis=1)
    np.testing.assert_allclose(np.sqrt(squares), distance, rtol=1e-9)


@given(seeds, st.integers(1, 12))
def test_free_motions_are_as_many_as_the_rank_leaves(seed, count):
    random = np.random.default_rng(seed)
    points = random.uniform(0, 100, (count, 3))
    planes = random.normal(size=(count, 4))
    true = random_similarity(seed % 1000)
    found = reg.rank(reg.point_plane(points, planes), true)
    assert found.rank == min(count, 7)
    assert len(found.motions) == 7 - found.rank
    # More rows never determine less.
    more = reg.rows(reg.point_plane(points, planes), reg.point_point(points[:1], true @ points[:1]))
    assert found.rank <= reg.rank(more, true).rank <= min(found.rank + 3, 7)


@given(seeds)
def test_putting_rows_together_is_associative(seed):
    random = np.random.default_rng(seed)
    points, planes, lines, places = parts_of(random, random_similarity(seed % 1000))
    one, two, three = (
        reg.point_plane(points[:6], planes),
        reg.point_line(points[6:12], lines),
        reg.point_point(points[12:], places),
    )
    left, right = reg.rows(reg.rows(one, two), three), reg.rows(one, reg.rows(two, three))
    for name in ("points", "planes", "first"):
        np.testing.assert_array_equal(getattr(left, name), getattr(right, name))
    assert left.first[-1] == len(left.points)
    assert reg.rows(one) is one


@pytest.mark.parametrize(
    ("keywords", "sentence"),
    [
        ({"threshold_mm": -1}, "threshold_mm must be a positive number; got -1"),
        ({"threshold_mm": True}, "threshold_mm must be a positive number; got True"),
        ({"confidence": 2}, "confidence must be below 1; got 2.0"),
        ({"seed": 1.5}, "seed must be a whole number"),
        ({"robust": "no"}, "robust must be True or False; got 'no'"),
        ({"refine": np.array([1, 0])}, r"refine must be True or False; got array\(\[1, 0\]\)"),
        ({"sigma_mm": [[1], [1, 2]]}, "sigma_mm: rows are of unlike length"),
        ({"sigma_mm": "1"}, "sigma_mm must be a positive number; got the text '1'"),
        ({"weighting": "equal"}, "weighting must be one of likelihood, geometric; got 'equal'"),
    ],
)
def test_options_are_refused_before_anything_is_done(keywords, sentence):
    with pytest.raises(InputError, match=sentence):
        reg.register(reg.point_point(np.eye(3), np.eye(3)), **keywords)


def test_no_rows_are_no_rows_to_put_together():
    with pytest.raises(InputError, match=r"^there is no correspondence to put together"):
        reg.rows()
    with pytest.raises(InputError, match=r"^parts must be rows of correspondences"):
        reg.rows(None)


def test_numpy_numbers_are_numbers():
    random = np.random.default_rng(0)
    rows = mix(*parts_of(random, random_similarity(0)))
    plain = reg.register(rows, threshold_mm=3.0, seed=4)
    numpy = reg.register(rows, threshold_mm=np.float64(3), seed=np.int64(4))
    np.testing.assert_array_equal(plain.target_from_source.matrix, numpy.target_from_source.matrix)
    assert isinstance(plain.target_from_source, Similarity)
