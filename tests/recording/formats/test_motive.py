"""Motive's export."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, InputError, UnsupportedError
from sonocal.recording.formats import read_recording
from tests.builders.recordings import random_poses
from tests.builders.tables import TIMES, N, motive


def test_motive_with_euler_angles_is_refused(tmp_path):
    motive(tmp_path / "a.csv", random_poses(np.random.default_rng(0), N), kind="XYZ")
    with pytest.raises(UnsupportedError) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value) == "a.csv: its rotations are 'XYZ'; export them from Motive as Quaternion"


@given(seed=st.integers(0, 2**32), blank=st.sets(st.integers(0, N - 1), max_size=N - 1))
def test_units_change_the_spelling_and_not_the_poses(tmp_path_factory, seed, blank):
    folder, matrices = tmp_path_factory.mktemp("motive"), random_poses(np.random.default_rng(seed), N)
    read = {}
    for unit in ("Meters", "Millimeters"):
        motive(folder / f"{unit}.csv", matrices, unit, blank)
        recording = read_recording(folder / f"{unit}.csv")
        read[unit] = recording.poses["tracker_from_needle"]
        assert recording.fields["Length Units"] == unit
        assert [d.code for d in recording.diagnostics] == ["motive-axes"]
        np.testing.assert_array_equal(recording.times, TIMES)
    seen = read["Meters"].valid
    assert set(np.flatnonzero(~seen).tolist()) == blank
    np.testing.assert_allclose(read["Meters"].matrices, read["Millimeters"].matrices, rtol=0, atol=1e-12)
    np.testing.assert_allclose(read["Meters"].matrices[seen], matrices[seen], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "kind", "words"),
    [
        ("Meters", "Feet", InputError, "a.csv: its Length Units are 'Feet'; export metres or millimetres"),
        ("Rigid Body,", "Skeleton,", InputError, "a.csv: holds no rigid body; export rigid bodies"),
        (
            "Time (Seconds)",
            "Time",
            FormatError,
            "a.csv: has no row 'Frame,Time (Seconds),...' with data below it",
        ),
        ("Rotation,", "Turn,", FormatError, "a.csv: lacks the rows of types, names and quantities"),
        ("X,Y,Z,W", "X,Y,Z,V", FormatError, "a.csv: rigid body 'Needle' lacks its column Rotation W"),
    ],
)
def test_what_is_missing_of_an_export_is_said(tmp_path, old, new, kind, words):
    motive(tmp_path / "a.csv", random_poses(np.random.default_rng(0), N))
    text = (tmp_path / "a.csv").read_text()
    assert old in text
    (tmp_path / "a.csv").write_text(text.replace(old, new))
    with pytest.raises(kind) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value).startswith(words)


@given(seed=st.integers(0, 2**32), blank=st.sets(st.integers(0, N - 1), max_size=N - 1))
def test_headers_whose_rows_have_no_names_are_read_alike(tmp_path_factory, seed, blank):
    """Until version 1.22 the first cells of the rows of types, names and numbers are empty."""
    path = tmp_path_factory.mktemp("motive") / "a.csv"
    motive(path, random_poses(np.random.default_rng(seed), N), blank=blank)
    named = read_recording(path).poses["tracker_from_needle"]
    text = path.read_text().replace("1.23,", "1.22,", 1)
    for word in ("Type", "Name", "ID"):
        text = text.replace(f"\n,{word},", "\n,,")
    path.write_text(text)
    assert read_recording(path).poses["tracker_from_needle"].matrices.tobytes() == named.matrices.tobytes()
