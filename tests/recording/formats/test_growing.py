"""A recording that is written as it comes is whole after every item, and is what it is in memory."""

from contextlib import closing

import numpy as np
import pytest

import sonocal as sc
from sonocal.recording import Item
from sonocal.recording.formats import GrowingSequence

PROBE = ("Probe", "Tracker")


def items(shape, dtype):
    chance = np.random.default_rng(0)
    for i in range(12):
        pose = None if i % 4 == 1 else np.eye(4) + np.pad(chance.normal(size=(3, 1)), ((0, 1), (3, 0)))
        image = None if i in (0, 5, 11) else chance.integers(0, 200, shape).astype(dtype)
        yield Item(0.1 * i, {PROBE: pose}, image)


@pytest.mark.parametrize("shape, dtype", [((7, 5), "u1"), ((7, 5), "u2"), ((7, 5), "f4"), ((3, 7, 5), "u1")])
def test_it_can_be_read_after_every_item(tmp_path, shape, dtype):
    with closing(GrowingSequence(tmp_path / "recording.mhd")) as growing:
        for i, item in enumerate(items(shape, dtype)):
            growing.add(item)
            if i == 0:
                continue  # a file begins with the first image
            read, kept = sc.read_recording(tmp_path / "recording.mhd"), growing.recording()
            np.testing.assert_array_equal(read.times, kept.times)
            np.testing.assert_array_equal(read.image_valid, kept.image_valid)
            name = "tracker_from_probe"
            np.testing.assert_array_equal(read.poses[name].matrices, kept.poses[name].matrices)
            np.testing.assert_array_equal(read.poses[name].valid, kept.poses[name].valid)
            for mine, theirs in zip(kept.frames, read.frames, strict=True):
                np.testing.assert_array_equal(mine, theirs)
                assert mine.dtype == theirs.dtype


def test_an_image_that_its_header_does_not_count_yet_is_no_damage(tmp_path):
    with closing(GrowingSequence(tmp_path / "recording.mhd")) as growing:
        for item in items((7, 5), "u1"):
            growing.add(item)
    with (tmp_path / "recording.raw").open("ab") as file:
        file.write(bytes(35))
    assert len(sc.read_recording(tmp_path / "recording.mhd")) == 12


def test_what_is_there_already_is_not_written_over(tmp_path):
    (tmp_path / "recording.raw").write_bytes(b"precious")
    with pytest.raises(sc.InputError, match=r"recording\.raw: is there already"):
        GrowingSequence(tmp_path / "recording.mhd")
    assert (tmp_path / "recording.raw").read_bytes() == b"precious"
