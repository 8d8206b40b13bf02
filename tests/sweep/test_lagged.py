"""A recording that is calibrated with its lag: what comes out, what it equals, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.simulators.late import NEEDLE, late_scan
from hypothesis import given, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal.observations.velocities import velocities_of
from sonocal.recording import Recording, join, with_latency
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from sonocal.sweep import Posing, calibrate_points, calibrate_recording, tabulate
from sonocal.sweep.lagged import with_line_velocities


def estimated(scan, recording=None):
    return calibrate_points(recording or scan.recording, [NEEDLE], scan.detections, latency="estimate")


@pytest.fixture(scope="module")
def scan():
    return late_scan(4, "usual", -0.11, frames=300)


def test_it_is_the_calibration_with_that_latency_but_for_what_is_unknown_of_it(scan):
    found, rows = estimated(scan)
    low, high = found.latency_interval_s
    assert low < -0.11 < high
    known, same = calibrate_points(with_latency(scan.recording, found.latency_s), [NEEDLE], scan.detections)
    np.testing.assert_array_equal(found.probe_from_image.matrix, known.probe_from_image.matrix)
    np.testing.assert_array_equal(rows.segments_mm, same.segments_mm)
    grown = np.linalg.eigvalsh(found.covariance - known.covariance)
    assert grown[-1] > 0
    np.testing.assert_allclose(grown[:-1], 0, atol=1e-9 * np.abs(found.covariance).max())  # of rank one


def test_no_finding_of_the_lag_or_of_what_it_takes_out_of_the_recording_is_left(scan):
    found, _ = estimated(scan)
    assert not [one for one in found.warnings if one.code.startswith(("latency", "no-pose"))]


@settings(max_examples=4, deadline=None)
@given(st.integers(0, 100), st.floats(-0.08, 0.08))
def test_stamps_that_are_later_make_the_lag_larger_by_as_much(seed, later):
    scan = late_scan(seed, "usual", 0.09, frames=240)
    log = Recording(times=scan.recording.times + later, poses=scan.recording.poses)
    images = replace(scan.recording, poses={})
    one, other = estimated(scan)[0], estimated(scan, join(images, log))[0]
    # The log's poses were interpolated once more, which takes some of their noise away.
    assert other.latency_s - one.latency_s == pytest.approx(
        later, abs=one.latency_interval_s[1] - one.latency_s
    )


def test_the_needle_is_found_in_images_whose_poses_are_late():
    options = SweepOptions(frames=120, rate_hz=10, sigma_px=0.3, sigma_mm=0.3, latency_s=0.12, seed=1)
    sweep = simulate_sweep(curvilinear(128, 128, 0.94), BATH, options)
    found = calibrate_recording(sweep.recording, sweep.lines, latency="estimate")
    low, high = found.calibration.latency_interval_s
    assert low - 0.005 < 0.12 < high + 0.005
    assert high - low < 0.03
    assert len(found.calibration.inlier) == len(found.observations)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda one: replace(one, times=np.full(len(one), np.nan)), "items have no times"),
        (lambda one: with_latency(one, 0.05), "estimate the lag of the recording as it was read"),
    ],
)
def test_a_recording_that_has_no_lag_to_estimate_is_refused(scan, spoil, words):
    with pytest.raises(sc.InputError, match=words):
        estimated(scan, spoil(scan.recording))


def test_only_an_estimate_can_be_asked_for(scan):
    with pytest.raises(sc.InputError, match="latency must be one of estimate"):
        calibrate_points(scan.recording, [NEEDLE], scan.detections, latency="guess")


def test_a_recording_s_table_has_its_lines_velocities_and_tells_no_further_lag(scan):
    found, rows = estimated(scan)
    moved = with_latency(scan.recording, found.latency_s)
    table = with_line_velocities(rows, moved, [NEEDLE], Posing())
    known = np.isfinite(velocities_of(table)).all(axis=(1, 2))
    assert known.mean() > 0.95
    low, high = sc.calibrate(table, latency="estimate").latency_interval_s
    assert low < 0 < high


def test_lines_that_rest_have_no_velocities_in_their_table():
    scan = late_scan(0, "usual", frames=40)
    poses = {name: one.select(np.zeros(40, dtype=int)) for name, one in scan.recording.poses.items()}
    still = replace(scan.recording, poses=poses)
    rows = tabulate(still, [NEEDLE], scan.detections).observations
    assert velocities_of(with_line_velocities(rows, still, [NEEDLE], Posing())) is None
