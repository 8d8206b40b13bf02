"""What must not change the numbers of a validation, or must change them in the obvious way."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import compare, held_out, leave_one_frame_out, validate
from sonocal.validation.whole import fitted_and_held_out, fitted_rows
from tests.builders.calibrations import parted_rows, slipped_rows, sound_calibration
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 1_000)
dimensions = st.sampled_from([2, 3])


def two_scans(seed, dimension):
    """Of one probe and marker."""
    rows = simulate_observations(dimension, 60, seed=seed).observations
    one, other = (rows.select(part) for part in (rows.frame < 30, rows.frame >= 30))
    return one, dataclasses.replace(other, source="other.csv")


def numbers(quantity):
    return np.array([quantity.value_mm, quantity.low_mm, quantity.high_mm, quantity.spread_mm])


@given(seeds, dimensions)
def test_moving_the_probe_marker_changes_no_number(seed, dimension):
    rows, other = two_scans(seed, dimension)
    marker = random_similarity(seed, scale=1.0)
    moved = [dataclasses.replace(part, segments_mm=marker @ part.segments_mm) for part in (rows, other)]
    for kind in (held_out, leave_one_frame_out):
        ours, theirs = kind(sc.calibrate(rows), other), kind(sc.calibrate(moved[0]), moved[1])
        np.testing.assert_allclose(numbers(theirs), numbers(ours), rtol=1e-5)
        assert (theirs.count, theirs.units) == (ours.count, ours.units)


@given(seeds, dimensions, st.sampled_from([1e-2, 25.4, 1e3]))
def test_a_unit_of_length_scales_every_number(seed, dimension, unit):
    rows, other = two_scans(seed, dimension)
    scaled = [dataclasses.replace(part, segments_mm=unit * part.segments_mm) for part in (rows, other)]
    found, larger = sc.calibrate(rows), sc.calibrate(scaled[0], threshold_mm=5 * unit)
    np.testing.assert_allclose(
        numbers(held_out(larger, scaled[1])), unit * numbers(held_out(found, other)), rtol=1e-5
    )


@given(seeds, dimensions)
def test_the_order_of_other_rows_changes_no_number(seed, dimension):
    rows, other = two_scans(seed, dimension)
    found, order = sc.calibrate(rows), np.random.default_rng(seed).permutation(len(other))
    ours, theirs = held_out(found, other), held_out(found, other.select(order))
    np.testing.assert_allclose(numbers(theirs), numbers(ours), rtol=1e-9)


@given(seeds, st.sampled_from(["fit", None]), st.sampled_from([3.0, 5.0, "auto"]))
def test_rows_are_fitted_or_held_out_and_never_both(seed, fit_split, threshold_mm):
    rows = parted_rows(seed)
    found = sc.calibrate(rows, fit_split=fit_split, test_split="test", threshold_mm=threshold_mm)
    given_to_fit, (fitted, unseen) = fitted_rows(found, rows), fitted_and_held_out(found, rows)
    assert len(given_to_fit) == found.fit.observations
    assert len(fitted) == found.fit.inliers
    assert len(unseen) == found.test.observations
    assert set(fitted.split) == {"fit"}
    assert set(unseen.split) == {"test"}


@given(seeds)
def test_a_file_read_back_validates_to_the_same(seed):
    rows = parted_rows(seed, moved_mm=1.0)
    found = sc.calibrate(rows, fit_split="fit", test_split="test", threshold_mm="auto")
    again = sc.calibration.parse_calibration(sc.calibration.calibration_json(found), "c.json")
    ours, theirs = (validate(one, rows, resample=False) for one in (found, again))
    for one, other in zip(ours.quantities, theirs.quantities, strict=True):
        np.testing.assert_allclose(numbers(other), numbers(one), rtol=1e-12)
    assert ours.diagnostics == theirs.diagnostics == ()


@given(seeds, dimensions)
def test_a_comparison_is_the_same_both_ways_round_and_none_with_itself(seed, dimension):
    size = (500,) * dimension
    one, other = (sc.calibrate(part, image_size_px=size) for part in two_scans(seed, dimension))
    there, back = compare(one, other), compare(other, one)
    np.testing.assert_allclose(there.difference_mm, -back.difference_mm, atol=1e-9)
    np.testing.assert_allclose(there.allowed_mm, back.allowed_mm, rtol=1e-9)
    assert there.p_value == pytest.approx(back.p_value, rel=1e-5, abs=1e-12)
    assert not compare(one, one).differ


def test_rows_fitted_in_part_are_other_input():
    rows = parted_rows()
    whole, part = sc.calibrate(rows), sc.calibrate(rows, fit_split="fit")
    assert not compare(whole, part).shared_input
    assert compare(part, sc.calibrate(rows, fit_split="fit", tolerance_mm=1.0)).shared_input


# What validation finds


def test_what_the_calibration_has_found_already_is_no_news():
    rows = slipped_rows()
    found = sc.calibrate(rows)
    assert "marker-slipped" in [finding.code for finding in found.warnings]
    assert validate(found, rows, resample=False).diagnostics == ()


def test_what_a_file_did_not_know_is_found_now():
    rows = slipped_rows()
    found = dataclasses.replace(sc.calibrate(rows), diagnostics=())
    assert "marker-slipped" in [finding.code for finding in validate(found, rows, resample=False).diagnostics]


def test_what_is_known_now_is_looked_at_now():
    found, rows = sound_calibration(), simulate_observations(2, 60, seed=1).observations
    mirrored = found.probe_from_image.rotation @ np.diag([-1.0, 1, -1])
    known = [
        ({}, []),
        ({"scanner_mm_per_px": 0.3}, ["scale-differs-from-scanner"]),
        ({"scanner_mm_per_px": found.probe_from_image.scales[0]}, []),
        ({"expected_rotation": mirrored}, ["flipped-image"]),
        ({"expected_rotation": found.probe_from_image.rotation}, []),
    ]
    for told, codes in known:
        said = validate(found, rows, resample=False, **told).diagnostics
        assert [finding.code for finding in said] == codes, told


def test_another_scan_that_is_wrong_is_said_to_be():
    other = dataclasses.replace(slipped_rows(), source="later.csv")
    said = validate(sound_calibration(), other, resample=False).diagnostics
    assert {"held-out-rows-far-off", "wrong-tool-frame"} & {finding.code for finding in said}
