import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.geometry import homogeneous_points
from sonocal.registration.noise import residual_vectors
from sonocal.simulation.scene import simulate_observations


def distances(scene):
    rows = scene.observations
    points = homogeneous_points(rows.points_px)
    return np.linalg.norm(residual_vectors(scene.probe_from_image, points, rows.segments_mm), axis=1)


@given(st.integers(0, 1000), st.sampled_from([2, 3]))
def test_without_noise_every_point_is_on_its_needle(seed, dimension):
    scene = simulate_observations(dimension, 10, sigma_px=0, sigma_mm=0, seed=seed)
    assert distances(scene).max() < 1e-9
    lengths = np.linalg.norm(np.diff(scene.observations.segments_mm, axis=1), axis=-1)
    np.testing.assert_allclose(lengths, 400)
    assert np.all((scene.observations.points_px >= 0) & (scene.observations.points_px <= 500))
    assert scene.probe_from_image.scale == 0.24


def test_noise_and_outliers_have_the_size_asked_for():
    scene = simulate_observations(2, 4000, sigma_px=1, sigma_mm=0, outlier_share=0.25, seed=0)
    sound = distances(scene)[~scene.outlier]
    # A normal error of 0.24 mm along both image axes, seen across needles of random direction: two thirds remain.
    assert np.mean(sound**2) == pytest.approx(2 * 0.24**2 * 2 / 3, rel=0.05)
    assert scene.outlier.sum() == 1000
    assert np.median(distances(scene)[scene.outlier]) > 10


def test_the_same_seed_gives_the_same_sightings():
    first, second = (simulate_observations(3, 5, seed=9).observations for _ in range(2))
    np.testing.assert_array_equal(first.points_px, second.points_px)
    np.testing.assert_array_equal(first.segments_mm, second.segments_mm)
    np.testing.assert_array_equal(first.frame, [0, 0, 1, 1, 2, 2, 3, 3, 4, 4])


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ({"dimension": 4}, "a probe has 2 or 3 dimensions; got 4"),
        ({"needles": 0}, "a simulation needs at least one needle; got 0"),
        ({"sigma_px": -1}, "noise cannot be negative; got -1 px and 1.0 mm"),
        ({"outlier_share": 1}, "the share of outliers is at least 0 and less than 1; got 1"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(arguments, sentence):
    with pytest.raises(sc.InputError) as caught:
        simulate_observations(**arguments)
    assert str(caught.value) == sentence
