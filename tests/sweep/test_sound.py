"""The speed of sound in recordings: from images that were looked at, and from given points."""

import numpy as np
import pytest
from benchmarks.simulators.fans import RADIUS_MM, fan_scan
from benchmarks.simulators.trust_faults import Case
from benchmarks.simulators.trust_judge import NEEDLE, candidates, recording
from benchmarks.simulators.trust_scans import mapped

import sonocal as sc
from sonocal.sweep import calibrate_points

SLOW = 0.96
SPEEDS = [SLOW * 1540.0, "estimate"]


def off_mm(found, scan):
    corners = scan.corners_px
    return np.linalg.norm(found.probe_from_image @ corners - mapped(scan.truth, corners), axis=1)


@pytest.mark.parametrize("speed", SPEEDS)
def test_a_recordings_places_are_corrected_before_they_are_fitted(speed):
    scan = fan_scan(8, 150, 2, SLOW, still=True)
    seen = {"detections": candidates(Case(scan)), "second_look": False}
    ignored = sc.calibrate_recording(recording(scan), [NEEDLE], **seen).calibration
    found = sc.calibrate_recording(
        recording(scan), [NEEDLE], **seen, probe_radius_mm=RADIUS_MM, sound_speed_m_s=speed
    ).calibration
    assert off_mm(ignored, scan).max() > 2.0
    assert np.all(off_mm(found, scan) <= 1.3 * found.predicted_errors()[2][:-1])
    assert abs(found.sound.speed_m_s - SLOW * 1540.0) < 20
    assert not {one.code for one in found.warnings} - {"weak-motion"}


@pytest.mark.parametrize("speed", SPEEDS)
def test_given_points_are_corrected_too(speed):
    scan = fan_scan(8, 150, 2, SLOW, still=True)
    found, rows = calibrate_points(
        recording(scan), [NEEDLE], candidates(Case(scan)), probe_radius_mm=RADIUS_MM, sound_speed_m_s=speed
    )
    assert np.all(off_mm(found, scan) <= 1.3 * found.predicted_errors()[2][:-1])
    assert np.array_equal(np.sort(rows.points_px, axis=0), np.sort(scan.points_px[:, 0], axis=0))
