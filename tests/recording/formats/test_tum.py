"""Trajectories of the TUM benchmarks: NumPy is the oracle."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import FormatError, InputError
from sonocal.recording import summarize
from sonocal.recording.formats import read_recording
from tests.builders.recordings import random_poses
from tests.builders.tables import N
from tests.builders.trackers import tum


@pytest.mark.parametrize("comment", ["", "# timestamp tx ty tz qx qy qz qw\n", "\n# a\n\n#b\n"])
@given(seed=st.integers(0, 2**32))
def test_poses_are_those_of_numpy_and_scipy(tmp_path_factory, comment, seed):
    path = tmp_path_factory.mktemp("tum") / "Probe.txt"
    path.write_text(tum(random_poses(np.random.default_rng(seed), N), comment))
    recording = read_recording(path)
    table = np.loadtxt(path)
    probe = recording.poses["tracker_from_probe"]
    np.testing.assert_array_equal(recording.times, table[:, 0])
    np.testing.assert_array_equal(probe.matrices[:, :3, 3], 1000 * table[:, 1:4])
    rotations = Rotation.from_quat(table[:, 4:]).as_matrix()
    np.testing.assert_allclose(probe.matrices[:, :3, :3], rotations, atol=1e-14)
    assert probe.valid.all()


def test_places_in_another_unit_than_metres_are_doubted_by_its_name(tmp_path):
    matrices = random_poses(np.random.default_rng(0), N)
    matrices[:, :3, 3] += [0, 0, 800]
    in_mm = matrices.copy()
    in_mm[:, :3, 3] *= 1000
    for name, poses in (("metres.txt", matrices), ("millimetres.txt", in_mm)):
        (tmp_path / name).write_text(tum(poses))
    assert not [
        d for d in summarize(read_recording(tmp_path / "metres.txt")).diagnostics if d.severity != "info"
    ]
    (doubt,) = summarize(read_recording(tmp_path / "millimetres.txt")).diagnostics
    assert doubt.code == "implausible-units"
    assert "millimetres" in doubt.message.split("?")[0]
    assert doubt.message.endswith("read as metres")
    assert "0.001" in doubt.advice


def test_tabs_are_blanks_and_stamps_that_are_no_seconds_are_told(tmp_path):
    matrices = random_poses(np.random.default_rng(0), N)
    (tmp_path / "Probe.txt").write_text(tum(matrices))
    plain = read_recording(tmp_path / "Probe.txt")
    lines = [line.split() for line in tum(matrices, "").splitlines()]
    counted = [[str(round(1e9 * (1_700_000_000 + float(line[0])))), *line[1:]] for line in lines]
    (tmp_path / "Probe.txt").write_text("\n".join("\t".join(line) for line in counted))
    again = read_recording(tmp_path / "Probe.txt")
    assert (
        again.poses["tracker_from_probe"].matrices.tobytes()
        == plain.poses["tracker_from_probe"].matrices.tobytes()
    )
    np.testing.assert_allclose(again.times - again.times[0], plain.times - plain.times[0], atol=1e-6)
    assert [one.code for one in again.diagnostics] == ["time-unit"]
    assert not plain.diagnostics


@pytest.mark.parametrize(
    ("last", "kind", "sentence"),
    [
        (
            "1 2 3 4 5 6 7",
            FormatError,
            "a.txt, line 3: is not eight numbers; a TUM trajectory has 'timestamp tx ty tz qx qy qz qw'",
        ),
        (
            "1 2 3 4 0 0 0 one",
            FormatError,
            "a.txt, line 3: is not eight numbers; a TUM trajectory has 'timestamp tx ty tz qx qy qz qw'",
        ),
        ("nan 2 3 4 0 0 0 1", InputError, "a.txt: a time is not finite; write seconds"),
        (
            "1 2 3 4 0 0 1 1",
            InputError,
            "a.txt, row 1: the quaternion of a has length 1.41 where 1 is due; check the order of its columns",
        ),
    ],
)
def test_lines_that_are_no_poses_are_refused(tmp_path, last, kind, sentence):
    (tmp_path / "a.txt").write_text("# a\n0 1 2 3 0 0 0 1\n" + last)
    with pytest.raises(kind) as caught:
        read_recording(tmp_path / "a.txt")
    assert str(caught.value) == sentence
