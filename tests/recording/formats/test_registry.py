"""Which format a file is in, and what is read beside it."""

import sys

import numpy as np
import pytest

from sonocal import FormatError, InputError, UnsupportedError
from sonocal.recording.formats import read_recording, write_recording
from sonocal.targets import Point
from tests.builders.recordings import assert_same, random_recording
from tests.builders.sound import SOUND
from tests.builders.tables import write_table


def test_files_of_other_kinds_are_refused(tmp_path):
    (tmp_path / "a.xml").write_text("<PlusConfiguration/>")
    (tmp_path / "a.bin").write_bytes(b"\x00\x01\x02")
    (tmp_path / "a.mha").write_bytes(b"")
    with pytest.raises(FormatError, match=r"^a\.xml: is a device set of PLUS; give it with --lines"):
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


QUATERNION = ("qw", "qx", "qy", "qz", "x", "y", "z")


def one_tool(path, offset=0.0):
    write_table(path, ["time_s", *QUATERNION], [[t, 1, 0, 0, 0, t, offset, 0] for t in range(-1, 9)])
    return path


def test_several_files_of_poses_are_tools_called_as_the_files(tmp_path):
    write_recording(random_recording(0, n=5, tools=()), tmp_path / "images.mha")
    files = [one_tool(tmp_path / f"{name}.csv", i) for i, name in enumerate(("Probe", "Needle"))]
    stamps = read_recording(tmp_path / "images.mha").times
    joined = read_recording(tmp_path / "images.mha", files, latency_s=float(-stamps[0]))
    assert joined.tools == ("Probe", "Needle")
    assert joined.provenance.paths == tuple(map(str, (tmp_path / "images.mha", *files)))
    alone = read_recording(files[0], files[1:])
    assert alone.tools == ("Probe", "Needle")
    assert alone.poses["tracker_from_needle"].matrices[:, 1, 3].tolist() == [1.0] * 10


def test_poses_and_images_in_each_others_place_are_named(tmp_path):
    write_recording(random_recording(0, n=5, tools=()), tmp_path / "images.mha")
    one_tool(tmp_path / "Probe.csv")
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "Probe.csv", tmp_path / "images.mha")
    assert str(caught.value) == (
        "images.mha, given for its poses, holds images and no poses, and Probe.csv poses and no images; "
        "exchange the two"
    )
    with pytest.raises(
        InputError, match=r"images\.mha: is given for its poses and holds none; name the tracker's"
    ):
        read_recording(tmp_path / "images.mha", tmp_path / "images.mha")


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (
            {"angles": "ZYX"},
            "images.mha, Probe.csv: cannot hold markers in place of poses; leave markers out",
        ),
        ({}, "images.mha: cannot hold three angles for a pose; leave angles out"),
    ],
)
def test_what_is_told_and_means_nothing_is_refused(tmp_path, told, words):
    write_recording(random_recording(0, n=5, tools=()), tmp_path / "images.mha")
    one_tool(tmp_path / "Probe.csv")
    with pytest.raises(InputError) as caught:
        if told:
            marker = Point("a", "Probe", np.zeros(3))
            read_recording(tmp_path / "images.mha", tmp_path / "Probe.csv", markers=[marker], **told)
        else:
            read_recording(tmp_path / "images.mha", angles="ZYX")
    assert str(caught.value) == words


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
    ("name", "module", "package"),
    [
        ("video", "av", "av"),
        ("DICOM", "pydicom", "pydicom"),
        ("image", "PIL.Image", "pillow"),
        ("ROS bag", "rosbags", "rosbags"),
    ],
)
def test_a_package_that_lacks_is_named_with_what_brings_it(tmp_path, monkeypatch, name, module, package):
    (path, *_) = SOUND[name](tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(UnsupportedError, match=rf"; pip install {package}$") as caught:
        read_recording(path)
    assert str(caught.value).startswith(path.name)
