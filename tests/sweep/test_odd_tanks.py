"""Tanks in which something is not as it should be, in images of another simulator: what is said of them."""

import numpy as np
import pytest
from benchmarks.simulators.tank_images import Tank
from benchmarks.simulators.tank_probe import Probe
from benchmarks.simulators.tank_scans import tank_scan

from sonocal.errors import NoConsensusError
from sonocal.sweep import calibrate_recording

FAR_OFF = 3.0


def off_and_predicted(scan, calibration):
    """At the image's centre and at the middles of its lower sides, mm."""
    places = np.array([[150.0, 150, 0], [80, 220, 0], [220, 220, 0]])
    error = np.linalg.norm(calibration.probe_from_image @ places - scan.truth @ places, axis=1)
    return error, calibration.predicted_errors()[2].max()


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"tank": Tank(gain=8.0)},
        {"tank": Tank(gain=0.125)},
        {"tank": Tank(behind=1.6)},
        {"tank": Tank(slice_mm=4.0)},
        {"part": (0.35, 0.65)},
        {"tilt": 0.5, "tank": Tank(mirror=0.1)},
        {"needle_in_front": True, "tank": Tank(shadow=0.3)},
        {"hidden": 0.5},
        {"probe": Probe(radius_mm=0.0)},
    ],
    ids=[
        "as it should be",
        "gain",
        "dark",
        "second face",
        "thick",
        "part",
        "aslant",
        "needle",
        "half",
        "linear",
    ],
)
def test_an_odd_tank_gives_the_right_answer_or_none(how):
    scan = tank_scan(7, "walls", 24, **how)
    found = calibrate_recording(scan.recording, scan.targets).calibration
    error, predicted = off_and_predicted(scan, found)
    assert np.all(error < FAR_OFF * predicted)
    assert np.all(error < 2.5)


def test_a_tank_without_walls_is_refused_with_why():
    scan = tank_scan(7, "walls", 12, hidden=1.0)
    with pytest.raises(
        NoConsensusError, match=r"no candidate was found in 12 images \(in 1\d of them nothing"
    ):
        calibrate_recording(scan.recording, scan.targets)


def test_a_wall_that_nothing_names_above_those_that_are_named_is_said():
    scan = tank_scan(7, "walls", 24, other_mm=12.0)
    found = calibrate_recording(scan.recording, scan.targets).calibration
    error, _ = off_and_predicted(scan, found)
    (said,) = [one for one in found.warnings if one.code == "second-wall"]
    assert "12." in said.message or "11." in said.message
    assert np.all(error > 10.0) == ("deeper" in said.message)  # the upper one, which nothing names, was taken


def test_a_wall_s_other_face_is_no_warning():
    scan = tank_scan(7, "walls", 24)
    found = calibrate_recording(scan.recording, scan.targets).calibration
    (said,) = [one for one in found.diagnostics if one.code == "second-wall"]
    assert said.severity == "info"
    assert "5.0 mm deeper and dimmer" in said.message
