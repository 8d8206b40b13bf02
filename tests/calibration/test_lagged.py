"""A table that is calibrated with its lag: what the calibration, its file and its words say of it."""

import dataclasses
import json

import numpy as np
import pytest
from benchmarks.simulators.late import late_scan

import sonocal as sc
from sonocal.calibration import calibration_json, parse_calibration
from sonocal.calibration.lagged import lag_in_words, rows_at_lag
from sonocal.observations.velocities import with_velocities


@pytest.fixture(scope="module")
def scan():
    return late_scan(2, "usual", 0.13, frames=300)


@pytest.fixture(scope="module")
def found(scan):
    return sc.calibrate(scan.observations, latency="estimate")


def test_the_lag_and_its_interval_are_in_the_calibration_and_in_its_file(found):
    low, high = found.latency_interval_s
    assert low < 0.13 < high
    assert low < found.latency_s < high
    record = json.loads(calibration_json(found))
    assert record["latency_s"] == found.latency_s
    assert record["latency_interval_s"] == [low, high]
    assert record["provenance"]["options"]["latency_asked"] == "estimate"
    again = parse_calibration(calibration_json(found), "calibration.json")
    assert (again.latency_s, again.latency_interval_s) == (found.latency_s, found.latency_interval_s)
    assert again.options.latency is None  # its rows are not late any more


def test_a_file_without_an_interval_is_read(found):
    record = json.loads(calibration_json(found))
    del record["latency_interval_s"]
    assert parse_calibration(json.dumps(record).encode(), "old.json").latency_interval_s is None


def test_the_rows_keep_their_number_and_their_order(scan, found):
    assert found.fit.observations == len(found.residuals_mm) == len(scan.observations)
    from sonocal.calibration import line_distances

    moved = rows_at_lag(scan.observations, found.latency_s)
    np.testing.assert_allclose(found.residuals_mm, line_distances(found.probe_from_image, moved), atol=1e-9)
    beyond = scan.observations.extra["time_s"].astype(float) + found.latency_s > 15.01
    assert beyond.any()
    assert not found.inlier[beyond].any()


def test_the_lag_s_own_uncertainty_is_in_the_covariance(scan, found):
    known = sc.calibrate(rows_at_lag(scan.observations, found.latency_s))
    with_known = sc.calibrate(
        rows_at_lag(scan.observations, found.latency_s).select(
            scan.observations.extra["time_s"].astype(float) + found.latency_s < 14.9
        )
    )
    added = np.linalg.eigvalsh(found.covariance - 0.9 * with_known.covariance)
    assert added.max() > 0
    assert found.predicted_errors()[2].max() > 0.99 * known.predicted_errors()[2].max()


def test_no_finding_of_a_lag_is_left(found):
    assert not [one for one in found.diagnostics if one.code.startswith("latency")]


def test_the_finding_and_the_estimate_agree():
    for seed in range(6):
        rows = late_scan(seed, "slow", 0.06, frames=300).observations
        (late,) = [one for one in sc.calibrate(rows).diagnostics if one.code == "latency"]
        estimate = sc.calibrate(rows, latency="estimate")
        named = float(late.advice.split("--latency ")[1].split()[0])
        low, high = estimate.latency_interval_s
        assert low - 0.003 < named < high + 0.003
    assert seed == 5


def test_a_lag_that_changes_in_time_stays_a_finding():
    rows = late_scan(0, "usual", 0.08, change_s=0.08, frames=400).observations
    found = sc.calibrate(rows, latency="estimate")
    (changing,) = [
        one for one in found.diagnostics if one.code == "latency" and "changes during the scan" in one.message
    ]
    words = changing.message
    begin, end = (float(words.split(mark)[1].split()[0]) for mark in ("from some ", " begin to "))
    assert (begin, end) == pytest.approx((40, 120), abs=15)


def test_held_out_rows_are_moved_with_the_others(scan):
    split = np.where(scan.observations.frame % 5 == 0, "test", "fit")
    rows = dataclasses.replace(scan.observations, split=split)
    found = sc.calibrate(rows, latency="estimate", test_split="test")
    assert found.latency_s == pytest.approx(0.13, abs=0.004)
    assert found.test.median_mm < 2 * found.fit.median_mm


def test_a_table_of_3d_sightings_has_a_lag_too():
    scan = late_scan(1, "usual", -0.09, frames=200, dimension=3)
    rows = with_velocities(scan.observations, scan.velocities)
    found = sc.calibrate(rows, latency="estimate")
    low, high = found.latency_interval_s
    assert low - 0.002 < -0.09 < high + 0.002


def test_the_lag_in_words(found):
    assert lag_in_words(dataclasses.replace(found, latency_s=None)) == ""
    told = dataclasses.replace(found, latency_s=0.1013, latency_interval_s=(0.1002, 0.1024))
    assert lag_in_words(told) == (
        "Lag: the tracker's stamps are 101.3 ms later than the images' (100.2 to 102.4 ms, 95 %), estimated with the "
        "calibration; undone."
    )
    assert "as was said" in lag_in_words(dataclasses.replace(told, latency_interval_s=None))


def test_only_an_estimate_can_be_asked_of_a_table(scan):
    with pytest.raises(sc.InputError, match=r"latency must be one of estimate; got 0.1"):
        sc.calibrate(scan.observations, latency=0.1)
