"""Which format a file is in, and what is read beside it."""

import sys

import numpy as np
import pytest

from sonocal import InputError, UnsupportedError
from sonocal.recording.formats import read_recording, write_recording
from tests.builders.recordings import assert_same, random_recording
from tests.builders.sound import SOUND
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


def test_poses_are_given_as_a_file(tmp_path):
    write_recording(random_recording(0, tools=()), tmp_path / "images.mha")
    with pytest.raises(InputError, match="is a directory; name the table of poses in it"):
        read_recording(tmp_path / "images.mha", poses=tmp_path)


@pytest.mark.parametrize("suffix", [".MHA", ".Mhd", ".NRRD"])
def test_the_case_of_a_name_means_nothing(tmp_path, suffix):
    recording = random_recording(0)
    write_recording(recording, tmp_path / f"A{suffix}")
    assert_same(recording, read_recording(tmp_path / f"A{suffix}"))


@pytest.mark.parametrize("suffix", [".mp4", ".dat"])
def test_a_video_is_known_by_its_content_and_joined_with_its_table(tmp_path, suffix):
    (path, *_) = SOUND["video"](tmp_path)
    path = path.rename(tmp_path / f"sweep{suffix}")
    header = ["time_s", *(f"Probe_{k}" for k in ("qw", "qx", "qy", "qz", "x", "y", "z"))]
    write_table(tmp_path / "sweep.csv", header, [[t / 10, 1, 0, 0, 0, t, 0, 0] for t in range(-1, 9)])
    probe = read_recording(path).poses["tracker_from_probe"]
    np.testing.assert_allclose(probe.matrices[:, 0, 3], [0, 1, 2], atol=1e-6)


@pytest.mark.parametrize(
    ("name", "module", "extra"),
    [
        ("video", "av", "io"),
        ("DICOM", "pydicom", "io"),
        ("image", "PIL.Image", "io"),
        ("TUS-REC scan", "h5py", "io"),
        ("ROS bag", "rosbags", "ros"),
    ],
)
def test_a_package_that_lacks_is_named_with_what_brings_it(tmp_path, monkeypatch, name, module, extra):
    (path, *_) = SOUND[name](tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(UnsupportedError, match=rf"pip install 'sonocal\[{extra}\]'") as caught:
        read_recording(path)
    assert str(caught.value).startswith(path.name)
