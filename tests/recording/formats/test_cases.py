"""One motion of one tool, as several programs wrote it: files that went wrong once, where they are at hand."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonocal import FormatError
from sonocal.recording.formats import read_recording

# What each writes the lengths of the motion in, mm, and how far its digits reach.
FILES = {
    "poses_semicolon.csv": (1.0, 1e-6),
    "poses_semicolon_decimal_comma.csv": (1.0, 1e-6),
    "poses_utf16.csv": (1.0, 1e-6),
    "ndi_capi_log.csv": (1.0, 1e-5),
    "motive_1_22.csv": (1.0, 2e-3),
    "trajectory_tum.txt": (1000.0, 1e-3),  # its numbers are mm, and such a file's are metres
}


@pytest.mark.parametrize("name", FILES)
def test_whoever_wrote_it_the_motion_is_the_same(cases_folder, name):
    scale, tolerance = FILES[name]
    table = np.loadtxt(cases_folder / "poses_semicolon.csv", delimiter=";", skiprows=1)
    (poses,) = read_recording(cases_folder / name).poses.values()
    assert poses.valid.sum() >= len(table) - 2
    seen = poses.valid
    rotations = Rotation.from_quat(table[seen, 1:5], scalar_first=True).as_matrix()
    np.testing.assert_allclose(poses.matrices[seen, :3, :3], rotations, atol=1e-5)
    np.testing.assert_allclose(poses.matrices[seen, :3, 3] / scale, table[seen, 5:], atol=tolerance)


def test_a_missing_header_is_named_and_one_is_shown(cases_folder):
    with pytest.raises(
        FormatError, match="where a header must name the columns; put it above them, such as time_s,"
    ):
        read_recording(cases_folder / "poses_without_header.csv")
