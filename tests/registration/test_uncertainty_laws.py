"""Covariances of mapped points, radii and the weakest motion: by samples, by SciPy, and whatever the frame."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, f
from scipy.stats import t as student

from sonocal.geometry import AxisScaled, Similarity
from sonocal.registration.uncertainty import (
    point_covariance,
    point_jacobian,
    quantile_95,
    radius_95,
    weakest_motion,
)
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 5_000)
PLACES = np.array([[0.0, 0, 0], [500, 0, 0], [0, 500, 0], [500, 500, 0], [100, 200, 300]])


def some_covariance(seed, size=7, scale=1e-4):
    root = np.random.default_rng(seed).normal(size=(size, size)) * np.sqrt(scale)
    return root @ root.T


def stretched(seed) -> AxisScaled:
    random = np.random.default_rng(seed)
    rotation = random_similarity(seed).rotation
    return AxisScaled(rotation, random.normal(size=3) * 50, random.uniform(0.05, 1, 3))


@given(seeds)
@settings(max_examples=10)
def test_the_covariance_of_points_is_that_of_samples(seed):
    transform, covariance = random_similarity(seed, scale=0.24), some_covariance(seed, scale=1e-7)
    steps = np.random.default_rng(seed).multivariate_normal(np.zeros(7), covariance, 4000)
    mapped = np.array([transform.retract(step) @ PLACES for step in steps])
    sampled = np.einsum("sni,snj->nij", mapped - mapped.mean(0), mapped - mapped.mean(0)) / len(steps)
    predicted = point_covariance(transform, covariance, PLACES)
    for there, here in zip(sampled, predicted, strict=True):
        np.testing.assert_allclose(there, here, atol=0.12 * np.trace(here))


@given(seeds, st.sampled_from([7, 8]))
def test_the_covariance_of_points_is_linear_in_that_of_the_tangent(seed, size):
    transform = stretched(seed)
    one, two = some_covariance(seed, size), some_covariance(seed + 1, size)
    both = point_covariance(transform, 2 * one + 3 * two, PLACES)
    apart = 2 * point_covariance(transform, one, PLACES) + 3 * point_covariance(transform, two, PLACES)
    np.testing.assert_allclose(both, apart, rtol=1e-9, atol=1e-9)
    assert np.all(np.linalg.eigvalsh(both) > -1e-9)


@given(seeds)
def test_alike_growth_along_both_axes_is_growth(seed):
    transform = random_similarity(seed)
    flat = PLACES * [1, 1, 0]
    wide, narrow = point_jacobian(transform, flat, 8), point_jacobian(transform, flat, 7)
    np.testing.assert_allclose(wide[:, :, 6] + wide[:, :, 7], narrow[:, :, 6], atol=1e-9)
    np.testing.assert_array_equal(wide[:, :, :6], narrow[:, :, :6])


@given(seeds, st.floats(1e-6, 1e6), st.sampled_from([5.0, 30.0, np.inf]))
def test_a_radius_grows_as_a_length_and_does_not_turn(seed, factor, freedom):
    covariance = some_covariance(seed, 3)
    turn = random_similarity(seed).rotation
    radius = radius_95(covariance, freedom)
    assert radius_95(factor**2 * covariance, freedom) == pytest.approx(factor * radius, rel=1e-9)
    assert radius_95(turn @ covariance @ turn.T, freedom) == pytest.approx(radius, rel=1e-9)


@given(seeds)
def test_radii_of_many_are_those_of_each(seed):
    many = np.array([some_covariance(seed + i, 3) for i in range(4)])
    np.testing.assert_array_equal(radius_95(many, 12.0), [radius_95(one, 12.0) for one in many])


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_a_radius_is_exact_where_the_axes_are_alike(axes):
    covariance = np.diag([4.0] * axes + [0.0] * (3 - axes))
    assert radius_95(covariance) == pytest.approx(2 * np.sqrt(chi2.ppf(0.95, axes)), rel=1e-9)
    assert radius_95(covariance, 9) == pytest.approx(2 * np.sqrt(axes * f.ppf(0.95, axes, 9)), rel=1e-9)


@given(seeds, st.floats(3, 1e4))
def test_less_freedom_makes_a_larger_radius(seed, freedom):
    covariance = some_covariance(seed, 3)
    assert radius_95(covariance, freedom) > radius_95(covariance, 2 * freedom) > radius_95(covariance)


@given(seeds)
def test_no_motion_of_the_covariance_moves_the_places_more_than_the_weakest(seed):
    transform, covariance = random_similarity(seed, scale=0.24), some_covariance(seed)
    motion = weakest_motion(transform, covariance, PLACES)
    jacobian = point_jacobian(transform, PLACES)
    moved = np.sqrt(np.mean(np.sum((jacobian @ motion.tangent) ** 2, axis=1)))
    assert motion.rms_mm == pytest.approx(moved, rel=1e-6)
    root = np.linalg.cholesky(covariance)
    tried = np.random.default_rng(seed).normal(size=(300, 7))
    tried /= np.linalg.norm(tried, axis=1, keepdims=True)
    others = np.sqrt(np.mean(np.sum((jacobian @ (tried @ root.T).T) ** 2, axis=1), axis=0))
    assert np.all(others <= motion.rms_mm * (1 + 1e-9))


@given(seeds)
def test_the_weakest_motion_has_a_share_of_the_whole_variance(seed):
    transform, covariance = random_similarity(seed, scale=0.24), some_covariance(seed)
    motion = weakest_motion(transform, covariance, PLACES)
    whole = np.mean(np.trace(point_covariance(transform, covariance, PLACES), axis1=1, axis2=2))
    assert motion.share == pytest.approx(motion.rms_mm**2 / whole, rel=1e-6)
    assert 1 / 7 <= motion.share <= 1


@given(seeds)
def test_what_the_weakest_motion_says_of_itself_is_known_no_better_than_it_moves(seed):
    """Of the whole covariance: at least what this one motion does, and its spread over samples of it."""
    transform, covariance = random_similarity(seed, scale=0.24), some_covariance(seed)
    motion = weakest_motion(transform, covariance, PLACES)
    assert motion.turn_deviation_rad >= np.linalg.norm(motion.turn_rad) * (1 - 1e-6)
    assert motion.shift_deviation_mm >= motion.shift_rms_mm * (1 - 1e-6)
    assert motion.growth_deviation >= np.abs(motion.growth).max() * (1 - 1e-6)
    sampled = np.random.default_rng(seed).normal(size=(4000, 7)) @ np.linalg.cholesky(covariance).T
    axis = motion.tangent[:3] / np.linalg.norm(motion.tangent[:3])
    assert motion.turn_deviation_rad == pytest.approx(np.std(sampled[:, :3] @ axis), rel=0.06)
    centre = point_jacobian(transform, PLACES.mean(axis=0)[None])[0]
    along = centre @ motion.tangent / motion.shift_rms_mm
    assert motion.shift_deviation_mm == pytest.approx(np.std(sampled @ centre.T @ along), rel=0.06)
    assert motion.growth_deviation == pytest.approx(np.std(sampled[:, 6]), rel=0.06)


@pytest.mark.parametrize("freedom", [1, 3, 10, 1e9])
def test_so_many_deviations_hold_95_of_100(freedom):
    assert student.cdf(quantile_95(freedom), freedom) == pytest.approx(0.975, abs=1e-9)
    assert quantile_95(0) == quantile_95(1)
    assert quantile_95(1e9) == pytest.approx(quantile_95(), abs=1e-4)


@given(seeds)
def test_the_weakest_motion_is_the_same_in_every_frame_of_the_target(seed):
    transform, covariance = random_similarity(seed, scale=0.24), some_covariance(seed)
    mover = random_similarity(seed + 1, scale=1.0)
    turn = np.eye(7)
    turn[:3, :3] = turn[3:6, 3:6] = mover.rotation
    carried = Similarity(
        mover.rotation @ transform.rotation, mover.rotation @ transform.translation, transform.scale
    )
    here = weakest_motion(transform, covariance, PLACES)
    there = weakest_motion(carried, turn @ covariance @ turn.T, PLACES)
    for field in dataclasses.fields(here):
        if field.name != "tangent":
            one, other = (
                np.abs(getattr(here, field.name)),
                np.abs(getattr(there, field.name)),
            )  # a sign is free
            np.testing.assert_allclose(other, one, rtol=1e-5, atol=1e-9)
