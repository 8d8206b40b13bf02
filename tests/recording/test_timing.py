from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp

from sonocal import DegenerateGeometryError, InputError
from sonocal.recording import (
    Poses,
    Provenance,
    Recording,
    bottom_line_signal,
    estimate_latency,
    interpolate_poses,
    join,
    join_several,
    motion_signal,
    with_latency,
)
from sonocal.recording.formats import read_recording
from tests.builders.recordings import (
    random_poses,
    random_recording,
)

PLUS_LAG_S = -0.0648266  # TemporalCalibrationResultsBaseline.xml


def poses_of(matrices, valid=None):
    poses = Poses.of("Probe", "Tracker", matrices)
    return poses if valid is None else Poses("Probe", "Tracker", poses.matrices, np.array(valid))


@given(st.integers(0, 10**6))
def test_interpolation_agrees_with_scipy_slerp(seed):
    rng = np.random.default_rng(seed)
    matrices, times = random_poses(rng, 6), np.cumsum(rng.uniform(0.01, 0.1, 6))
    at = rng.uniform(times[0], times[-1], 20)
    found = interpolate_poses(poses_of(matrices), times, at)
    expected = Slerp(times, Rotation.from_matrix(matrices[:, :3, :3]))(at).as_matrix()
    assert found.valid.all()
    np.testing.assert_allclose(found.matrices[:, :3, :3], expected, atol=1e-12)
    for k in range(3):
        np.testing.assert_allclose(
            found.matrices[:, k, 3], np.interp(at, times, matrices[:, k, 3]), atol=1e-10
        )


def test_recorded_poses_come_back_to_the_bit():
    matrices = random_poses(np.random.default_rng(0), 5)
    times = np.arange(5) * 0.1
    assert interpolate_poses(poses_of(matrices), times, times).matrices.tobytes() == matrices.tobytes()


def test_no_pose_is_made_up():
    """Not beside an invalid one, not across a gap, not beyond the ends."""
    matrices = random_poses(np.random.default_rng(0), 5)
    times = np.array([0.0, 0.1, 0.2, 0.3, 5.0])
    poses = poses_of(matrices, [True, True, False, True, True])
    at = np.array([-0.01, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 1.0, 5.0, 5.01])
    found = interpolate_poses(poses, times, at)
    assert found.valid.tolist() == [False, True, True, False, False, False, True, False, True, False]
    assert np.isnan(found.matrices[~found.valid]).all()


def test_stamps_that_do_not_increase_are_refused():
    with pytest.raises(InputError) as caught:
        interpolate_poses(
            poses_of(random_poses(np.random.default_rng(0), 3)), [0, 0.2, 0.1], [0.1], source="a.mha"
        )
    assert str(caught.value) == (
        "a.mha, frame 2: its stamp 0.100000 s is not later than the 0.200000 s before it; delete or sort such frames"
    )


@given(st.floats(-0.2, 0.2), st.booleans(), st.integers(0, 1000))
def test_a_known_lag_is_found_with_its_sign(latency, inverted, seed):
    """Whatever happens at t, the tracker stamps it t + latency."""
    rng = np.random.default_rng(seed)
    phases = rng.uniform(0, 6, 4)

    def motion(t):
        return sum(np.sin(w * t + p) for w, p in zip((1.1, 2.3, 3.7, 5.1), phases, strict=True))

    image_times = np.sort(rng.uniform(2, 18, 200))
    tracker_times = np.arange(0, 20, 0.02)
    sign = -7.0 if inverted else 3.0
    image = sign * motion(image_times) + 100 + rng.normal(0, 0.02, 200)
    tracker = motion(tracker_times - latency) + rng.normal(0, 0.01, len(tracker_times))
    found = estimate_latency(image_times, image, tracker_times, tracker)
    assert abs(found.latency_s - latency) < max(5 * found.deviation_s, 1e-3)
    assert found.deviation_s < 5e-3


def test_lag_of_the_water_tank(data_folder):
    folder = data_folder / "recordings"
    video = read_recording(folder / "WaterTankBottomTranslationVideoBuffer.igs.mha")
    tracker = read_recording(folder / "WaterTankBottomTranslationTrackerBuffer-trimmed.igs.mha")
    signal = bottom_line_signal(video.frames)
    lag = estimate_latency(video.times, signal, tracker.times, motion_signal(tracker.tool("Probe")))
    assert abs(lag.latency_s - PLUS_LAG_S) < 0.005
    assert lag.correlation > 0.97
    joined = join(video, tracker, lag.latency_s)
    assert joined.poses["tracker_from_probe"].valid.mean() > 0.9


def test_signals_that_tell_nothing_are_refused():
    t = np.arange(0, 20, 0.05)
    rng = np.random.default_rng(0)
    with pytest.raises(DegenerateGeometryError, match="one of the two signals is constant"):
        estimate_latency(t, np.ones_like(t), t, np.sin(t))
    with pytest.raises(DegenerateGeometryError, match="no lag within"):
        estimate_latency(t, rng.normal(size=len(t)), t, rng.normal(size=len(t)))
    with pytest.raises(InputError, match="share 0 samples"):
        estimate_latency(t, np.sin(t), t + 100, np.sin(t))


def test_latency_moves_poses_and_nothing_else():
    recording = random_recording(0, n=30)
    steady = np.tile(np.eye(4), (30, 1, 1))
    steady[:, 0, 3] = 10 * np.arange(30)
    times = np.arange(30) * 0.1
    moved = with_latency(
        Recording(times=times, frames=recording.frames, image=recording.image, poses={"a": poses_of(steady)}),
        0.05,
    )
    x = moved.poses["a"].matrices[:, 0, 3]
    np.testing.assert_allclose(x[:-1], 10 * (np.arange(29) + 0.5))
    assert not moved.poses["a"].valid[-1]
    assert moved.times is times


