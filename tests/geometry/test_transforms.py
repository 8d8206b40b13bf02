import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from sonocal import AxisScaled, InputError, Similarity
from sonocal.geometry import homogeneous_points, segment_directions, similarity_errors
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 10_000)


@given(seeds, seeds)
def test_composition_is_the_product_of_matrices(a, b):
    first, second = random_similarity(a), random_similarity(b)
    np.testing.assert_allclose((first @ second).matrix, first.matrix @ second.matrix, atol=1e-10)


@given(seeds)
def test_inverse_undoes_and_matrix_round_trips(seed):
    a = random_similarity(seed)
    np.testing.assert_allclose((a.inverse() @ a).matrix, np.eye(4), atol=1e-10)
    np.testing.assert_allclose(Similarity.from_matrix(a.matrix).matrix, a.matrix, rtol=1e-13, atol=1e-13)


@given(seeds)
def test_points_map_as_the_matrix_maps_homogeneous_points(seed):
    a, points = random_similarity(seed), np.random.default_rng(seed).normal(size=(5, 4, 3))
    expected = points @ a.matrix[:3, :3].T + a.matrix[:3, 3]
    np.testing.assert_allclose(a @ points, expected, atol=1e-12)


def test_two_dimensional_points_lie_at_w_zero():
    a = random_similarity(1)
    np.testing.assert_array_equal(a @ [[3.0, 4.0]], a @ [[3.0, 4.0, 0.0]])


def test_batch_axes_broadcast_against_points():
    several = Similarity(np.stack([np.eye(3)] * 2), [[0, 0, 0], [1, 2, 3]], [1.0, 2.0])
    np.testing.assert_allclose(several @ [1.0, 1.0, 1.0], [[1, 1, 1], [3, 4, 5]])
    assert several.matrix.shape == (2, 4, 4)


@given(seeds)
def test_retract_is_the_exponential_on_the_left_of_the_rotation(seed):
    a, step = random_similarity(seed), np.random.default_rng(seed).normal(size=7)
    moved = a.retract(step)
    w = step[:3]
    cross = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    np.testing.assert_allclose(moved.rotation, expm(cross) @ a.rotation, atol=1e-12)
    np.testing.assert_allclose(moved.translation, a.translation + step[3:6])
    np.testing.assert_allclose(moved.scale, a.scale * np.exp(step[6]))


@given(seeds)
def test_quaternion_is_scipys_with_the_scalar_first_and_not_negative(seed):
    a = random_similarity(seed)
    w, x, y, z = a.quaternion_wxyz
    assert w >= 0
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), a.rotation, atol=1e-12)


@given(seeds, st.floats(1e-9, 3.1))
def test_rotation_error_is_the_angle_also_when_tiny(seed, angle):
    a = random_similarity(seed)
    axis = np.random.default_rng(seed).normal(size=3)
    turned = a.retract(np.r_[angle * axis / np.linalg.norm(axis), 0, 3, 4, 0])
    found, distance, scale = similarity_errors(turned, a)
    assert found == pytest.approx(angle, rel=1e-5)
    assert distance == pytest.approx(5)
    assert scale == pytest.approx(0, abs=1e-15)


def test_axis_scaled_scales_each_axis():
    a = AxisScaled(np.eye(3), np.array([1.0, 0, 0]), np.array([2.0, 3.0, 2.5]))
    np.testing.assert_allclose(a @ [[1.0, 1.0]], [[3.0, 3.0, 0.0]])
    np.testing.assert_allclose(a.matrix @ [1, 1, 1, 1], [3, 3, 2.5, 1])


def test_segment_directions_have_unit_length_and_a_point_has_none():
    directions = segment_directions([[[0, 0, 0], [0, 0, 5]], [[1, 1, 1], [1, 1, 1]]])
    np.testing.assert_array_equal(directions[0], [0, 0, 1])
    assert np.isnan(directions[1]).all()


@pytest.mark.parametrize(
    ("matrix", "sentence"),
    [
        (np.eye(3), "a similarity needs a (..., 4, 4) matrix; got shape (3, 3)"),
        (
            np.diag([1.0, 1, -1, 1]),
            "a similarity does not mirror or flatten; this matrix has determinant <= 0",
        ),
        (
            np.diag([1.0, 2, 1, 1]),
            "a similarity needs a rotation; this matrix is off by 1.5 from orthonormal or mirrors",
        ),
    ],
)
def test_a_matrix_that_is_no_similarity_is_refused(matrix, sentence):
    with pytest.raises(InputError) as caught:
        Similarity.from_matrix(matrix)
    assert str(caught.value) == sentence


def test_points_need_two_or_three_coordinates():
    with pytest.raises(InputError) as caught:
        homogeneous_points(np.zeros((5, 4)))
    assert str(caught.value) == "points must have shape (..., 2) or (..., 3); got (5, 4)"


def test_what_is_taken_unchecked_is_neither_copied_nor_written_to():
    parts = np.eye(3), np.zeros(3), np.full(3, 0.2)
    found = Similarity.unchecked(*parts)
    assert found.rotation is parts[0]
    np.testing.assert_array_equal(found.matrix, Similarity(np.eye(3), np.zeros(3), 0.2).matrix)
    with pytest.raises(ValueError, match="read-only"):
        found.scales[0] = 1.0
