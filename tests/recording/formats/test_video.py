"""Videos."""

import numpy as np
import pytest

from sonocal.recording.formats import read_recording
from tests.builders.tables import TIMES, N, matrices_in, moving


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
