"""Which format a file is in, and what is read beside it."""

import numpy as np
import pytest

from sonocal import InputError, UnsupportedError
from sonocal.recording.formats import read_recording, write_recording
from tests.builders.recordings import random_recording
from tests.builders.tables import write_table


def test_files_of_other_kinds_are_refused(tmp_path):
    (tmp_path / "a.xml").write_text("<PlusConfiguration/>")
    (tmp_path / "a.bin").write_bytes(b"\x00\x01\x02")
    (tmp_path / "a.mha").write_bytes(b"")
    with pytest.raises(
        UnsupportedError, match="is XML, not a recording; a PLUS device set is given with --lines"
    ):
        read_recording(tmp_path / "a.xml")
    with pytest.raises(
        UnsupportedError, match=r"is binary data and not a recording that sonocal reads; it reads \.mha, "
    ):
        read_recording(tmp_path / "a.bin")
    with pytest.raises(InputError, match="is empty; record it again"):
        read_recording(tmp_path / "a.mha")
    with pytest.raises(InputError, match="there is no such file; check the name and the folder"):
        read_recording(tmp_path / "missing.mha")


def test_poses_from_another_file_and_another_clock(tmp_path):
    """The tracker's clock is 100 s ahead: a latency like any other."""
    write_recording(random_recording(0, n=5, tools=()), tmp_path / "images.mha")
    images_times = read_recording(tmp_path / "images.mha").times
    stamps = images_times[0] + 100 + np.arange(0, images_times[-1] - images_times[0] + 1, 0.1)
    rows = [[t, 1, 0, 0, 0, t, 0, 0] for t in stamps.tolist()]
    write_table(
        tmp_path / "tracker.csv",
        ["time_s", *(f"Probe_{k}" for k in ("qw", "qx", "qy", "qz", "x", "y", "z"))],
        rows,
    )
    recording = read_recording(tmp_path / "images.mha", poses=tmp_path / "tracker.csv", latency_s=100.0)
    probe = recording.poses["tracker_from_probe"]
    assert probe.valid.all()
    np.testing.assert_allclose(probe.matrices[:, 0, 3], images_times + 100)
    with pytest.raises(InputError, match="they do not overlap; bring both to one clock"):
        read_recording(tmp_path / "images.mha", poses=tmp_path / "tracker.csv")
