"""A session gives what the recording of its items gives, however it was on the way."""

from contextlib import closing

import numpy as np
import pytest

import sonocal as sc
from sonocal.recording import Item, RecordingStream
from sonocal.simulation.sweep import NEEDLE, SweepOptions, simulate_sweep
from sonocal.sweep import Session


def items_of(recording):
    for i in range(len(recording)):
        poses = {
            (one.source, one.target): one.matrices[i] if one.valid[i] else None
            for one in recording.poses.values()
        }
        yield Item(float(recording.times[i]), poses, recording.frames[i])


@pytest.fixture(scope="module")
def swept():
    """A session of a simulated sweep, how it expected errors on the way, and the recording."""
    recording = simulate_sweep(options=SweepOptions(frames=110, dropout_share=0.1, seed=4)).recording
    session, on_the_way = Session([NEEDLE]), []
    for item in items_of(recording):
        if session.add(item):
            on_the_way.append(session.expected_mm)
    yield session, on_the_way, recording
    session.close()


def test_a_session_ends_as_its_recording_calibrates(swept):
    session, _, recording = swept
    found, offline = session.finish().calibration, sc.calibrate_recording(recording, [NEEDLE]).calibration
    np.testing.assert_allclose(
        found.probe_from_image.matrix, offline.probe_from_image.matrix, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(found.covariance, offline.covariance, rtol=1e-9)
    assert found.fit == offline.fit


def test_the_predicted_error_falls_on_the_way(swept):
    _, on_the_way, _ = swept
    told = [one for one in on_the_way if one is not None]
    assert len(told) >= 3
    assert told[-1] < told[0]


def test_the_stream_is_the_recording_of_its_items(swept):
    session, _, recording = swept
    again = session.stream.recording()
    np.testing.assert_array_equal(again.times, recording.times)
    np.testing.assert_array_equal(again.frames[7], recording.frames[7])
    for name, poses in recording.poses.items():
        np.testing.assert_array_equal(again.poses[name].valid, poses.valid)
        np.testing.assert_array_equal(again.poses[name].matrices[poses.valid], poses.matrices[poses.valid])


def test_a_lost_tool_never_keeps_its_pose():
    with closing(RecordingStream()) as stream:
        for pose in (np.eye(4), None, np.eye(4)):
            stream.add(Item(float(len(stream)), {("Probe", "Tracker"): pose}))
        stream.add(Item(3.0))
        assert stream.recording().poses["tracker_from_probe"].valid.tolist() == [True, False, True, False]


def test_a_recording_of_a_stream_stays_as_it_was():
    with closing(RecordingStream()) as stream:
        stream.add(Item(0.0, image=np.full((4, 5), 7, np.uint8)))
        before = stream.recording()
        stream.add(Item(1.0))
        stream.add(Item(2.0, image=np.full((4, 5), 9, np.uint8)))
        assert (len(before), before.frames[0][0, 0]) == (1, 7)
        after = stream.recording()
        assert after.image_valid.tolist() == [True, False, True]
        assert [int(frame[0, 0]) for frame in after.frames] == [7, 0, 9]


def test_the_last_items_are_those_of_the_whole_and_an_item_is_as_it_was_added(swept):
    stream = swept[0].stream
    whole, last = stream.recording(), stream.recording(len(stream) - 5)
    np.testing.assert_array_equal(last.times, whole.times[-5:])
    np.testing.assert_array_equal(last.image_valid, whole.image_valid[-5:])
    for name, poses in whole.poses.items():
        np.testing.assert_array_equal(last.poses[name].matrices, poses.matrices[-5:])
    again = RecordingStream()
    for index in range(len(stream)):
        again.add(stream.item(index))
        assert stream.time_s(index) == whole.times[index]
    with closing(again):
        for k in range(5):
            np.testing.assert_array_equal(last.frames[k], again.recording().frames[len(stream) - 5 + k])


def test_what_stood_out_is_told_image_by_image(swept):
    session = swept[0]
    seen = [session.stood_out(number) for number in range(session.looked)]
    assert [item for item, _ in seen] == [
        session.stream.image_item(number) for number in range(session.looked)
    ]
    assert sum(len(points) > 0 for _, points in seen) == session.seen


@pytest.mark.parametrize(
    "item, sentence",
    [
        (Item(float("nan")), "item 1: its time must be a number of seconds; got nan"),
        (
            Item(1.0, {("Probe", "Tracker"): np.eye(3)}),
            r"ProbeToTracker must have shape \(4, 4\); got \(3, 3\)",
        ),
        (Item(1.0, image=np.zeros((5, 5), np.uint8)), r"its image is \(5, 5\) uint8 where those before were"),
    ],
)
def test_an_item_unlike_those_before_is_refused_and_nothing_of_it_kept(item, sentence):
    with closing(RecordingStream()) as stream:
        stream.add(Item(0.0, image=np.zeros((4, 5), np.uint8)))
        with pytest.raises(sc.InputError, match=sentence):
            stream.add(item)
        assert len(stream) == len(stream.recording()) == 1


def test_what_shows_no_needle_is_refused_on_the_way_and_at_the_end():
    with closing(Session([NEEDLE])) as session:
        poses = {("Probe", "Tracker"): np.eye(4), ("Needle", "Tracker"): np.eye(4)}
        for i in range(30):
            session.add(Item(float(i), poses, np.zeros((40, 50), np.uint8)))
        assert "no candidate was found" in session.refusal
        with pytest.raises(sc.NoConsensusError):
            session.finish()
