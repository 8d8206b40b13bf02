"""Scans of the TUS-REC challenge."""

import numpy as np
import pytest

from sonocal import FormatError, InputError, SonocalError, UnsupportedError
from sonocal.recording.formats import read_recording
from tests.builders.recordings import random_pixels, random_poses
from tests.builders.sound import write_scan

h5py = pytest.importorskip("h5py", reason="h5py is not installed")
N = 6
POSES = random_poses(np.random.default_rng(0), N)
PIXELS = random_pixels(np.random.default_rng(1), (N, 30, 40), "uint8")
HOW = {"plain": {}, "chunks": {"chunks": (1, 30, 40)}, "gzip": {"chunks": (2, 30, 40), "compression": "gzip"}}


@pytest.mark.parametrize("how", HOW)
def test_a_scan_is_read_as_it_was_written(tmp_path, how):
    write_scan(tmp_path / "a.h5", PIXELS, POSES.astype("float32"), **HOW[how])
    recording = read_recording(tmp_path / "a.h5")
    assert np.isnan(recording.times).all()
    probe = recording.poses["tracker_from_probe"]
    np.testing.assert_array_equal(probe.matrices, POSES.astype("float32"))
    np.testing.assert_array_equal(list(recording.frames), PIXELS)
    np.testing.assert_array_equal(recording.frames[4], PIXELS[4])
    assert recording.image.size_px == (40, 30)


def sentence(path, kind):
    with pytest.raises(kind) as caught:
        read_recording(path)
    return str(caught.value)


def test_datasets_that_lack_or_do_not_fit_are_named(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["frames"], file["other"] = PIXELS, np.zeros(3)
    assert sentence(tmp_path / "a.h5", InputError) == (
        "a.h5: has no dataset 'tforms' of its own; it holds frames, other, and a scan frames and tforms"
    )
    write_scan(tmp_path / "b.h5", PIXELS, POSES[:-1])
    assert sentence(tmp_path / "b.h5", InputError) == (
        "b.h5: tforms has shape (5, 4, 4) float64 for 6 frames; one 4 x 4 matrix a frame is needed"
    )
    write_scan(tmp_path / "c.h5", PIXELS.astype(float), POSES)
    assert sentence(tmp_path / "c.h5", UnsupportedError) == (
        "c.h5: frames has shape (6, 30, 40) float64; grey images (N, V, U) of uint8 are read"
    )


def test_data_outside_of_the_file_are_refused(tmp_path):
    """A file from elsewhere could name any other of this machine."""
    write_scan(tmp_path / "other.h5", PIXELS, POSES)
    (tmp_path / "raw").write_bytes(PIXELS.tobytes())
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["tforms"], file["frames"] = POSES, h5py.ExternalLink("other.h5", "/frames")
    assert "has no dataset 'frames' of its own" in sentence(tmp_path / "a.h5", InputError)
    with h5py.File(tmp_path / "b.h5", "w") as file:
        file["tforms"] = POSES
        file.create_dataset(
            "frames", PIXELS.shape, "u1", external=[(str(tmp_path / "raw"), 0, h5py.h5f.UNLIMITED)]
        )
    assert "frames lies in other files" in sentence(tmp_path / "b.h5", FormatError)
    with h5py.File(tmp_path / "c.h5", "w") as file:
        file["tforms"] = POSES
        layout = h5py.VirtualLayout(PIXELS.shape, "u1")
        layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "frames", PIXELS.shape)
        file.create_virtual_dataset("frames", layout)
    assert "frames lies in other files" in sentence(tmp_path / "c.h5", FormatError)


def test_what_is_stated_and_not_stored_is_refused_before_memory_is_asked_for(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("frames", (9_000_000, 480, 640), "u1", chunks=(1, 480, 640), compression="gzip")
        file.create_dataset("tforms", (9_000_000, 4, 4), "f8", chunks=(1, 4, 4), compression="gzip")
    assert sentence(tmp_path / "a.h5", FormatError) == (
        "a.h5: frames states 2764800000000 bytes and holds 0; it was cut short, copy it again"
    )
    wide = {"chunks": (400, 640, 640), "compression": "gzip"}
    write_scan(tmp_path / "b.h5", np.zeros((400, 640, 640), "u1"), np.zeros((400, 4, 4)), **wide)
    assert "is stored in pieces of more than 134217728 bytes" in sentence(tmp_path / "b.h5", UnsupportedError)


@pytest.mark.parametrize("how", HOW)
def test_a_scan_that_was_cut_anywhere_ends_in_a_sentence(tmp_path, how):
    write_scan(tmp_path / "a.h5", PIXELS, POSES, **HOW[how])
    content = (tmp_path / "a.h5").read_bytes()
    for length in np.linspace(1, len(content) - 1, 50).astype(int):
        (tmp_path / "cut.h5").write_bytes(content[:length])
        with pytest.raises(SonocalError) as caught:
            list(read_recording(tmp_path / "cut.h5").frames)
        assert str(caught.value).startswith("cut.h5")
        assert "\n" not in str(caught.value)
