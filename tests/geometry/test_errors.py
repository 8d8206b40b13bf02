"""How far two transforms are apart: three distances in the sense of the word."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import AxisScaled
from sonocal.geometry import similarity_errors
from tests.builders.similarities import random_axis_scaled, random_batch, random_similarity

seeds = st.integers(0, 10_000)


def three(seed):
    return (random_similarity([seed, k]) for k in range(3))


@given(seeds)
def test_nothing_is_apart_from_itself(seed):
    a = random_similarity(seed)
    np.testing.assert_allclose(similarity_errors(a, a), 0, atol=1e-14)


@given(seeds, st.integers(0, 6), st.floats(1e-6, 1.0))
def test_what_differs_is_apart_in_that_alone(seed, which, size):
    """A step along one axis of the tangent moves one of the three errors."""
    a, step = random_similarity(seed), np.zeros(7)
    step[which] = size
    errors = np.array(similarity_errors(a.retract(step), a))
    moved = np.array([which < 3, 3 <= which < 6, which == 6])
    assert np.all(errors[moved] > 0)
    np.testing.assert_allclose(errors[~moved], 0, atol=1e-12)


@given(seeds)
def test_there_is_as_far_as_back(seed):
    a, b, _ = three(seed)
    np.testing.assert_allclose(similarity_errors(a, b), similarity_errors(b, a), rtol=1e-9)


@given(seeds)
def test_a_detour_is_never_shorter(seed):
    a, b, c = three(seed)
    direct = np.array(similarity_errors(a, c))
    around = np.array(similarity_errors(a, b)) + similarity_errors(b, c)
    assert np.all(direct <= around + 1e-9)


@given(seeds)
def test_a_common_motion_of_the_target_changes_nothing(seed):
    a, b, _ = three(seed)
    mover = random_similarity(seed + 1, scale=1.0)
    np.testing.assert_allclose(similarity_errors(mover @ a, mover @ b), similarity_errors(a, b), rtol=1e-8)


@given(seeds, st.floats(0.01, 100))
def test_a_common_unit_scales_lengths_and_leaves_the_angle(seed, unit):
    a, b, _ = three(seed)
    scaler = type(a)(np.eye(3), np.zeros(3), unit)
    angle, distance, scale = similarity_errors(a, b)
    found = similarity_errors(scaler @ a, scaler @ b)
    np.testing.assert_allclose(found, [angle, unit * distance, unit * scale], rtol=1e-8)


@given(seeds)
def test_a_common_turn_of_the_image_leaves_the_angle_and_the_scale(seed):
    a, b, turn = three(seed)
    turn = type(a)(turn.rotation, np.zeros(3), 1.0)
    np.testing.assert_allclose(similarity_errors(a @ turn, b @ turn), similarity_errors(a, b), rtol=1e-8)


@given(seeds)
def test_the_angle_is_scipys_magnitude_of_the_turn_between(seed):
    a, b, _ = three(seed)
    between = Rotation.from_matrix(a.rotation.T @ b.rotation)
    np.testing.assert_allclose(similarity_errors(a, b)[0], between.magnitude(), rtol=1e-7)


@given(seeds)
def test_no_angle_is_greater_than_half_a_turn_and_half_turns_reach_it(seed):
    a, b, _ = three(seed)
    assert 0 <= similarity_errors(a, b)[0] <= np.pi
    half = Rotation.from_rotvec(np.pi * b.rotation[0]).as_matrix()
    turned = type(a)(a.rotation @ half, a.translation, a.scale)
    np.testing.assert_allclose(similarity_errors(turned, a)[0], np.pi, atol=1e-6)


@given(seeds)
def test_a_batch_against_one_is_each_member_against_it(seed):
    batch, one = random_batch(seed, (2, 3)), random_similarity(seed)
    found = similarity_errors(batch, one)
    for index in np.ndindex(2, 3):
        member = type(one)(batch.rotation[index], batch.translation[index], batch.scale[index])
        np.testing.assert_allclose([e[index] for e in found], similarity_errors(member, one), rtol=1e-9)


@given(seeds, st.permutations(range(3)))
def test_of_unlike_scales_their_mean_counts_whatever_their_order(seed, order):
    a = random_axis_scaled(seed)
    other = AxisScaled(a.rotation, a.translation, a.scales[order])
    np.testing.assert_allclose(similarity_errors(a, other), 0, atol=1e-14)
    mean = random_similarity(seed, scale=float(a.scales.mean()))
    np.testing.assert_allclose(similarity_errors(a, mean)[2], 0, atol=1e-14)
