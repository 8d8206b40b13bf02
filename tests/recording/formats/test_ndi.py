"""Logs of NDI's programs, against the poses that they were written from."""

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import FormatError, InputError
from sonocal.recording.formats import read_recording
from tests.builders.recordings import random_poses
from tests.builders.tables import TIMES, N
from tests.builders.trackers import ndi_capi, ndi_toolbox

SEEDS = st.integers(0, 2**32)
LOST = st.sets(st.integers(0, N - 1), max_size=N - 1)


def two_tools(seed=0):
    rng = np.random.default_rng(seed)
    return {"Probe s/n:1": random_poses(rng, N), "Needle s/n:2": random_poses(rng, N)}


def read(path, text):
    path.write_text(text)
    return read_recording(path)


@given(seed=SEEDS, lost=LOST, markers=st.integers(0, 3))
def test_the_api_s_log_gives_each_tool_its_poses(tmp_path_factory, seed, lost, markers):
    """Of a lost tool no markers are written, so that the next tool's cells do not stand below their header."""
    tools = two_tools(seed)
    recording = read(tmp_path_factory.mktemp("ndi") / "a.csv", ndi_capi(tools, lost, markers=markers))
    seen = ~np.isin(np.arange(N), [*lost])
    probe, needle = recording.poses["tracker_from_probe"], recording.poses["tracker_from_needle"]
    np.testing.assert_array_equal(probe.valid, seen)
    np.testing.assert_allclose(probe.matrices[seen], tools["Probe s/n:1"][seen], atol=1e-9)
    np.testing.assert_allclose(needle.matrices, tools["Needle s/n:2"], atol=1e-9)
    np.testing.assert_allclose(recording.times, 1.7e9 + TIMES, atol=1e-6)
    assert {probe.status[i] for i in lost} <= {"Missing"}


@pytest.mark.parametrize("separator", ",;\t")
@given(seed=SEEDS, lost=LOST, euler=st.booleans())
def test_toolbox_s_log_gives_each_tool_its_poses(tmp_path_factory, separator, seed, lost, euler):
    tools = two_tools(seed)
    text = ndi_toolbox(tools, lost, separator, euler)
    recording = read(tmp_path_factory.mktemp("ndi") / "a.tsv", text)
    seen = ~np.isin(np.arange(N), [*lost])
    for name, matrices in zip(("probe", "needle"), tools.values(), strict=True):
        found = recording.poses[f"tracker_from_{name}"]
        np.testing.assert_array_equal(found.valid, seen)
        np.testing.assert_allclose(found.matrices[seen], matrices[seen], atol=1e-7)
    np.testing.assert_array_equal(recording.times, TIMES)


def test_numbers_are_those_of_an_independent_parse(tmp_path):
    text = ndi_capi({"Stylus s/n:7": random_poses(np.random.default_rng(3), N)})
    found = read(tmp_path / "a.csv", text).poses["tracker_from_stylus"].matrices
    for matrix, row in zip(found, csv.DictReader(text.splitlines()), strict=True):
        turn = Rotation.from_quat([float(row[c]) for c in ("Q0", "Qx", "Qy", "Qz")], scalar_first=True)
        np.testing.assert_allclose(matrix[:3, :3], turn.as_matrix(), atol=1e-12)
        assert matrix[:3, 3].tolist() == [float(row[c]) for c in ("Tx", "Ty", "Tz")]


@pytest.mark.parametrize(
    ("titles", "names"),
    [
        (["Polaris s/n:1", "Polaris s/n:2"], ["PolarisPort1", "PolarisPort2"]),
        (["Port 0x01: JJH Probe  s/n:3E", "Port 2"], ["JJHProbe", "Port2"]),
    ],
)
def test_tools_are_called_as_in_the_log(tmp_path, titles, names):
    tools = dict.fromkeys(titles, random_poses(np.random.default_rng(0), N))
    assert list(read(tmp_path / "a.csv", ndi_capi(tools)).tools) == names


def test_a_tool_a_row_is_one_item_a_frame(tmp_path):
    tools = two_tools()
    both = list(csv.reader(ndi_capi(tools).splitlines()))
    width = (len(both[0]) - 1) // 2
    rows = [both[0][: 1 + width]]
    for row in both[1:]:
        rows += [["1", *row[1 : 1 + width]], ["1", *row[1 + width :]]]
    (tmp_path / "a.csv").write_text("\n".join(",".join(row) for row in rows))
    apart = read_recording(tmp_path / "a.csv")
    together = read(tmp_path / "b.csv", ndi_capi(tools))
    np.testing.assert_array_equal(apart.times, together.times)
    for name, poses in together.poses.items():
        np.testing.assert_array_equal(apart.poses[name].matrices, poses.matrices)


def test_a_log_without_a_clock_has_no_times(tmp_path):
    """Frames are counted at other rates by other devices."""
    assert np.isnan(read(tmp_path / "a.csv", ndi_capi(two_tools(), times=False)).times).all()


@pytest.mark.parametrize(
    ("change", "kind", "words"),
    [
        (
            lambda text: text[:-40],
            FormatError,
            "a.csv, line 13: ends after 34 cells, within a tool; delete the line if the log was cut there",
        ),
        (
            lambda text: text.replace("ToolCount", "Time,Distance,Tools").replace("\n2,", "\n2\n,"),
            FormatError,
            "a.csv, line 2: ends after 1 cells, before its tools; delete the line if the log was cut there",
        ),
        (lambda text: text.splitlines()[0], InputError, "a.csv: has a header but no rows; record it again"),
        (
            lambda text: text.replace(",Tz,", ",T,"),
            FormatError,
            "a.csv, line 1: lacks the column Tz of NDI's log; export it again",
        ),
        (
            lambda text: text.replace(",0.1,1,OK", ",0.1,none,OK"),
            FormatError,
            "a.csv, line 5: 'none' is not a number of markers; export it again",
        ),
    ],
)
def test_what_is_wrong_with_a_log_is_said(tmp_path, change, kind, words):
    with pytest.raises(kind) as caught:
        read(tmp_path / "a.csv", change(ndi_capi(two_tools(), lost=(3,), markers=1)))
    assert str(caught.value) == words


@pytest.mark.parametrize(
    "change",
    [
        # A time that stands behind the pose.
        lambda text: text.replace("Time [sec]", "Stamp", 1).replace("\tTz\tPort", "\tTime\tPort", 1),
        # A last tool that lacks columns, in rows that are as wide as the header.
        lambda text: "\n".join("\t".join(line.split("\t")[:-9]) for line in text.splitlines()),
    ],
)
def test_a_header_whose_columns_stand_elsewhere_ends_in_a_sentence_or_is_read(tmp_path, change):
    text = ndi_toolbox(two_tools(), lost=(3,))
    assert change(text) != text
    try:
        assert read(tmp_path / "a.tsv", change(text)).poses
    except (FormatError, InputError) as error:
        assert "\n" not in str(error)
