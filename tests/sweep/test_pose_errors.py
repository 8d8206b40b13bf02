"""What only a recording's poses show: the bound counts it, it is told, and sound recordings have none of it."""

import dataclasses
import re

import numpy as np
import pytest
from benchmarks.simulators.trust_faults import distortion, offset_in_tracker, rng_of, sag, unit_vector
from benchmarks.simulators.trust_judge import NEEDLE, calibrated, candidates, recording, table
from benchmarks.simulators.trust_scans import rigid
from benchmarks.simulators.trust_sound import plain

import sonocal as sc
from sonocal.sweep import calibrate_points
from sonocal.sweep.pose_errors import with_pose_errors
from sonocal.sweep.tabulate import Posing
from sonocal.sweep.tracker_offset import with_tracker_offset

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


@pytest.mark.parametrize("seed", range(3))
def test_one_offset_widens_the_covariance_by_how_far_it_moves_the_answer(seed):
    case = offset_in_tracker(seed, 2.0)
    rows = table(case.scan)
    found = sc.calibrate(rows, image_size_px=(500, 500))
    wider = with_tracker_offset(found, rows, recording(case.scan), Posing())
    more = wider.covariance - found.covariance
    assert np.linalg.matrix_rank(more / np.sqrt(np.outer(np.diag(more), np.diag(more))), tol=1e-6) == 1
    (told,) = [one for one in wider.diagnostics if one.code == "offset-in-tracker"]
    place = np.array(
        [float(x) for x in re.search(r"\((.*)\) mm", told.message.split("frame, ")[1])[1].split(",")]
    )
    np.testing.assert_allclose(place, 2.0 * unit_vector(rng_of(seed)), atol=0.8)
    np.testing.assert_array_equal(wider.noise.covariance, wider.covariance)


def test_where_the_tracker_stands_changes_no_bound():
    case = offset_in_tracker(1, 2.0)
    rows = table(case.scan)
    found = sc.calibrate(rows, image_size_px=(500, 500))
    here = recording(case.scan)
    move = rigid(np.array([[0.3, -1.0, 0.7]]), np.array([[500.0, -20.0, 90.0]]))[0]
    poses = {name: dataclasses.replace(one, matrices=move @ one.matrices) for name, one in here.poses.items()}
    there = dataclasses.replace(here, poses=poses)
    one, other = (with_pose_errors(found, rows, made, Posing()) for made in (here, there))
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-5, atol=1e-12)
    assert [x.code for x in other.diagnostics] == [x.code for x in one.diagnostics]


def test_a_recording_without_the_probes_poses_says_nothing():
    case = offset_in_tracker(1, 2.0)
    rows = table(case.scan)
    found = sc.calibrate(rows)
    whole = recording(case.scan)
    alone = dataclasses.replace(whole, poses={"n": whole.poses["tracker_from_needle"]})
    assert with_pose_errors(found, rows, alone, Posing()) is found
