"""Motive's export."""

import numpy as np
import pytest

from sonocal import UnsupportedError
from sonocal.recording.formats import read_recording
from tests.builders.recordings import random_poses
from tests.builders.tables import N, motive


def test_motive_with_euler_angles_is_refused(tmp_path):
    motive(tmp_path / "a.csv", random_poses(np.random.default_rng(0), N), kind="XYZ")
    with pytest.raises(UnsupportedError) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value) == "a.csv: its rotations are 'XYZ'; export them from Motive as Quaternion"
