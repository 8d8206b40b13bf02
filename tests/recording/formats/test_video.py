"""Videos."""

import numpy as np
import pytest

from sonocal import FormatError, SonocalError
from sonocal.recording.formats import read_recording
from tests.builders.recordings import random_pixels, random_poses
from tests.builders.tables import TIMES, N, matrices_in, moving
from tests.builders.videos import video_with_texts


def test_a_video_is_joined_with_the_table_beside_it(tmp_path):
    av = pytest.importorskip("av", reason="PyAV is not installed")
    # Grey steps survive the codec; pixels need not.
    levels = 20 * np.arange(N, dtype=np.uint8)
    with av.open(str(tmp_path / "sweep.mp4"), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt, stream.bit_rate = 64, 48, "yuv420p", 4_000_000
        for level in levels:
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), level, np.uint8), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    matrices_in("quaternion", tmp_path / "sweep.csv", moving())
    recording = read_recording(tmp_path / "sweep.mp4")
    assert (len(recording), recording.frames.shape) == (N, (48, 64, 3))
    np.testing.assert_allclose(recording.times, TIMES, atol=1e-6)
    np.testing.assert_allclose([frame.mean() for frame in recording.frames], levels, atol=3)
    for index in (7, 8, 2, 11):
        assert abs(recording.frames[index].mean() - levels[index]) < 3
    valid = recording.poses["tracker_from_needle"].valid
    np.testing.assert_allclose(
        recording.poses["tracker_from_needle"].matrices[valid, 0, 3], np.arange(N)[valid], atol=1e-3
    )


def text(matrix):
    return " ".join(map(repr, matrix.ravel().tolist()))


def plus_video(path, poses, times=TIMES, statuses=None, pixels=None):
    pixels = np.zeros((N, 16, 18), np.uint8) if pixels is None else pixels
    tracks = {"ProbeToTrackerTransform": dict(zip(times, map(text, poses), strict=True))}
    if statuses is not None:
        tracks["ProbeToTrackerTransformStatus"] = dict(zip(times, statuses, strict=True))
    tracks["FrameNumber"] = {time: str(i) for i, time in enumerate(times)}
    video_with_texts(path, pixels, tracks)


def test_text_tracks_of_transforms_are_poses(tmp_path):
    """To the last digit, at the frames of the same instant; what the tracker does not vouch for is invalid."""
    poses = random_poses(np.random.default_rng(0), N)
    pixels = random_pixels(np.random.default_rng(1), (N, 16, 18), "uint8")
    statuses = ["INVALID" if i in (2, 7) else "OK" for i in range(N)]
    plus_video(tmp_path / "a.mkv", poses, statuses=statuses, pixels=pixels)
    (tmp_path / "a.csv").write_text("is not looked at: the video has poses of its own")
    recording = read_recording(tmp_path / "a.mkv")
    probe = recording.poses["tracker_from_probe"]
    assert np.flatnonzero(~probe.valid).tolist() == [2, 7]
    assert probe.status == tuple(statuses)
    np.testing.assert_array_equal(probe.matrices, poses)
    np.testing.assert_array_equal(list(recording.frames), pixels)
    assert list(recording.poses) == ["tracker_from_probe"]


def test_a_pose_that_is_not_rigid_is_refused_where_it_is_used(tmp_path):
    poses = moving()
    poses[3, 0, 0] = 1.2
    plus_video(tmp_path / "a.mkv", poses)
    recording = read_recording(tmp_path / "a.mkv")
    assert recording.between("Tracker", "Probe", on_invalid="skip").valid.sum() == N - 1
    with pytest.raises(SonocalError, match="frame 3: ProbeToTracker is not rigid"):
        recording.between("Tracker", "Probe")


def test_poses_between_frames_are_interpolated(tmp_path):
    plus_video(tmp_path / "a.mkv", moving(), times=TIMES + 0.05)
    probe = read_recording(tmp_path / "a.mkv").poses["tracker_from_probe"]
    assert np.flatnonzero(~probe.valid).tolist() == [0]  # before the first pose
    np.testing.assert_allclose(probe.matrices[1:, 0, 3], np.arange(N - 1) + 0.5)


def test_a_text_that_is_no_pose_is_named(tmp_path):
    pixels = np.zeros((2, 16, 16), np.uint8)
    video_with_texts(
        tmp_path / "a.mkv", pixels, {"ProbeToTrackerTransform": {0: text(np.eye(4)), 0.1: "1 2"}}
    )
    with pytest.raises(FormatError) as caught:
        read_recording(tmp_path / "a.mkv")
    assert str(caught.value) == ("a.mkv, frame 1: ProbeToTrackerTransform has 2 numbers where a pose has 16")
    video_with_texts(tmp_path / "b.mkv", pixels, {"ProbeToTrackerTransform": {0: "1" * 5000}})
    with pytest.raises(FormatError, match="a text of 5000 bytes in a track of poses is none"):
        read_recording(tmp_path / "b.mkv")


def test_a_video_that_was_cut_anywhere_is_read_to_there_or_ends_in_a_sentence(tmp_path):
    plus_video(tmp_path / "a.mkv", random_poses(np.random.default_rng(0), N))
    content = (tmp_path / "a.mkv").read_bytes()
    for length in np.linspace(1, len(content) - 1, 40).astype(int):
        (tmp_path / "cut.mkv").write_bytes(content[:length])
        try:
            recording = read_recording(tmp_path / "cut.mkv")
            assert len(list(recording.frames)) <= N
        except SonocalError as error:
            assert str(error).startswith("cut.mkv")
            assert "\n" not in str(error)
