"""Poses in tables."""

import numpy as np
import pytest

from sonocal import InputError
from sonocal.recording.formats import read_recording
from tests.builders.recordings import random_poses
from tests.builders.tables import TIMES, N, matrices_in, motive, write_table


@pytest.mark.parametrize("form", ["cells", "matrix", "quaternion", "metres", "motive m", "motive mm"])
def test_every_form_gives_the_same_poses(tmp_path, form):
    matrices = random_poses(np.random.default_rng(0), N)
    path = tmp_path / "poses.csv"
    if form.startswith("motive"):
        motive(path, matrices, "Meters" if form.endswith(" m") else "Millimeters", blank=(3, 4))
    else:
        matrices_in(form, path, matrices, blank=(3, 4))
    recording = read_recording(path)
    needle = recording.poses["tracker_from_needle"]
    seen = ~np.isin(np.arange(N), (3, 4))
    np.testing.assert_array_equal(needle.valid, seen)
    np.testing.assert_allclose(needle.matrices[seen], matrices[seen], atol=1e-9)
    np.testing.assert_array_equal(recording.times, TIMES)
    assert len(recording.frames) == 0


def test_quaternion_columns_in_another_order_are_read_by_name(tmp_path):
    write_table(tmp_path / "a.csv", ["t", "qw", "qx", "qy", "qz", "x", "y", "z"], [[0, 0, 1, 0, 0, 1, 2, 3]])
    (tool,) = read_recording(tmp_path / "a.csv").poses.values()
    np.testing.assert_array_equal(
        tool.matrices[0], [[1, 0, 0, 1], [0, -1, 0, 2], [0, 0, -1, 3], [0, 0, 0, 1]]
    )


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (
            "a,b\n1,2\n",
            "a.csv: has no columns of poses; name them ProbeToTrackerTransform, Probe_m00 to Probe_m33, or "
            "Probe_qw, Probe_qx, Probe_qy, Probe_qz, Probe_x, Probe_y, Probe_z",
        ),
        (
            "t,qw,qx,qy,qz,x,y,z\n0,1,0,0,zero,1,2,3\n",
            "a.csv, line 2, column qz: 'zero' is not a number; write a decimal number such as 12.5",
        ),
        ("t,qw,qx,qy,qz,x,y\n0,1,0,0,0,1,2\n", "a.csv, line 1: lacks the column z beside x"),
        (
            "t,qw,qx,qy,qz,x,y,z\n0,1,0,0,1,1,2,3\n",
            "a.csv, row 0: the quaternion of Tool has length 1.41 where 1 is due; check the order of its columns",
        ),
        (
            "t,ProbeToTrackerTransform\n0,1 2 3\n",
            "a.csv, line 2, column ProbeToTrackerTransform: '1 2 3' is not 16 numbers",
        ),
        ("t,qw\n0\n", "a.csv, line 2: has 1 cells where the header has 2; quote cells that hold a comma"),
        ("t,qw\n", "a.csv: has a header but no rows; write one row an instant"),
        ("nan,qw\n0,1\n", "a.csv, line 1: lacks the column qx beside qw"),
    ],
)
def test_bad_tables_are_refused(tmp_path, text, sentence):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value) == sentence
