"""The mm/px that a recording states, from its header or from what PLUS writes beside every image."""

from dataclasses import replace

import numpy as np
import pytest

from sonocal.recording import Poses, stated_scale
from sonocal.recording.formats import read_recording, write_recording
from tests.builders.recordings import random_recording


def with_spacing(*spacing):
    recording = random_recording(0, n=5, size=(6, 4))
    return replace(recording, image=replace(recording.image, spacing_mm=spacing or None))


def beside_images(*scales, changed=1.0):
    """As PLUS's drivers write it: the image's axes, from px to mm beside the transducer."""
    matrices = np.tile(np.diag([*scales, 1.0]), (5, 1, 1))
    matrices[3:, :3, :3] *= changed
    matrices[:, :3, 3] = -30, 0, 0
    recording = with_spacing()
    poses = Poses.of("Image", "Transducer", matrices)
    return replace(recording, poses={**recording.poses, poses.name: poses})


def test_the_header_states_it():
    said = stated_scale(with_spacing(0.2, 0.25))
    assert said.mm_per_px == (0.2, 0.25)
    assert str(said) == "its header states 0.2 x 0.25 mm/px"


def test_what_plus_writes_beside_images_is_told_and_survives_a_file(tmp_path):
    recording = beside_images(0.2, 0.25, 0.2)
    write_recording(recording, tmp_path / "a.igs.mha")
    for one in (recording, read_recording(tmp_path / "a.igs.mha")):
        said = stated_scale(one)
        assert said.mm_per_px == pytest.approx((0.2, 0.25))
        assert said.where == "its ImageToTransducer"


@pytest.mark.parametrize(
    "recording",
    [
        with_spacing(),
        beside_images(1.0, 1.0, 1.0),  # a pose without scale
        beside_images(0.2, 0.2, 0.2, changed=1.5),  # the depth was changed
        random_recording(0, n=3, size=None),
    ],
    ids=["nothing", "rigid", "changed", "no images"],
)
def test_nothing_is_stated(recording):
    assert stated_scale(recording) is None
