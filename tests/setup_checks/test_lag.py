"""The lag under which most rows agree: laws of its value, and of what is said where rows were refused."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.late import NEEDLE, late_scan
from benchmarks.simulators.trust_faults import Case, sound
from benchmarks.simulators.trust_judge import judged
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration import point_line_rows
from sonocal.recording import with_latency
from sonocal.recording.mistaken_poses import CHANGES
from sonocal.setup_checks import Refused, refusal_findings
from sonocal.setup_checks.lag_search import find_lag
from sonocal.setup_checks.latency import LEAST_LAG_MM
from sonocal.setup_checks.lines_in_time import LinesInTime
from sonocal.setup_checks.rows_in_time import RowsInTime
from sonocal.sweep import calibrate_points
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 1000)
lags = st.floats(0.05, 0.19).flatmap(lambda lag: st.sampled_from([lag, -lag]))


def lag_in(rows):
    return find_lag(RowsInTime.of(rows, point_line_rows(rows)), 5.0)


def findings_of(scan, recording):
    """Of its calibration, or of its refusal."""
    try:
        return calibrate_points(recording, [NEEDLE], scan.detections)[0].diagnostics
    except sc.SonocalError as error:
        return error.diagnostics


def restamped(rows, shift_s):
    """The tracker's lines of other stamps: images keep theirs."""
    return dataclasses.replace(
        rows, extra={"time_s": (rows.extra["time_s"].astype(float) + shift_s).astype(str)}
    )


@settings(max_examples=10)
@given(seeds, lags)
def test_the_lag_put_in_is_the_lag_named(seed, lag):
    found = lag_in(late_scan(seed, "fast", lag).observations)
    assert found.value == pytest.approx(lag, abs=0.005)


@settings(max_examples=10)
@given(seeds, st.floats(-0.1, 0.1))
def test_however_far_the_poses_were_moved_before_the_whole_lag_is_asked_for(seed, shift):
    scan = late_scan(seed, "fast", 0.08)
    findings = findings_of(scan, with_latency(scan.recording, shift))
    late = [one for one in findings if one.code == "latency"]
    assert late or abs(shift - 0.08) < 0.01
    for one in late:
        assert float(one.advice.split("--latency ")[1].split()[0]) == pytest.approx(0.08, abs=0.005)


def test_poses_moved_by_the_lag_that_is_named_name_none():
    scan = late_scan(3, "fast", 0.08)
    assert not [one for one in findings_of(scan, with_latency(scan.recording, 0.08)) if one.code == "latency"]


@settings(max_examples=10)
@given(seeds, st.floats(-1e3, 1e3))
def test_when_the_clock_started_changes_no_lag(seed, start):
    rows = late_scan(seed, "fast", 0.12).observations
    one, other = lag_in(rows), lag_in(restamped(rows, start))
    assert other.value == pytest.approx(one.value, abs=1e-4)


@settings(max_examples=10)
@given(seeds, st.sampled_from(["fast", "slow", "still"]), st.sampled_from([0.0, 0.9]))
def test_sound_scans_and_drifts_have_no_lag(seed, hands, memory):
    lag = lag_in(late_scan(seed, hands, 0.0, memory=memory).observations)
    assert lag is None or lag.moved_mm < LEAST_LAG_MM  # which nobody is told


@pytest.mark.parametrize(
    ("seed", "lag"), [(8, 0.068), (11, 0.127), (78, 0.109), (88, 0.068), (126, -0.092), (172, 0.059)]
)
def test_the_lag_of_a_slow_hand_is_named_though_few_rows_are_left_out(seed, lag):
    """The calibration takes up most of it: residuals are below a millimetre, and gross rows as many as ever."""
    found = sc.calibrate(late_scan(seed, "slow", lag).observations)
    assert found.fit.rms_mm < 1.0
    (late,) = [one for one in found.diagnostics if one.code == "latency"]
    assert float(late.advice.split("--latency ")[1].split()[0]) == pytest.approx(lag, abs=0.02)


