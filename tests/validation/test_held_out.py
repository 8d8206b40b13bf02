"""Held-out rows, leave-one-out and repeatability against what they must be."""

import dataclasses

import numpy as np
import pytest

import sonocal as sc
from sonocal.calibration import line_distances
from sonocal.calibration.held_out import independent_units
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import held_out, leave_one_frame_out, leave_one_target_out, repeatability
from sonocal.validation.held_out import (
    refitted,
)
from sonocal.validation.repeatability import _balanced_halves
from tests.builders.similarities import random_similarity


@pytest.fixture(scope="module")
def scan():
    rows = simulate_observations(2, 40, seed=3).observations
    calibration = sc.calibrate(rows)
    return calibration, rows.select(calibration.inlier)


def with_targets(rows, count):
    return dataclasses.replace(rows, target=(np.arange(len(rows)) % count).astype(str))


def test_held_out_is_the_calibrations_own_test_error():
    rows = simulate_observations(2, 60, outlier_share=0.1, seed=3).observations
    rows = dataclasses.replace(rows, split=np.where(np.arange(60) < 40, "fit", "test"))
    found = sc.calibrate(rows, fit_split="fit", test_split="test")
    quantity = held_out(found, rows.select_split("test"))
    assert quantity.value_mm == pytest.approx(found.test.rms_mm)
    assert (quantity.count, quantity.units) == (20, 20)


def test_leaving_a_frame_out_is_fitting_the_others(scan):
    calibration, rows = scan
    by_hand = []
    for frame in rows.frame:
        others = sc.calibrate(rows.select(rows.frame != frame))
        by_hand.append(line_distances(others.probe_from_image, rows.select(rows.frame == frame))[0])
    found = leave_one_frame_out(calibration, rows)
    assert found.value_mm == pytest.approx(np.sqrt(np.mean(np.square(by_hand))), rel=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
def test_an_error_left_out_is_larger_than_the_fits(dimension):
    rows = simulate_observations(dimension, 20, seed=4).observations
    calibration = sc.calibrate(rows)
    rows = with_targets(rows.select(calibration.inlier), 4)
    for leave_out in (leave_one_frame_out, leave_one_target_out):
        assert leave_out(calibration, rows).value_mm > calibration.fit.rms_mm


def test_each_frame_its_own_target_makes_both_the_same(scan):
    calibration, rows = scan
    rows = dataclasses.replace(rows, target=rows.frame.astype(str))
    frames, targets = leave_one_frame_out(calibration, rows), leave_one_target_out(calibration, rows)
    assert frames.value_mm == pytest.approx(targets.value_mm)


def test_a_wire_that_is_off_shows_when_it_is_left_out(scan):
    calibration, rows = scan
    rows = with_targets(rows, 8)
    off = rows.segments_mm + np.where(rows.target == "0", 2.5, 0.0)[:, None, None] * [1.0, 0.5, -0.7]
    rows = dataclasses.replace(rows, segments_mm=off)
    calibration = sc.calibrate(rows)
    assert leave_one_target_out(calibration, rows).value_mm > leave_one_frame_out(calibration, rows).value_mm


def test_too_few_targets_are_refused_with_the_remedy(scan):
    calibration, rows = scan
    with pytest.raises(sc.UnsupportedError) as caught:
        leave_one_target_out(calibration, rows)
    assert str(caught.value) == (
        "simulation (seed 3): has 1 target and leaving one out needs three or more; name needles or wires apart in "
        "the column target"
    )


def test_what_is_left_must_hold_every_motion(scan):
    calibration, rows = scan
    keep = np.zeros(len(rows), dtype=bool)
    keep[:3] = True
    with pytest.raises(sc.InputError, match="3 rows are left, too few to fit"):
        refitted(calibration, rows, keep)


def test_drifting_frames_count_as_few():
    rng, truth = np.random.default_rng(0), random_similarity(0, scale=0.24)
    frame = np.repeat(np.arange(120), 3)
    points = rng.uniform(0, 500, (360, 2))
    middle = truth @ points + np.sin(frame / 8)[:, None] * [1.0, -0.5, 0.5] + 0.1 * rng.normal(size=(360, 3))
    along = rng.normal(size=(360, 3)) * 50
    rows = sc.Observations(points, np.stack([middle - along, middle + along], axis=1), frame=frame)
    assert len(np.unique(independent_units(truth, rows))) < 20


# Repeatability


def test_repeatability_is_the_spread_over_repeated_scans():
    """Against 400 scans made anew: their true errors, whose bias is negligible, have this spread."""
    squares, said = [], []
    for seed in range(400):
        simulated = simulate_observations(2, 40, seed=seed)
        found = sc.calibrate(simulated.observations, image_size_px=(500, 500))
        places = found.predicted_errors()[0][:-1]
        missed = found.probe_from_image @ places - simulated.probe_from_image @ places
        squares.append(np.sum(missed**2, axis=1).mean())
        if seed % 10 == 0:
            rows = simulated.observations.select(found.inlier)
            said.append(repeatability(found, rows).corners.value_mm ** 2)
    assert np.sqrt(np.mean(said)) == pytest.approx(np.sqrt(np.mean(squares)), rel=0.1)


def test_repeatability_is_the_same_for_the_same_seed_and_near_for_another(scan):
    calibration, rows = scan
    first, again, other = (repeatability(calibration, rows, seed=seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first.places_mm, again.places_mm)
    assert other.corners.value_mm == pytest.approx(first.corners.value_mm, rel=0.25)
    assert first.centre.value_mm < first.corners.value_mm


def test_moving_the_probe_marker_leaves_repeatability_alone(scan):
    calibration, rows = scan
    moved = dataclasses.replace(rows, segments_mm=random_similarity(1, scale=1.0) @ rows.segments_mm)
    np.testing.assert_allclose(
        repeatability(sc.calibrate(moved), moved).places_mm,
        repeatability(calibration, rows).places_mm,
        rtol=1e-3,
    )


@pytest.mark.parametrize("count", [8, 15, 16, 50, 60])
def test_any_two_frames_are_together_in_half_of_the_splits(count):
    signs = np.where(_balanced_halves(count, seed=3), 1, -1)
    np.testing.assert_array_equal(signs.T @ signs, len(signs) * np.eye(count))
    smallest = np.minimum((signs > 0).sum(axis=1), (signs < 0).sum(axis=1)).min()
    assert smallest >= count // 8


def test_few_frames_have_no_repeatability(scan):
    calibration, rows = scan
    with pytest.raises(
        sc.UnsupportedError, match="has 7 independent frames and repeatability needs 8 or more"
    ):
        repeatability(calibration, rows.select(np.arange(7)))
