"""The axes of a stepper: found as they are, whatever the frame, and refused where there are none."""

import numpy as np
import pytest
from benchmarks.simulators.stepper import stepper
from benchmarks.steppers import angle_deg, centre_off_mm, covered

from sonocal import DegenerateGeometryError
from sonocal.tools import calibrate_stepper

EXACT = {"mm": 0.0, "deg": 0.0, "play_deg": 0.0}
STEP = np.array([[0, -1, 0, 30.0], [1, 0, 0, -400], [0, 0, 1, 900], [0, 0, 0, 1]])


def codes(found):
    return {one.code for one in found.diagnostics}


@pytest.mark.parametrize("tilt_deg", [0.0, 2.0])
def test_without_noise_the_axes_are_exact(tilt_deg):
    rotation, translation, truth = stepper(1, tilt_deg=tilt_deg, **EXACT)
    found = calibrate_stepper(rotation, translation)
    assert angle_deg(found.axis, truth[0]) < 1e-5
    assert angle_deg(found.translation, truth[2]) < 1e-5
    assert centre_off_mm(found, truth) < 1e-5
    assert found.between_deg == pytest.approx(tilt_deg, abs=1e-5)
    assert found.travel_mm == pytest.approx(60)


def test_with_noise_they_are_within_what_is_stated():
    rotation, translation, truth = stepper(2)
    found = calibrate_stepper(rotation, translation)
    assert angle_deg(found.axis, truth[0]) < 0.05
    assert angle_deg(found.translation, truth[2]) < 0.4
    within = np.concatenate(
        [
            covered(found.axis, truth[0], 4 * found.axis_covariance),
            covered(found.translation, truth[2], 4 * found.translation_covariance),
        ]
    )
    assert within.all()
    assert "stepper-tilted" not in codes(found)
    assert len(found.free_motions) == 2


def test_moving_the_tracker_changes_nothing():
    rotation, translation, _ = stepper(3)
    here, there = (
        calibrate_stepper(rotation, translation),
        calibrate_stepper(STEP @ rotation, STEP @ translation),
    )
    np.testing.assert_allclose(there.axis, here.axis, atol=1e-9)
    np.testing.assert_allclose(there.centre_mm, here.centre_mm, atol=1e-6)
    np.testing.assert_allclose(there.translation, here.translation, atol=1e-9)


def test_moving_the_marker_moves_the_axes_with_it():
    rotation, translation, _ = stepper(3, **EXACT)
    here, there = (
        calibrate_stepper(rotation, translation),
        calibrate_stepper(rotation @ STEP, translation @ STEP),
    )
    np.testing.assert_allclose(STEP[:3, :3] @ there.axis, here.axis, atol=1e-8)
    moved = STEP[:3, :3] @ there.centre_mm + STEP[:3, 3] - here.centre_mm
    np.testing.assert_allclose(np.cross(moved, here.axis), 0, atol=1e-5)


def test_the_motions_that_it_names_are_those_that_no_sweep_shows():
    """A turn about the axis, and a shift along it, commute with all that the stepper does."""
    rotation, translation, _ = stepper(4, **EXACT)
    found = calibrate_stepper(rotation, translation)
    x = np.array(
        [
            [0, -found.axis[2], found.axis[1]],
            [found.axis[2], 0, -found.axis[0]],
            [-found.axis[1], found.axis[0], 0],
        ]
    )
    free = np.eye(4)
    free[:3, :3] = np.eye(3) + np.sin(0.3) * x + (1 - np.cos(0.3)) * x @ x
    free[:3, 3] = found.centre_mm - free[:3, :3] @ found.centre_mm + 7.0 * found.axis
    everything = np.linalg.inv(rotation[0]) @ np.concatenate([rotation, translation])
    np.testing.assert_allclose(everything @ free, free @ everything, atol=1e-6)


def test_a_tilted_axis_and_a_short_travel_are_told():
    found = calibrate_stepper(*stepper(5, tilt_deg=2.0, travel_mm=20.0)[:2])
    assert {"stepper-tilted", "little-travel"} <= codes(found)
    assert len(found.free_motions) == 1


@pytest.mark.parametrize(
    ("options", "swapped", "code"),
    [
        ({"travel_mm": 2.0}, False, "stepper-still"),
        ({"turn_deg": 4.0}, False, "still"),
        ({}, True, "still"),
    ],
)
def test_what_tells_no_axis_is_refused_by_name(options, swapped, code):
    rotation, translation, _ = stepper(6, **options)
    first, second = (translation, rotation) if swapped else (rotation, translation)
    with pytest.raises(DegenerateGeometryError) as caught:
        calibrate_stepper(first, second)
    assert caught.value.code == code


def test_a_probe_that_turned_as_it_moved_went_on_no_line():
    rotation, _, _ = stepper(7)
    with pytest.raises(
        DegenerateGeometryError, match="give the rotation first and the translation second"
    ) as caught:
        calibrate_stepper(rotation, rotation)
    assert caught.value.code in {"not-a-line", "stepper-still"}
