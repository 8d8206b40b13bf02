"""Similarities are a group that acts on points, with any leading axes, and agree with SciPy and with 4 x 4 algebra."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from sonocal import InputError, Similarity
from sonocal.geometry import homogeneous_points, segment_directions
from tests.builders.similarities import by_matrix, random_axis_scaled, random_batch, random_similarity

seeds = st.integers(0, 10_000)
shapes = st.sampled_from([(), (1,), (4,), (2, 3), (3, 1, 2), (0,)])


def assert_equal(one, other):
    np.testing.assert_allclose(one.matrix, other.matrix, rtol=1e-11, atol=1e-9)


@given(seeds, shapes)
def test_composition_is_associative(seed, shape):
    a, b, c = (random_batch([seed, k], shape) for k in range(3))
    assert_equal((a @ b) @ c, a @ (b @ c))


@given(seeds, shapes)
def test_the_identity_is_neutral_on_both_sides(seed, shape):
    a, one = random_batch(seed, shape), Similarity.identity()
    assert_equal(one @ a, a)
    assert_equal(a @ one, a)


@given(seeds, shapes)
def test_the_inverse_undoes_on_both_sides_and_its_inverse_is_the_first(seed, shape):
    a = random_batch(seed, shape)
    unit = np.broadcast_to(np.eye(4), a.matrix.shape)
    np.testing.assert_allclose((a @ a.inverse()).matrix, unit, atol=1e-9)
    np.testing.assert_allclose((a.inverse() @ a).matrix, unit, atol=1e-9)
    assert_equal(a.inverse().inverse(), a)


@given(seeds, shapes)
def test_the_inverse_of_a_product_is_the_product_of_inverses_reversed(seed, shape):
    a, b = random_batch([seed, 0], shape), random_batch([seed, 1], shape)
    assert_equal((a @ b).inverse(), b.inverse() @ a.inverse())


@given(seeds, shapes)
def test_the_inverse_is_that_of_the_matrix(seed, shape):
    a = random_batch(seed, shape)
    np.testing.assert_allclose(a.inverse().matrix, np.linalg.inv(a.matrix), rtol=1e-9, atol=1e-8)


@given(seeds, shapes)
def test_points_are_moved_by_one_after_the_other_as_by_the_product(seed, shape):
    a, b = random_batch([seed, 0], shape), random_batch([seed, 1], shape)
    points = np.random.default_rng(seed).normal(size=(*shape, 3)) * 100
    np.testing.assert_allclose((a @ b) @ points, a @ (b @ points), rtol=1e-10, atol=1e-9)


@given(seeds)
def test_a_batch_is_its_members(seed):
    batch, other = random_batch([seed, 0], (2, 3)), random_batch([seed, 1], (2, 3))
    points = np.random.default_rng(seed).normal(size=(2, 3, 3))
    product, inverse, moved = batch @ other, batch.inverse(), batch @ points
    for index in np.ndindex(2, 3):
        a, b = (Similarity(x.rotation[index], x.translation[index], x.scale[index]) for x in (batch, other))
        np.testing.assert_allclose(product.matrix[index], (a @ b).matrix, atol=1e-10)
        np.testing.assert_allclose(inverse.matrix[index], a.inverse().matrix, atol=1e-9)
        np.testing.assert_allclose(moved[index], a @ points[index], atol=1e-10)
        np.testing.assert_allclose(batch.quaternion_wxyz[index], a.quaternion_wxyz, atol=1e-12)


@given(seeds)
def test_batch_axes_of_two_transforms_broadcast(seed):
    rows, columns = random_batch([seed, 0], (3, 1)), random_batch([seed, 1], (4,))
    both = rows @ columns
    assert both.matrix.shape == (3, 4, 4, 4)
    np.testing.assert_allclose(both.matrix, rows.matrix @ columns.matrix, atol=1e-9)


@given(seeds, shapes)
def test_a_matrix_is_taken_apart_into_what_it_was_made_of(seed, shape):
    a = random_batch(seed, shape)
    again = Similarity.from_matrix(a.matrix)
    np.testing.assert_allclose(again.rotation, a.rotation, atol=1e-12)
    np.testing.assert_array_equal(again.translation, a.translation)
    np.testing.assert_allclose(again.scale, a.scale, rtol=1e-12)


@given(seeds, shapes)
def test_a_similarity_multiplies_every_distance_by_its_scale(seed, shape):
    a = random_batch(seed, shape)
    p, q = np.random.default_rng(seed).normal(size=(2, *shape, 3)) * 50
    before, after = np.linalg.norm(p - q, axis=-1), np.linalg.norm((a @ p) - (a @ q), axis=-1)
    np.testing.assert_allclose(after, a.scale * before, rtol=1e-9)


@given(seeds)
def test_a_similarity_keeps_handedness(seed):
    a, points = random_similarity(seed), np.random.default_rng(seed).normal(size=(4, 3))
    volume = np.linalg.det(points[1:] - points[0])
    moved = a @ points
    assert np.linalg.det(moved[1:] - moved[0]) == pytest.approx(a.scale**3 * volume, rel=1e-6)


@given(seeds)
def test_at_scale_one_a_similarity_is_scipys_rigid_transform(seed):
    a, b = random_similarity(seed, scale=1.0), random_similarity(seed + 1, scale=1.0)
    points = np.random.default_rng(seed).normal(size=(7, 3)) * 100
    theirs = [RigidTransform.from_components(x.translation, Rotation.from_matrix(x.rotation)) for x in (a, b)]
    np.testing.assert_allclose(a @ points, theirs[0].apply(points), atol=1e-9)
    np.testing.assert_allclose((a @ b).matrix, (theirs[0] * theirs[1]).as_matrix(), atol=1e-9)
    np.testing.assert_allclose(a.inverse().matrix, theirs[0].inv().as_matrix(), atol=1e-9)


@given(seeds)
def test_a_rotation_vector_turns_as_scipys_and_as_rodrigues_formula(seed):
    rng = np.random.default_rng(seed)
    rotvec, point = rng.normal(size=3) * 2, rng.normal(size=3)
    turned = Similarity.from_rotvec(rotvec, np.zeros(3), 1.0) @ point
    np.testing.assert_allclose(turned, Rotation.from_rotvec(rotvec).apply(point), atol=1e-12)
    angle = np.linalg.norm(rotvec)
    axis = rotvec / angle
    expected = (
        point * np.cos(angle)
        + np.cross(axis, point) * np.sin(angle)
        + axis * (axis @ point) * (1 - np.cos(angle))
    )
    np.testing.assert_allclose(turned, expected, atol=1e-12)


@given(seeds, shapes)
def test_quaternions_are_unit_have_w_not_negative_and_give_the_rotation_back(seed, shape):
    a = random_batch(seed, shape)
    if 0 in shape:
        return
    wxyz = a.quaternion_wxyz
    assert wxyz.shape == (*shape, 4)
    np.testing.assert_allclose(np.linalg.norm(wxyz, axis=-1), 1, rtol=1e-12)
    assert np.all(wxyz[..., 0] >= 0)
    again = Rotation.from_quat(np.roll(wxyz, -1, axis=-1)).as_matrix()
    np.testing.assert_allclose(again, a.rotation, atol=1e-12)


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_a_turn_has_a_quaternion_too(axis):
    a = Similarity(Rotation.from_rotvec(np.pi * axis).as_matrix(), np.zeros(3), 1.0)
    np.testing.assert_allclose(np.abs(a.quaternion_wxyz), np.r_[0, axis], atol=1e-12)


@given(seeds, shapes)
def test_a_step_of_nothing_stays_and_small_steps_add_up(seed, shape):
    a = random_batch(seed, shape)
    assert_equal(a.retract(np.zeros((*shape, 7))), a)
    first, second = np.random.default_rng(seed).normal(size=(2, *shape, 7)) * 1e-5
    np.testing.assert_allclose(
        a.retract(first).retract(second).matrix, a.retract(first + second).matrix, atol=1e-8
    )


@given(seeds)
def test_a_step_back_undoes_a_step(seed):
    a, step = random_similarity(seed), np.random.default_rng(seed).normal(size=7)
    assert_equal(a.retract(step).retract(-step), a)


@given(seeds)
def test_scales_of_their_own_act_along_the_sources_axes(seed):
    a, points = random_axis_scaled(seed), np.random.default_rng(seed).normal(size=(5, 2, 3))
    np.testing.assert_allclose(a @ points, by_matrix(a.matrix, points), atol=1e-10)
    for k, unit in enumerate(np.eye(3)):
        assert np.linalg.norm((a @ unit) - a.translation) == pytest.approx(a.scales[k], rel=1e-9)


@given(seeds, shapes)
def test_equal_scales_make_an_axis_scaled_transform_of_a_similarity(seed, shape):
    a = random_batch(seed, shape)
    np.testing.assert_array_equal(a.scales, np.repeat(a.scale[..., None], 3, axis=-1))


@given(seeds, st.sampled_from([(2,), (5, 2), (0, 2), (2, 3, 2)]))
def test_flat_points_get_a_third_coordinate_of_zero_and_solid_ones_stay(seed, shape):
    points = np.random.default_rng(seed).normal(size=shape)
    solid = homogeneous_points(points)
    np.testing.assert_array_equal(solid[..., :2], points)
    assert not solid[..., 2].any()
    assert solid.shape == (*shape[:-1], 3)
    np.testing.assert_array_equal(homogeneous_points(solid), solid)


@given(seeds, shapes)
def test_directions_have_unit_length_turn_with_the_segment_and_change_sign_with_its_ends(seed, shape):
    segments = np.random.default_rng(seed).normal(size=(*shape, 2, 3))
    turn, along = random_similarity(seed), segment_directions(segments)
    np.testing.assert_allclose(np.linalg.norm(along, axis=-1), 1, rtol=1e-12)
    np.testing.assert_array_equal(segment_directions(segments[..., ::-1, :]), -along)
    np.testing.assert_allclose(segment_directions(turn @ segments), along @ turn.rotation.T, atol=1e-9)


def spoilt(**change):
    parts = {"rotation": np.eye(3), "translation": np.zeros(3), "scale": 1.0} | change
    return lambda: Similarity(**parts)


def matrix_with(row, column, value):
    matrix = np.eye(4)
    matrix[row, column] = value
    return lambda: Similarity.from_matrix(matrix)


batch_of = np.stack([np.eye(3), np.diag([1.0, 1.0, -1.0])])
NO_SIMILARITIES = {
    "mirroring": spoilt(rotation=np.diag([1.0, 1.0, -1.0])),
    "sheared": spoilt(rotation=[[1, 1e-3, 0], [0, 1, 0], [0, 0, 1]]),
    "scaled": spoilt(rotation=1.001 * np.eye(3)),
    "not finite": spoilt(rotation=np.full((3, 3), np.nan)),
    "turned into nowhere": spoilt(translation=[0, np.nan, 0]),
    "endless translation": spoilt(translation=[0, 0, np.inf]),
    "no scale": spoilt(scale=0.0),
    "negative scale": spoilt(scale=-1.0),
    "scale that is no number": spoilt(scale=np.nan),
    "endless scale": spoilt(scale=np.inf),
    "flat rotation": spoilt(rotation=np.eye(2)),
    "flat translation": spoilt(translation=np.zeros(2)),
    "one of a batch mirrors": spoilt(rotation=batch_of, translation=np.zeros((2, 3)), scale=np.ones(2)),
    "one of a batch has no scale": spoilt(
        rotation=np.stack([np.eye(3)] * 2), translation=np.zeros((2, 3)), scale=[1, 0]
    ),
    "projective": matrix_with(3, 0, 1e-3),
    "last row scaled": matrix_with(3, 3, 2.0),
    "flattening": matrix_with(2, 2, 0.0),
    "mirroring matrix": matrix_with(0, 0, -1.0),
    "shearing matrix": matrix_with(0, 1, 0.5),
    "matrix with a hole": matrix_with(1, 1, np.nan),
    "matrix without end": matrix_with(0, 3, np.inf),
    "not four by four": lambda: Similarity.from_matrix(np.eye(3)),
}


@pytest.mark.parametrize("make", NO_SIMILARITIES.values(), ids=NO_SIMILARITIES)
def test_what_is_no_similarity_is_refused_in_one_sentence(make):
    with pytest.raises(InputError) as caught:
        make()
    assert str(caught.value).startswith("a similarity ") or "last row of a similarity" in str(caught.value)
    assert "\n" not in str(caught.value)


@given(seeds, st.floats(1e-5, 0.3))
def test_a_bent_rotation_is_refused_alone_and_among_sound_ones(seed, bend):
    a = random_similarity(seed)
    bent = a.rotation + bend * np.outer([1.0, 0, 0], [0, 1.0, 0])
    with pytest.raises(InputError, match="needs a rotation"):
        Similarity(bent, a.translation, a.scale)
    with pytest.raises(InputError, match="needs a rotation"):
        Similarity(np.stack([a.rotation, bent]), np.stack([a.translation] * 2), np.ones(2))
