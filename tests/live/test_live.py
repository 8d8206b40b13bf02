"""A sweep that is played into a live calibration ends as the recording does that it left."""

import threading

import numpy as np
import pytest

import sonocal as sc
from sonocal.live import Faults, Live, Pairing
from sonocal.simulation.sweep import NEEDLE
from tests.builders.live import LONG_S, live_at, played, swept, until


@pytest.fixture(autouse=True)
def _threads_are_joined():
    before = set(threading.enumerate())
    yield
    assert not [one for one in threading.enumerate() if one not in before and one.is_alive()]


@pytest.fixture(scope="module")
def sweep():
    return swept(110, dropout_share=0.1)


def same(found, offline):
    np.testing.assert_allclose(
        found.probe_from_image.matrix, offline.probe_from_image.matrix, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(found.covariance, offline.covariance, rtol=1e-9)


def test_a_sweep_that_is_played_is_paired_whole_and_calibrates_as_its_recording(sweep, tmp_path):
    moments = []
    found, state = played(sweep, tmp_path, on_state=moments.append)
    kept = sc.read_recording(tmp_path / "recording.mhd")
    assert (state.images, state.recorded, len(kept)) == (110, 110, 110)
    assert (state.dropped, state.damaged, state.late) == (0, 0, 0)
    for name, poses in sweep.poses.items():
        np.testing.assert_array_equal(kept.poses[name].valid, poses.valid)
        np.testing.assert_allclose(
            kept.poses[name].matrices[poses.valid], poses.matrices[poses.valid], rtol=1e-6, atol=1e-4
        )
    np.testing.assert_array_equal(kept.frames[57], sweep.frames[57])
    np.testing.assert_allclose(np.diff(kept.times), np.diff(sweep.times), atol=1e-9)
    same(found.calibration, sc.calibrate_recording(kept, [NEEDLE]).calibration)
    assert moments[-1].looked == 110
    assert not state.said


@pytest.mark.parametrize(
    "faults", [Faults(invalid=0.2), Faults(invalid=0.2, say_invalid=True), Faults(gaps=0.2, reordered=0.3)]
)
def test_what_is_lost_is_lost_and_nothing_else(sweep, tmp_path, faults):
    found, state = played(sweep, tmp_path, faults, rate_hz=100)
    kept = sc.read_recording(tmp_path / "recording.mhd")
    same(found.calibration, sc.calibrate_recording(kept, [NEEDLE]).calibration)
    sent = {
        tuple(np.float32(pose[:3].ravel()))
        for one in sweep.poses.values()
        for pose in one.matrices[one.valid]
    }
    for one in kept.poses.values():
        there = [tuple(np.float32(pose[:3].ravel())) for pose in one.matrices[one.valid]]
        assert len(set(there)) == len(there)
        assert set(there) <= sent
    assert state.recorded == 110 if not faults.gaps else 60 < state.recorded < 110
    assert (np.diff(kept.times) > 0).all()


def test_poses_of_streams_of_their_own_are_found_between_theirs(sweep, tmp_path):
    _, state = played(sweep, tmp_path, apart=True, rate_hz=60)
    kept = sc.read_recording(tmp_path / "recording.mhd")
    at = np.searchsorted(sweep.times, kept.times - kept.times[0] + sweep.times[0] - 1e-6)
    for name, poses in kept.poses.items():
        both = poses.valid & sweep.poses[name].valid[at]
        assert both.mean() > 0.7
        off = poses.matrices[both][:, :3, 3] - sweep.poses[name].matrices[at][both][:, :3, 3]
        assert np.median(np.linalg.norm(off, axis=1)) < 2.0
    assert state.recorded > 105


def test_it_ends_by_itself_once_it_is_good_enough(tmp_path):
    long = swept(300)
    _, state = played(long, tmp_path, rate_hz=100, until_mm=5.0)
    assert state.ended == "the predicted error is below 5 mm"
    assert state.expected_mm <= 5.0


def test_advice_of_whoever_gives_it_is_shown(sweep, tmp_path):
    asked = []

    def advice(found, state):
        asked.append((found, state.recorded))
        return "tilt 30 degrees to the marked side"

    _, state = played(sweep, tmp_path, advice=advice)
    assert state.advice == "tilt 30 degrees to the marked side"
    assert asked


def test_a_bug_of_who_listens_ends_it_and_is_raised(sweep, tmp_path):
    def broken(state):
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        played(sweep, tmp_path, on_state=broken)


def test_poses_that_a_latency_moves_are_moved_once(sweep, tmp_path):
    found, state = played(sweep, tmp_path, apart=True, rate_hz=60, pairing=Pairing(latency_s=0.02))
    assert state.recorded > 100
    same(
        found.calibration,
        sc.calibrate_recording(sc.read_recording(tmp_path / "recording.mhd"), [NEEDLE]).calibration,
    )


def test_nobody_sends_images(tmp_path):
    from sonocal import igtl

    with igtl.Server() as server, live_at(server.port, tmp_path) as running:
        server.wait_for_peer(LONG_S)
        server.send(igtl.Message(igtl.Transform(np.eye(4)), "ProbeToTracker", 1 << 32))
        until(lambda: running.state.tools)
        assert isinstance(running, Live)
        with pytest.raises(sc.InputError, match="has no images"):
            running.finish()
