"""Rays of a curved probe: stretching depth along them has an inverse, a unit, and no place of its own."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.geometry.fan import Fan

RATIOS = st.floats(0.8, 1.25)
SEEDS = st.integers(0, 2**32 - 1)


def scene(seed, dimension, *, within=False):
    """A fan, and points of its image: on both sides of the face, or below it."""
    rng = np.random.default_rng(seed)
    fan = Fan(tuple(rng.uniform(-50, 500, dimension)), float(rng.uniform(20, 500)))
    points = np.array(fan.face_px) + rng.uniform(-300, 300, (40, dimension))
    if within:
        points[:, 1] = fan.face_px[1] + rng.uniform(0, 500, 40)
    return fan, points


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=SEEDS)
def test_a_ratio_of_one_moves_nothing_to_the_last_digit(dimension, seed):
    fan, points = scene(seed, dimension)
    assert np.array_equal(fan.stretched(points, 1.0), points)


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=SEEDS, ratio=RATIOS)
def test_the_inverse_has_the_inverse_ratio(dimension, seed, ratio):
    fan, points = scene(seed, dimension)
    assert np.allclose(fan.stretched(fan.stretched(points, ratio), 1 / ratio), points, atol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=SEEDS, ratio=RATIOS, shift=st.floats(-1000, 1000))
def test_moving_the_origin_moves_what_comes_out(dimension, seed, ratio, shift):
    fan, points = scene(seed, dimension)
    moved = Fan(tuple(np.array(fan.face_px) + shift), fan.radius_px)
    assert np.allclose(
        moved.stretched(points + shift, ratio), fan.stretched(points, ratio) + shift, atol=1e-8
    )


@given(seed=SEEDS, ratio=RATIOS, unit=st.floats(0.01, 100))
def test_another_unit_of_length_changes_the_numbers_alone(seed, ratio, unit):
    fan, points = scene(seed, 2)
    other = Fan(tuple(unit * np.array(fan.face_px)), unit * fan.radius_px)
    assert np.allclose(
        other.stretched(unit * points, ratio),
        unit * fan.stretched(points, ratio),
        rtol=1e-9,
        atol=1e-7 * unit,
    )


@pytest.mark.parametrize("dimension", [2, 3])
@given(seed=SEEDS, ratio=RATIOS)
def test_depths_below_the_face_are_multiplied_along_the_ray(dimension, seed, ratio):
    fan, points = scene(seed, dimension, within=True)
    apex = np.array(fan.face_px) - fan.radius_px * np.eye(dimension)[1]
    before, after = points - apex, fan.stretched(points, ratio) - apex
    depth, stretched = (np.linalg.norm(ray, axis=1) - fan.radius_px for ray in (before, after))
    assert np.allclose(stretched, ratio * depth, atol=1e-8)
    along = np.einsum("nd,nd->n", before, after)
    assert np.allclose(along, np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1))


def test_the_face_and_what_is_above_it_stay():
    fan = Fan((100.0, 20.0), 50.0)
    above = np.array([[100.0, 20.0], [100.0, -30.0], [130.0, 10.0], [100.0, 0.0]])
    assert np.array_equal(fan.stretched(above, 1.05), above)
    assert np.allclose(fan.stretched(np.array([[100.0, 120.0]]), 1.05), [[100.0, 125.0]])
