"""Vicon's exports, against the poses that they were written from; SciPy wrote the rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, InputError
from sonocal.recording.formats import read_recording
from sonocal.targets import Point
from tests.builders.recordings import random_poses
from tests.builders.tables import N
from tests.builders.trackers import SHAPE, marker_places, vicon_bodies, vicon_markers

SEEDS = st.integers(0, 2**32)
ORDERS = ("XYZ", "zyx", "YXZ", "xzy")
MODEL = [Point(name, "Probe", place) for name, place in zip("abcd", SHAPE, strict=True)]


def two_tools(seed):
    rng = np.random.default_rng(seed)
    return {"Probe": random_poses(rng, N), "Needle": random_poses(rng, N)}


@pytest.mark.parametrize("kind", ["quaternion", "vector", *ORDERS])
@given(
    seed=SEEDS,
    unit=st.sampled_from(["mm", "m"]),
    title=st.sampled_from(["Objects", "Segments"]),
    lost=st.sets(st.integers(0, N - 1), max_size=N - 1),
)
def test_bodies_have_their_poses(tmp_path_factory, kind, seed, unit, title, lost):
    path, tools = tmp_path_factory.mktemp("vicon") / "a.csv", two_tools(seed)
    path.write_text(vicon_bodies(tools, kind, unit, title, lost))
    recording = read_recording(path, angles=None if kind == "quaternion" else kind)
    seen = ~np.isin(np.arange(N), [*lost])
    for name, matrices in tools.items():
        found = recording.poses[f"tracker_from_{name.lower()}"]
        np.testing.assert_array_equal(found.valid, seen)
        np.testing.assert_allclose(found.matrices[seen], matrices[seen], atol=1e-6)
    np.testing.assert_allclose(recording.times, np.arange(N) / 100)


@given(seed=SEEDS, hidden=st.sets(st.tuples(st.integers(0, N - 1), st.integers(0, 3)), max_size=6))
def test_markers_have_the_pose_of_their_body(tmp_path_factory, seed, hidden):
    path = tmp_path_factory.mktemp("vicon") / "a.csv"
    matrices = random_poses(np.random.default_rng(seed), N)
    path.write_text(vicon_markers(marker_places(matrices), [f"Probe:{m}" for m in "abcd"], hidden))
    found = read_recording(path, markers=MODEL).poses["tracker_from_probe"]
    seen = np.array([sum((i, m) not in hidden for m in range(4)) >= 3 for i in range(N)])
    np.testing.assert_array_equal(found.valid, seen)
    np.testing.assert_allclose(found.matrices[seen], matrices[seen], atol=1e-9)


@pytest.mark.parametrize("separator", ";\t")
def test_one_body_between_other_separators_is_read(tmp_path, separator):
    """Its name stands alone between blank cells."""
    tools = {"Probe": two_tools(0)["Probe"]}
    (tmp_path / "a.txt").write_text(vicon_bodies(tools).replace(",", separator).replace("mm", "MM"))
    found = read_recording(tmp_path / "a.txt").poses["tracker_from_probe"]
    np.testing.assert_allclose(found.matrices, tools["Probe"], atol=1e-9)


@pytest.mark.parametrize("unit", ["", "turns"])
def test_angles_without_a_unit_are_refused(tmp_path, unit):
    (tmp_path / "a.csv").write_text(vicon_bodies(two_tools(0), "XYZ").replace("deg", unit))
    with pytest.raises(
        InputError, match=f"the unit of Probe:Probe RX is '{unit}', and its angles may be degrees or"
    ):
        read_recording(tmp_path / "a.csv", angles="XYZ")


def test_what_is_no_list_of_markers_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text(vicon_markers(marker_places(two_tools(0)["Probe"]), list("abcd")))
    for other in ("markers.toml", [1, 2], 5):
        with pytest.raises(
            InputError, match=r"markers must be a list of points \(see targets\.read_points_toml\)"
        ):
            read_recording(tmp_path / "a.csv", markers=other)


def test_semicolons_and_decimal_commas_are_read(tmp_path):
    tools = two_tools(0)
    text = vicon_bodies(tools).replace(",", ";").replace(".", ",")
    (tmp_path / "a.csv").write_text(text)
    found = read_recording(tmp_path / "a.csv").poses["tracker_from_needle"]
    np.testing.assert_allclose(found.matrices, tools["Needle"], atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "old", "new", "error", "words"),
    [
        (
            "XYZ",
            "",
            "",
            InputError,
            "a.csv: the rotation of Probe:Probe is three numbers, RX, RY, RZ, whose meaning",
        ),
        (
            "quaternion",
            "mm",
            "ft",
            InputError,
            "a.csv: the unit of Probe:Probe TX is 'ft'; export mm, cm or m",
        ),
        ("quaternion", "TZ", "T", FormatError, "a.csv: 'Probe:Probe' lacks its column TZ; export it again"),
        ("quaternion", "\n100\n", "\n0\n", InputError, "a.csv, line 2: 0 frames a second is no rate"),
        (
            "quaternion",
            "Frame,",
            "Number,",
            FormatError,
            "a.csv, line 1: lacks the rate, names, axes or units",
        ),
    ],
)
def test_what_an_export_lacks_is_said(tmp_path, kind, old, new, error, words):
    (tmp_path / "a.csv").write_text(vicon_bodies(two_tools(0), kind).replace(old, new))
    with pytest.raises(error) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value).startswith(words)
