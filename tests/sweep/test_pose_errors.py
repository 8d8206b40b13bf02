"""What only a recording's poses show: the bound counts it, it is told, and sound recordings have none of it."""

import numpy as np
import pytest
from benchmarks.simulators.trust_faults import distortion, sag
from benchmarks.simulators.trust_judge import NEEDLE, calibrated, candidates, recording, table
from benchmarks.simulators.trust_sound import plain

import sonocal as sc
from sonocal.sweep import calibrate_points

POSED = {"error-follows-pose", "offset-in-tracker"}


def corner_errors(found, case):
    """Actual and predicted (95 %) of the image's corners, mm."""
    places, _, bounds = found.predicted_errors()
    truth = case.scan.truth
    off = np.linalg.norm(found.probe_from_image @ places - places @ truth[:3, :2].T - truth[:3, 3], axis=1)
    return off, bounds


@pytest.mark.parametrize(("fault", "millimetres"), [(distortion, 1.5), (sag, 2.0)])
def test_the_bound_holds_what_neighbours_in_pose_share_and_it_is_told(fault, millimetres):
    within = []
    for seed in range(20):
        case = fault(seed, millimetres, still=True)
        found = calibrated(case)
        off, bounds = corner_errors(found, case)
        within += list(off <= bounds)
        assert POSED & {one.code for one in found.diagnostics}
        np.testing.assert_array_equal(found.noise.covariance, found.covariance)
    assert np.mean(within) > 0.85


def test_a_table_holds_no_poses_and_its_bound_less():
    for seed in range(3):
        case = distortion(seed, 3.0, still=True)
        posed, alone = calibrated(case), sc.calibrate(table(case.scan), image_size_px=(500, 500))
        assert not POSED & {one.code for one in alone.diagnostics}
        assert max(posed.predicted_errors()[2]) > 1.5 * max(alone.predicted_errors()[2])


def test_given_points_tell_as_much_as_candidates():
    case = distortion(1, 3.0, still=True)
    found, _ = calibrate_points(recording(case.scan), [NEEDLE], candidates(case))
    assert "error-follows-pose" in {one.code for one in found.diagnostics}


def test_sound_recordings_are_not_accused():
    told = [
        POSED
        & {one.code for one in calibrated(plain(recording=True, still=bool(seed % 2))(seed, 80)).diagnostics}
        for seed in range(30)
    ]
    assert told.count(set()) >= 29
