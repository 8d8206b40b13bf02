"""Planes of the source have no points of their own: which are taken for them must not matter."""

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


def carried(planes, mover: Similarity):
    normals = planes[:, :3] @ mover.rotation.T
    feet = mover @ (-planes[:, 3:] * planes[:, :3])
    return np.column_stack([normals, -np.sum(normals * feet, axis=1)])


def planes_of(random, count: int):
    normals = random.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.column_stack([normals, -np.sum(normals * random.uniform(0, 200, (count, 3)), axis=1)])


def noisy(random, planes, noise_mm):
    off = planes + np.column_stack(
        [2e-3 * random.normal(size=(len(planes), 3)), noise_mm * random.normal(size=len(planes))]
    )
    return off / np.linalg.norm(off[:, :3], axis=1, keepdims=True)


@pytest.mark.parametrize("points", [0, 3])
@given(seeds, units)
@settings(max_examples=15)
def test_moving_the_source_of_planes_is_taken_back(points, seed, unit):
    random = np.random.default_rng(seed)
    true, mover = random_similarity(seed % 1000), random_similarity(seed % 991, scale=unit)
    source, places = planes_of(random, 9), random.uniform(0, 200, (points, 3))
    target = noisy(random, carried(source, true), true.scale)

    def registered(source, places):
        mix = reg.rows(reg.plane_plane(source, target), reg.point_point(places, true @ places_there))
        return reg.register(mix, robust=False)

    places_there = places.copy()
    here = registered(source, places)
    there = registered(carried(source, mover), mover @ places)
    together = (there.target_from_source @ mover).matrix
    np.testing.assert_allclose(together, here.target_from_source.matrix, rtol=1e-6, atol=1e-5)
    np.testing.assert_allclose(there.residuals_mm, here.residuals_mm, rtol=1e-4, atol=1e-6)
    assert there.freedom == pytest.approx(here.freedom, rel=1e-3)


@given(seeds)
@settings(max_examples=20)
def test_the_points_are_on_their_plane_and_as_far_from_their_middle_as_asked(seed):
    random = np.random.default_rng(seed)
    source = planes_of(random, 6)
    rows = reg.plane_plane(source, source, size=30.0)
    points = rows.points.reshape(6, 3, 3)
    away = np.einsum("mij,mj->mi", points, source[:, :3]) + source[:, 3:]
    np.testing.assert_allclose(away, 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(points - points.mean(axis=1, keepdims=True), axis=2), 30.0)
    # Squared distances from any plane are the same however the triangle is turned.
    assert np.ptp(np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2)) < 1e-9


def test_a_size_that_is_none_is_refused():
    planes = planes_of(np.random.default_rng(0), 5)
    with pytest.raises(InputError, match="size must be a positive number; got -1"):
        reg.plane_plane(planes, planes, size=-1)


def test_no_planes_have_no_points():
    assert len(reg.plane_plane(np.empty((0, 4)), np.empty((0, 4)))) == 0
