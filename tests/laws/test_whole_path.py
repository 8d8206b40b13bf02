"""Laws of `calibrate()` as a black box, on scans from a simulator that shares nothing with the package's own."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.scans import IMAGE, SCALE, scan
from hypothesis import given, settings
from hypothesis import strategies as st

import sonocal as sc
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 3_000)
dimensions = st.sampled_from([2, 3])
quick = settings(max_examples=12)
CORNERS = {d: np.indices((2,) * d).reshape(d, -1).T * IMAGE for d in (2, 3)}


def scanned(seed, dimension, **changes):
    """Some forty frames without outliers, unless they are asked for."""
    return scan(seed, **{"dimension": dimension, "frames": 40, "outliers": 0.0} | changes)


def altered(rows, **columns):
    return dataclasses.replace(rows, **columns)


def size_of(dimension):
    return (round(IMAGE) + 1,) * dimension


def calibrated(rows, **options):
    return sc.calibrate(rows, image_size_px=size_of(rows.dimension), **options)


def predicted(found):
    """(M,), mm: what 95 % of errors stay below, at corners and centre."""
    return found.predicted_errors()[2]


def assert_same(found, expected, atol=1e-6):
    np.testing.assert_allclose(found.probe_from_image.matrix, expected.probe_from_image.matrix, atol=atol)


def distances(transform, rows):
    """(N,), mm: from points to their lines, by the cross product."""
    along = rows.segments_mm[:, 1] - rows.segments_mm[:, 0]
    away = (transform @ rows.points_px) - rows.segments_mm[:, 0]
    return np.linalg.norm(np.cross(away, along), axis=1) / np.linalg.norm(along, axis=1)


def moved_at_corners(one, other, dimension):
    return np.linalg.norm((one @ CORNERS[dimension]) - (other @ CORNERS[dimension]), axis=1)


@quick
@given(seeds, dimensions)
def test_without_noise_the_truth_comes_back(seed, dimension):
    made = scanned(seed, dimension, sigma_px=0.0, sigma_mm=0.0)
    found = calibrated(made.observations)
    np.testing.assert_allclose(found.probe_from_image.matrix, made.truth.matrix, atol=1e-6)


@quick
@given(seeds, dimensions)
def test_residuals_are_distances_and_inliers_are_those_within_the_threshold(seed, dimension):
    made = scanned(seed, dimension, outliers=0.1)
    found = calibrated(made.observations, threshold_mm=4.0)
    expected = distances(found.probe_from_image, made.observations)
    np.testing.assert_allclose(found.residuals_mm, expected, atol=1e-8)
    np.testing.assert_array_equal(found.inlier, expected <= 4.0)


@quick
@given(seeds, dimensions)
def test_the_fits_numbers_are_numpys_of_the_inliers(seed, dimension):
    found = calibrated(scanned(seed, dimension, outliers=0.1).observations)
    inside = found.residuals_mm[found.inlier]
    assert (found.fit.observations, found.fit.inliers) == (len(found.inlier), found.inlier.sum())
    assert found.fit.rms_mm == pytest.approx(np.sqrt(np.mean(inside**2)))
    assert found.fit.median_mm == pytest.approx(np.median(inside))
    assert found.fit.p95_mm == pytest.approx(np.percentile(inside, 95))
    assert found.fit.max_mm == pytest.approx(inside.max())


@quick
@given(seeds, dimensions)
def test_new_numbers_of_frames_and_names_of_targets_change_nothing(seed, dimension):
    rows = scanned(seed, dimension).observations
    numbers = np.random.default_rng(seed).permutation(10_000)[: rows.frame.max() + 1]
    renamed = altered(rows, frame=numbers[rows.frame], target=np.char.add(rows.target, " of steel"))
    found, expected = calibrated(renamed), calibrated(rows)
    assert_same(found, expected)
    np.testing.assert_array_equal(found.inlier, expected.inlier)


@quick
@given(seeds)
def test_the_order_of_points_within_a_sighting_changes_nothing(seed):
    rows = scanned(seed, 3).observations
    order = np.arange(len(rows)).reshape(-1, 2)
    flipped = np.random.default_rng(seed).random(len(order)) < 0.5
    order[flipped] = order[flipped, ::-1]
    found, expected = calibrated(rows.select(order.reshape(-1))), calibrated(rows)
    assert_same(found, expected)
    np.testing.assert_allclose(predicted(found), predicted(expected), rtol=1e-5)


@quick
@given(seeds, dimensions)
def test_reversed_segments_and_shuffled_rows_predict_the_same_errors(seed, dimension):
    rows = scanned(seed, dimension).observations
    order = np.random.default_rng(seed).permutation(len(rows))
    reversed_ones = altered(rows, segments_mm=rows.segments_mm[:, ::-1])
    expected = predicted(calibrated(rows))
    for other in (reversed_ones, rows.select(order)):
        np.testing.assert_allclose(predicted(calibrated(other)), expected, rtol=1e-4)


@quick
@given(seeds, dimensions, st.sampled_from([0.1, 0.5, 3.0, 40.0]))
def test_a_resampled_image_maps_the_same_places_and_predicts_the_same_errors(seed, dimension, factor):
    rows = scanned(seed, dimension).observations
    size = tuple(round(IMAGE * factor) + 1 for _ in range(dimension))
    found = sc.calibrate(altered(rows, points_px=rows.points_px * factor), image_size_px=size)
    expected = calibrated(rows)
    np.testing.assert_allclose(
        found.probe_from_image @ (CORNERS[dimension] * factor),
        expected.probe_from_image @ CORNERS[dimension],
        atol=1e-5,
    )
    np.testing.assert_allclose(predicted(found), predicted(expected), rtol=1e-4)


@quick
@given(seeds, dimensions)
def test_the_uncertainty_of_a_place_turns_with_the_marker(seed, dimension):
    rows, marker = scanned(seed, dimension).observations, random_similarity(seed, scale=1.0)
    plain, moved = calibrated(rows), calibrated(altered(rows, segments_mm=marker @ rows.segments_mm))
    places, covariances = plain.predict(CORNERS[dimension])
    moved_places, moved_covariances = moved.predict(CORNERS[dimension])
    turn = marker.rotation
    np.testing.assert_allclose(moved_places, marker @ places, atol=1e-5)
    np.testing.assert_allclose(moved_covariances, turn @ covariances @ turn.T, rtol=1e-3, atol=1e-6)


@quick
@given(seeds, dimensions)
def test_rows_that_see_anything_anywhere_move_the_answer_by_less_than_its_error(seed, dimension):
    made, rng = scanned(seed, dimension), np.random.default_rng(seed)
    rows, wrong = made.observations, rng.permutation(40)[:10]
    points = rows.points_px.copy()
    hit = np.isin(rows.frame, wrong)
    points[hit] = rng.uniform(0, IMAGE, (hit.sum(), dimension))
    clean, spoilt = (
        calibrated(table, threshold_mm="auto")
        for table in (rows.select(~hit), altered(rows, points_px=points))
    )
    moved = moved_at_corners(spoilt.probe_from_image, clean.probe_from_image, dimension)
    assert np.all(moved < predicted(clean)[:-1])


@quick
@given(seeds, dimensions)
def test_half_the_noise_is_about_half_the_predicted_error(seed, dimension):
    loud, quiet = (
        calibrated(scanned(seed, dimension, frames=120, sigma_px=s, sigma_mm=s / 2).observations)
        for s in (1.0, 0.5)
    )
    ratio = predicted(quiet) / predicted(loud)
    assert np.all((ratio > 0.35) & (ratio < 0.7))


@quick
@given(seeds, dimensions)
def test_four_times_the_frames_lower_the_predicted_error(seed, dimension):
    rows = scanned(seed, dimension, frames=160).observations
    few, many = calibrated(rows.select(rows.frame % 4 == 0)), calibrated(rows)
    assert np.all(predicted(many) < predicted(few))


@quick
@given(seeds, dimensions, st.floats(0.2, 5.0))
def test_known_noise_is_the_same_as_an_option_and_as_columns_whose_product_counts(seed, dimension, factor):
    rows = scanned(seed, dimension).observations
    ones = np.ones(len(rows))
    options = calibrated(rows, sigma_px=1.0, sigma_mm=0.5)
    columns = calibrated(altered(rows, sigma_px=1.0 * ones, sigma_mm=0.5 * ones), sigma_px=1.0, sigma_mm=1.0)
    shared = calibrated(
        altered(rows, sigma_px=ones / factor, sigma_mm=0.5 * ones / factor), sigma_px=factor, sigma_mm=factor
    )
    for other in (columns, shared):
        assert_same(other, options)
        np.testing.assert_allclose(predicted(other), predicted(options), rtol=1e-5)


@quick
@given(seeds, dimensions)
def test_the_same_table_as_another_split_is_held_out_with_the_fits_own_errors(seed, dimension):
    rows = scanned(seed, dimension).observations
    twice = sc.Observations(
        np.concatenate([rows.points_px] * 2),
        np.concatenate([rows.segments_mm] * 2),
        frame=np.concatenate([rows.frame] * 2),
        split=np.repeat(["fit", "test"], len(rows)),
    )
    found, alone = calibrated(twice, fit_split="fit", test_split="test"), calibrated(rows)
    assert_same(found, alone, atol=1e-12)
    inside = distances(found.probe_from_image, rows)
    assert found.test.rms_mm == pytest.approx(np.sqrt(np.mean(inside**2)))
    assert found.test.max_mm == pytest.approx(inside.max())


@quick
@given(seeds, dimensions)
def test_frames_of_one_number_in_two_splits_are_two_images(seed, dimension):
    rows = scanned(seed, dimension).observations
    late = rows.frame >= 20
    again = altered(rows, frame=rows.frame % 20, split=np.where(late, "second", "first"))
    found, expected = calibrated(again), calibrated(rows)
    assert_same(found, expected)
    np.testing.assert_allclose(predicted(found), predicted(expected), rtol=1e-9)


@quick
@given(seeds, dimensions)
def test_held_out_rows_say_nothing_to_the_fit(seed, dimension):
    rows, rng = scanned(seed, dimension).observations, np.random.default_rng(seed)
    out = rows.frame % 3 == 0
    split = np.where(out, "test", "fit")
    spoilt = np.where(out[:, None], rng.uniform(0, IMAGE, rows.points_px.shape), rows.points_px)
    one = calibrated(altered(rows, split=split), test_split="test")
    other = calibrated(altered(rows, split=split, points_px=spoilt), test_split="test")
    assert_same(other, one, atol=1e-12)
    assert other.test.rms_mm > one.test.rms_mm
    assert one.fit == other.fit


@quick
@given(seeds, dimensions)
def test_what_is_asked_about_the_image_does_not_move_the_answer(seed, dimension):
    rows = scanned(seed, dimension).observations
    plain = sc.calibrate(rows)
    sized = sc.calibrate(rows, image_size_px=(2000,) * dimension, tolerance_mm=1e-3)
    assert_same(sized, plain, atol=1e-12)
    assert predicted(sized).max() > predicted(plain).max()
    codes = {finding.code for finding in sized.warnings}
    assert {finding.code for finding in plain.warnings} <= codes
    assert len(codes) > 0


@quick
@given(seeds, dimensions)
def test_a_saved_calibration_predicts_as_the_one_it_was(tmp_path_factory, seed, dimension):
    found, path = calibrated(scanned(seed, dimension).observations), tmp_path_factory.mktemp("a") / "a.json"
    found.save(path)
    again = sc.load(path)
    for a, b in zip(again.predict(CORNERS[dimension]), found.predict(CORNERS[dimension]), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(predicted(again), predicted(found), rtol=1e-9)
    np.testing.assert_array_equal(again.inlier, found.inlier)
    assert again.warnings == found.warnings


@quick
@given(seeds, dimensions, st.integers(1, 60))
def test_the_places_predicted_are_those_mapped_one_by_one(seed, dimension, count):
    found = calibrated(scanned(seed, dimension).observations)
    points = np.random.default_rng(seed).uniform(0, IMAGE, (count, dimension))
    places, covariances = found.predict(points)
    np.testing.assert_allclose(places, found.probe_from_image @ points)
    np.testing.assert_allclose(covariances, np.swapaxes(covariances, 1, 2), atol=1e-12)
    assert np.all(np.linalg.eigvalsh(covariances) > -1e-12)
    alone = found.predict(points[:1])[1]
    np.testing.assert_allclose(alone, covariances[:1])


@pytest.mark.parametrize("dimension", [2, 3])
def test_nineteen_of_twenty_calibrations_are_within_the_predicted_error(dimension):
    """At the corners of the image, over scans of their own; fewer are within where predictions flatter."""
    inside = []
    for seed in range(60):
        made = scanned(10_000 + seed, dimension, frames=60)
        found = calibrated(made.observations)
        off = moved_at_corners(found.probe_from_image, made.truth, dimension)
        inside.append(off < predicted(found)[:-1])
    assert 0.85 < np.mean(inside) <= 1.0
    assert made.truth.scale == SCALE


@quick
@given(seeds, dimensions)
def test_both_weightings_agree_within_the_predicted_error(seed, dimension):
    rows = scanned(seed, dimension, frames=80).observations
    likelihood, geometric = calibrated(rows), calibrated(rows, weighting="geometric")
    moved = moved_at_corners(likelihood.probe_from_image, geometric.probe_from_image, dimension)
    assert np.all(moved < predicted(geometric)[:-1] + predicted(likelihood)[:-1])


@quick
@given(seeds)
def test_two_scales_of_square_pixels_are_alike_within_their_error(seed):
    rows = scanned(seed, 2, frames=80).observations
    one, two = calibrated(rows), calibrated(rows, model="anisotropic")
    moved = moved_at_corners(one.probe_from_image, two.probe_from_image, 2)
    assert np.all(moved < predicted(one)[:-1] + predicted(two)[:-1])


@quick
@given(seeds, st.floats(0.3, 3.0))
def test_with_two_scales_squeezing_the_image_squeezes_its_pixels_alone(seed, squeeze):
    """To the geometric cost: the noise of a squeezed pixel is another along u than along v."""
    rows = scanned(seed, 2, frames=80).observations
    options = {"model": "anisotropic", "weighting": "geometric"}
    squeezed = altered(rows, points_px=rows.points_px * [1.0, squeeze])
    two, again = calibrated(rows, **options), sc.calibrate(squeezed, **options)
    np.testing.assert_allclose(
        again.probe_from_image @ (CORNERS[2] * [1.0, squeeze]), two.probe_from_image @ CORNERS[2], atol=1e-4
    )
