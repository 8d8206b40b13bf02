"""Rows that were held out, and are further off than the fit and its uncertainty explain: a finding of calibrate()."""

import dataclasses

import numpy as np
import pytest
from benchmarks.comparison import needle_scan
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration.held_out import held_out_errors, held_out_findings
from sonocal.calibration.statistics import rms_interval
from sonocal.validation import held_out, validate
from tests.builders.calibrations import parted_rows
from tests.builders.similarities import random_similarity

CODE = "held-out-rows-off"
CODES = {CODE, "held-out-rows-far-off"}
SEEDS = range(30)


def surprised(rows, **options):
    found = sc.calibrate(rows, fit_split="fit", test_split="test", **options)
    return [finding for finding in found.warnings if finding.code in CODES]


def test_held_out_rows_of_the_same_scan_are_no_surprise():
    assert sum(bool(surprised(parted_rows(seed))) for seed in SEEDS) <= 1


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("fitted", "unseen", "scans", "most"), [(8, 100, 100, 3), (50, 50, 20, 1)])
def test_few_fitted_rows_are_no_surprise_to_many_that_are_not(fitted, unseen, scans, most, dimension):
    # The mean of few squares is as unsure as that of many held-out ones is sure: 6 % were accused for (8, 100) in 3D.
    said = 0
    for seed in range(scans):
        rng = np.random.default_rng([seed, dimension, fitted, unseen])
        truth = (Rotation.random(random_state=seed).as_matrix(), rng.uniform(-100, 100, 3))
        rows = needle_scan(rng, truth, dimension, fitted + unseen)
        rows = dataclasses.replace(rows, split=np.where(rows.frame < fitted, "fit", "test"))
        said += bool(surprised(rows, image_size_px=(500,) * dimension))
    assert said <= most


def test_held_out_rows_that_moved_are_a_surprise():
    assert sum(bool(surprised(parted_rows(seed, moved_mm=4.0))) for seed in SEEDS) >= 29


def test_the_finding_has_validations_number():
    rows = parted_rows(moved_mm=4.0)
    found = sc.calibrate(rows, fit_split="fit", test_split="test")
    (finding,) = surprised(rows)
    quantity = held_out(found, rows.select_split("test"))
    assert f"are off by {quantity.value_mm:.2f} mm rms (at least {quantity.low_mm:.2f})" in finding.message


def test_validation_finds_the_same_in_the_same_rows_elsewhere():
    rows = parted_rows(moved_mm=4.0)
    alone = sc.calibrate(rows, fit_split="fit")
    assert CODE not in [finding.code for finding in alone.warnings]
    other = dataclasses.replace(rows.select_split("test"), source="other.csv")
    said = validate(alone, other, resample=False).diagnostics
    assert [finding for finding in said if finding.code == CODE] == surprised(rows)


@settings(max_examples=12)
@given(st.integers(0, 300), st.floats(0, 8), st.floats(0, 8))
def test_the_further_off_the_more_surprising(seed, one, other):
    less, more = sorted([one, other])
    if surprised(parted_rows(seed, moved_mm=less)) and less > 2.0:
        assert surprised(parted_rows(seed, moved_mm=more))


@settings(max_examples=10)
@given(st.integers(0, 300), st.sampled_from([0.0, 4.0]))
def test_moving_the_probe_marker_changes_nothing_of_it(seed, moved_mm):
    rows, marker = parted_rows(seed, moved_mm=moved_mm), random_similarity(seed, scale=1.0)
    moved = dataclasses.replace(rows, segments_mm=marker @ rows.segments_mm)
    assert [f.message for f in surprised(moved)] == [f.message for f in surprised(rows)]


def test_without_a_predicted_error_nothing_is_a_surprise():
    rows = parted_rows(moved_mm=4.0)
    found = sc.calibrate(rows, fit_split="fit")
    assert not list(held_out_findings(dataclasses.replace(found, covariance=None), rows.select_split("test")))
    assert not list(held_out_findings(found, None))


def test_held_out_errors_count_all_rows():
    rows = parted_rows(moved_mm=4.0).select_split("test")
    found = sc.calibrate(parted_rows(), fit_split="fit")
    errors = held_out_errors(found.probe_from_image, rows, 1.0)
    assert (errors.observations, errors.inliers < len(rows)) == (len(rows), True)
    assert held_out_errors(found.probe_from_image, None, 1.0) is None


@given(st.integers(0, 1000), st.floats(1e-3, 1e3))
def test_an_interval_scales_with_its_unit_and_holds_the_number(seed, unit):
    rng = np.random.default_rng(seed)
    errors, groups = np.abs(rng.normal(size=40)), np.arange(40) // 2
    low, high = rms_interval(errors, groups)
    assert 0 < low < np.sqrt(np.mean(errors**2)) < high
    np.testing.assert_allclose(rms_interval(errors * unit, groups), [low * unit, high * unit], rtol=1e-9)
    order = rng.permutation(40)
    np.testing.assert_allclose(rms_interval(errors[order], groups[order]), [low, high], rtol=1e-12)


def test_few_units_have_no_interval():
    assert np.isnan(rms_interval(np.ones(4), np.array([0, 0, 1, 1]))).all()
    assert not surprised(parted_rows(count=42, fitted=40, moved_mm=50.0))


@pytest.mark.parametrize("name", ["fit_split", "test_split"])
def test_a_split_that_is_not_there_is_refused(name):
    with pytest.raises(sc.InputError, match="no row has split 'x'; the splits in it are 'fit', 'test'"):
        sc.calibrate(parted_rows(), **{name: "x"})
