"""What must not change the calibration, or must change it in the obvious way, whatever the data."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.geometry import homogeneous_points
from sonocal.simulation.scene import simulate_observations
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 5_000)
dimensions = st.sampled_from([2, 3])


def sweep(seed, dimension):
    """Sightings with noise and outliers."""
    return simulate_observations(dimension, 24, outlier_share=0.2, seed=seed).observations


def altered(rows, **columns):
    return dataclasses.replace(rows, **columns)


def assert_same(found, expected):
    np.testing.assert_allclose(found.probe_from_image.matrix, expected.probe_from_image.matrix, atol=1e-6)


def box(rows):
    points = homogeneous_points(rows.points_px)
    return np.vstack([points.min(0), points.max(0)])


@given(seeds, dimensions)
def test_noise_free_sightings_give_back_the_truth(seed, dimension):
    scene = simulate_observations(dimension, 8, sigma_px=0, sigma_mm=0, seed=seed)
    found = sc.calibrate(scene.observations)
    np.testing.assert_allclose(found.probe_from_image.matrix, scene.probe_from_image.matrix, atol=1e-9)
    assert found.fit.max_mm < 1e-9


@given(seeds, dimensions)
def test_the_minimal_number_of_rows_without_noise_gives_back_the_truth_or_an_equal_fit(seed, dimension):
    scene = simulate_observations(dimension, 4 if dimension == 2 else 2, sigma_px=0, sigma_mm=0, seed=seed)
    found = sc.calibrate(scene.observations)
    assert found.fit.max_mm < 1e-6
    assert found.diagnostics[0].code == "no-redundancy"


@given(seeds, dimensions)
def test_moving_the_probe_marker_moves_the_calibration_with_it(seed, dimension):
    rows, marker = sweep(seed, dimension), random_similarity(seed, scale=1.0)
    moved = sc.calibrate(altered(rows, segments_mm=marker @ rows.segments_mm))
    expected = marker.matrix @ sc.calibrate(rows).probe_from_image.matrix
    np.testing.assert_allclose(moved.probe_from_image.matrix, expected, rtol=1e-6, atol=5e-5)


@given(seeds, dimensions)
def test_moving_the_probe_marker_leaves_predicted_errors_alone(seed, dimension):
    rows, marker = sweep(seed, dimension), random_similarity(seed, scale=1.0)
    moved = sc.calibrate(altered(rows, segments_mm=marker @ rows.segments_mm))
    np.testing.assert_allclose(
        moved.predicted_errors()[1], sc.calibrate(rows).predicted_errors()[1], rtol=1e-5
    )


@given(seeds, dimensions)
def test_the_order_of_rows_does_not_matter(seed, dimension):
    rows = sweep(seed, dimension)
    order = np.random.default_rng(seed).permutation(len(rows))
    shuffled, straight = sc.calibrate(rows.select(order)), sc.calibrate(rows)
    assert_same(shuffled, straight)
    np.testing.assert_array_equal(shuffled.inlier, straight.inlier[order])


@given(seeds, dimensions)
def test_reversing_segments_does_not_matter(seed, dimension):
    rows = sweep(seed, dimension)
    turned = np.random.default_rng(seed).random(24)[rows.frame] < 0.5
    segments = np.where(turned[:, None, None], rows.segments_mm[:, ::-1], rows.segments_mm)
    assert_same(sc.calibrate(altered(rows, segments_mm=segments)), sc.calibrate(rows))


@given(seeds, dimensions)
def test_where_on_the_line_the_segments_end_does_not_matter_to_the_geometric_cost(seed, dimension):
    rows, rng = sweep(seed, dimension), np.random.default_rng(seed)
    places = rng.uniform(-1, 2, (24, 2, 1))
    places[:, 1] = places[:, 0] + rng.choice([-1, 1], (24, 1)) * rng.uniform(0.2, 2, (24, 1))
    start, along = rows.segments_mm[:, :1], rows.segments_mm[:, 1:] - rows.segments_mm[:, :1]
    other = altered(rows, segments_mm=start + places[rows.frame] * along)
    assert_same(sc.calibrate(other, weighting="geometric"), sc.calibrate(rows, weighting="geometric"))


@given(seeds, dimensions, st.sampled_from([1e-3, 25.4, 1e4]))
def test_a_unit_of_length_scales_the_answer(seed, dimension, unit):
    rows = sweep(seed, dimension)
    found = sc.calibrate(altered(rows, segments_mm=rows.segments_mm * unit), threshold_mm=5 * unit)
    expected = sc.calibrate(rows).probe_from_image.matrix[:3] * unit
    np.testing.assert_allclose(found.probe_from_image.matrix[:3], expected, rtol=1e-6, atol=1e-6 * unit)


@given(seeds, dimensions, st.floats(1e-3, 1e3), st.floats(-1e4, 1e4))
def test_rescaled_and_shifted_pixels_give_the_same_places(seed, dimension, scale, shift):
    rows = sweep(seed, dimension)
    there = np.arange(1, dimension + 1) * shift
    found = sc.calibrate(altered(rows, points_px=rows.points_px * scale + there)).probe_from_image
    corners = box(rows)
    shifted = corners.copy()
    shifted[:, :dimension] = corners[:, :dimension] * scale + there
    np.testing.assert_allclose(found @ shifted, sc.calibrate(rows).probe_from_image @ corners, atol=1e-5)


@given(seeds)
def test_a_mirrored_2d_image_gives_the_same_places(seed):
    rows = sweep(seed, 2)
    mirrored = sc.calibrate(altered(rows, points_px=[500, 0] + rows.points_px * [-1, 1])).probe_from_image
    corners = box(rows)
    np.testing.assert_allclose(
        mirrored @ ([500, 0, 0] + corners * [-1, 1, 1]),
        sc.calibrate(rows).probe_from_image @ corners,
        atol=1e-6,
    )


@given(seeds, dimensions, st.integers(0, 3))
def test_the_seed_does_not_matter_where_the_answer_is_clear(seed, dimension, other):
    rows = sweep(seed, dimension)
    assert_same(sc.calibrate(rows, seed=other), sc.calibrate(rows))


@pytest.mark.parametrize("dimension", [2, 3])
def test_needles_that_tilt_in_one_plane_only_are_no_obstacle(dimension):
    """Coplanar directions leave no elimination by places along the lines alone."""
    truth, rng = random_similarity(3, scale=0.24), np.random.default_rng(3)
    per_needle = dimension - 1
    points = np.zeros((12, per_needle, 3))
    points[..., :dimension] = rng.uniform(0, 500, (12, per_needle, dimension))
    if dimension == 3:
        points[:, 1, 2] = points[:, 0, 2]  # image lines in planes w = const
    mapped = truth @ points
    angle = rng.uniform(0, np.pi, 12)
    planar = truth.rotation[:, 1] * np.cos(angle)[:, None] + truth.rotation[:, 2] * np.sin(angle)[:, None]
    along = planar if dimension == 2 else mapped[:, 1] - mapped[:, 0]
    segments = np.stack([mapped[:, 0] - along, mapped[:, 0] + 2 * along], axis=1)
    frame = np.repeat(np.arange(12), per_needle)
    rows = sc.Observations(points[..., :dimension].reshape(-1, dimension), segments[frame], frame=frame)
    np.testing.assert_allclose(sc.calibrate(rows).probe_from_image.matrix, truth.matrix, atol=1e-8)