def test_recordings_that_do_not_overlap_are_not_joined():
    images, tracker = random_recording(0, tools=()), random_recording(1, size=None)
    far = Recording(times=tracker.times + 1e6, poses=tracker.poses)
    with pytest.raises(InputError, match="they do not overlap; bring both to one clock"):
        join(images, far)


def timed(matrices, times, tool="Probe"):
    poses = Poses.of(tool, "Tracker", matrices)
    return Recording(times=times, poses={poses.name: poses})


@given(st.integers(0, 10**6), st.integers(-3, 3).filter(bool))
def test_a_latency_of_whole_items_moves_the_poses_by_as_many(seed, items):
    """To the bit, and beyond the ends there are none."""
    matrices, times = random_poses(np.random.default_rng(seed), 9), np.arange(9) / 8
    moved = with_latency(timed(matrices, times), items / 8)
    there = np.arange(9) + items
    inside = (there >= 0) & (there < 9)
    (poses,) = moved.poses.values()
    np.testing.assert_array_equal(poses.valid, inside)
    assert poses.matrices[inside].tobytes() == matrices[there[inside]].tobytes()
    assert moved.latency_s == items / 8


@given(st.integers(0, 10**6), st.floats(-0.2, 0.2))
def test_a_latency_is_the_same_as_earlier_stamps(seed, latency_s):
    rng = np.random.default_rng(seed)
    images, tracker = (
        timed(random_poses(rng, 9), np.arange(9) / 8),
        timed(random_poses(rng, 40), np.arange(40) / 32),
    )
    joined = join(images, tracker, latency_s)
    early = join(images, replace(tracker, times=tracker.times - latency_s))
    np.testing.assert_array_equal(
        joined.poses["tracker_from_probe"].valid, early.poses["tracker_from_probe"].valid
    )
    np.testing.assert_allclose(
        joined.poses["tracker_from_probe"].matrices, early.poses["tracker_from_probe"].matrices, atol=1e-9
    )
    assert (joined.latency_s, early.latency_s) == (latency_s, 0.0)


def test_a_latency_is_remembered_and_a_second_one_refused():
    recording = timed(random_poses(np.random.default_rng(0), 9), np.arange(9) / 8)
    moved = with_latency(recording, 0.125)
    assert with_latency(moved, 0.0) is moved
    assert join(recording, moved).latency_s == 0.125
    for again in (lambda: with_latency(moved, -0.125), lambda: join(recording, moved, 0.25)):
        with pytest.raises(InputError, match=r"its poses were moved by a latency of 0\.125 s before"):
            again()


@pytest.mark.parametrize("latency_s", [np.nan, np.inf, "0.1", True])
def test_a_latency_that_is_no_number_is_refused(latency_s):
    recording = timed(random_poses(np.random.default_rng(0), 9), np.arange(9) / 8)
    with pytest.raises(InputError, match="recording: latency_s must be a number of seconds; got"):
        with_latency(recording, latency_s)


def tracker(name, tool, times, matrices=None):
    if matrices is None:
        matrices = random_poses(np.random.default_rng(len(tool)), len(times))
    poses = Poses.of(tool, "Tracker", matrices)
    return Recording(
        np.asarray(times, dtype=float), poses={poses.name: poses}, provenance=Provenance(name, "x", (name,))
    )


@given(seed=st.integers(0, 2**32), tools=st.integers(1, 4))
def test_several_trackers_give_what_each_gives_alone(seed, tools):
    rng = np.random.default_rng(seed)
    images = tracker("images", "Reference", np.linspace(0, 1, 20))
    others = [tracker(f"{i}.csv", f"Tool{i}", np.sort(rng.uniform(0, 1, 30))) for i in range(tools)]
    joined = join_several(images, others, 0.01)
    assert list(joined.poses) == ["tracker_from_reference", *(f"tracker_from_tool{i}" for i in range(tools))]
    for one in (with_latency(images, 0.01), *(join(images, other, 0.01) for other in others)):
        for name, poses in one.poses.items():
            np.testing.assert_array_equal(joined.poses[name].matrices, poses.matrices)
    assert joined.provenance.paths == ("images", *(f"{i}.csv" for i in range(tools)))
    assert joined.latency_s == 0.01


def test_recordings_that_do_not_overlap_are_named_with_their_spans():
    images = tracker("a.csv", "Probe", [0.0, 0.1, 1.0])
    with pytest.raises(InputError) as caught:
        join_several(images, [tracker("b.csv", "Needle", [0.0, 1.0]), tracker("c.csv", "Wand", [7.0, 9.5])])
    assert str(caught.value) == (
        "a.csv spans 0.000 to 1.000 s and c.csv 7.000 to 9.500 s: they do not overlap; bring both to one clock"
    )


def test_a_tool_that_two_recordings_hold_is_named_with_both():
    images = tracker("a.csv", "Probe", [0.0, 1.0])
    with pytest.raises(InputError) as caught:
        join_several(images, [tracker("b.csv", "Needle", [0.0, 1.0]), tracker("c.csv", "Needle", [0.0, 1.0])])
    assert str(caught.value) == (
        "c.csv: holds NeedleToTracker, and so does b.csv; rename one of the two tools, or leave the file out"
    )