def test_a_steady_motion_stays_one_whatever_the_stamps():
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.5, 1.5, 40)) / 20
    start, pace = rng.normal(size=(2, 2, 3))
    lines = LinesInTime.of(np.zeros(40, dtype=int), time, start + time[:, None, None] * pace)
    asked = rng.uniform(time[0], time[-1], 100)
    moved = lines.at(np.zeros(100, dtype=int), asked)
    assert moved.usable.all()
    np.testing.assert_allclose(moved.spanning_mm, start + asked[:, None, None] * pace, atol=1e-9)
    np.testing.assert_allclose(moved.velocities, np.broadcast_to(pace, (100, 2, 3)), atol=1e-9)


def test_nothing_is_known_across_a_gap_or_beyond_the_ends():
    time = np.concatenate([np.arange(10), np.arange(20, 30)]) / 10
    segments = np.tile([[0.0, 0, 0], [0, 0, 1]], (20, 1, 1))
    lines = LinesInTime.of(np.zeros(20, dtype=int), time, segments, 0.4)
    usable = lines.at(np.zeros(5, dtype=int), np.array([0.0, 0.9, 1.5, 2.0, 2.95])).usable
    np.testing.assert_array_equal(usable, [True, True, False, True, False])


def test_a_refusal_for_a_lag_leads_with_it_and_carries_it():
    for seed in range(40):
        try:
            sc.calibrate(late_scan(seed, "fast", 0.19, frames=60).observations)
        except sc.SonocalError as error:
            assert str(error).startswith("the tracker is late by 1")
            assert "--latency 0.1" in str(error)
            assert [one.code for one in error.diagnostics] == ["latency"]
            return
    pytest.fail("none of the scans was refused")


def test_a_mirrored_volume_is_named_where_it_is_refused():
    rng = np.random.default_rng(0)
    points = rng.uniform(0, 500, (50, 2, 3))
    segments = random_similarity(0, scale=0.3) @ np.repeat(points, 2, axis=0)
    seen = points.reshape(-1, 3) * [1, 1, -1] + rng.normal(size=(100, 3))
    wrong = sc.Observations(seen, segments, frame=np.repeat(np.arange(50), 2))
    with pytest.raises(
        sc.NoConsensusError, match="the volume fits when it is mirrored along one axis"
    ) as caught:
        sc.calibrate(wrong)
    assert caught.value.diagnostics[0].code == "flipped-image"


def test_rows_in_no_common_frame_are_told_so_with_the_share_of_the_refusal():
    rows = late_scan(0, "fast").observations
    rng = np.random.default_rng(0)
    wrong = dataclasses.replace(rows, points_px=rng.permutation(rows.points_px))
    found = refusal_findings(Refused(wrong, point_line_rows(wrong), "similarity", 5.0, agreeing=9))
    assert [one.code for one in found] == ["wrong-tool-frame"]
    assert "only 9 of 120 rows agree" in found[0].message


@pytest.mark.parametrize("how", CHANGES)
@pytest.mark.parametrize("tool", ["Probe", "Needle"])
def test_wrong_poses_are_named(how, tool):
    scan = late_scan(1, "fast")
    poses = {
        name: dataclasses.replace(one, matrices=CHANGES[how](one.matrices)) if one.source == tool else one
        for name, one in scan.recording.poses.items()
    }
    try:
        found = calibrate_points(dataclasses.replace(scan.recording, poses=poses), [NEEDLE], scan.detections)[
            0
        ]
        findings = found.diagnostics
    except sc.SonocalError as error:
        findings = error.diagnostics
    assert findings[0].code == "wrong-poses"
    assert findings[0].message.startswith(f"the {tool}'s poses fit when they are")


@pytest.mark.parametrize(("seed", "order"), [(3, "xwyz"), (5, "xwyz"), (10, "xywz")])
def test_poses_of_an_order_of_quaternions_that_nobody_uses_are_not_late(seed, order):
    scan = sound(seed, 200)
    turns = Rotation.from_matrix(scan.tracker_from_probe[:, :3, :3]).as_quat()
    poses = scan.tracker_from_probe.copy()
    poses[:, :3, :3] = Rotation.from_quat(turns[:, ["xyzw".index(one) for one in order]]).as_matrix()
    assert "latency" not in judged(Case(scan.but(tracker_from_probe=poses), recording=True)).codes
