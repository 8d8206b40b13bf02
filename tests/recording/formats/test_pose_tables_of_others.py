"""Tables of poses as other people's programs spell them: what holds, of which tool a row is, in what unit and when."""

import csv
import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.recording.formats import read_recording, write_recording
from tests.builders.recordings import random_poses
from tests.builders.tables import TIMES, N, quaternions_xyzw

SEEDS = st.integers(0, 2**32)
TURN, PLACE = ("qx", "qy", "qz", "qw"), ("x", "y", "z")
HOLDS = {
    "OK": "INVALID",
    "1": "0",
    "True": "False",
    "VALID": "lost",
    "yes": "no",
    "tracked": "",
    "1.0": "0.0",
}


def rows_of(matrices, mm_per_unit=1.0):
    return np.column_stack([TIMES, quaternions_xyzw(matrices), matrices[:, :3, 3] / mm_per_unit]).tolist()


def written(path, header, rows):
    text = io.StringIO(newline="")
    csv.writer(text, lineterminator="\n").writerows([header, *rows])
    path.write_text(text.getvalue())
    return path


@pytest.mark.parametrize("name", ["Probe_status", "Probe_valid", "Probe.isVisible", "Probe Tracked", "valid"])
@given(seed=SEEDS, seen=st.lists(st.booleans(), min_size=N, max_size=N), word=st.sampled_from([*HOLDS]))
def test_what_a_column_says_does_not_hold_is_invalid(tmp_path_factory, name, seed, seen, word):
    """However the column is called, and whatever its words; a tool that was never seen is none that always was."""
    path = tmp_path_factory.mktemp("poses") / "a.csv"
    matrices = random_poses(np.random.default_rng(seed), N)
    said = [word if one else HOLDS[word] for one in seen]
    header = ["t", *(f"Probe_{k}" for k in (*TURN, *PLACE)), name]
    rows = [[*row, one] for row, one in zip(rows_of(matrices), said, strict=True)]
    probe = read_recording(written(path, header, rows)).poses["tracker_from_probe"]
    assert probe.valid.tolist() == seen
    assert probe.status == tuple(said)


@pytest.mark.parametrize(
    "name", ["Probe_invalid", "Probe.isOccluded", "Probe Lost", "Probe_untracked", "invisible"]
)
@given(
    seed=SEEDS,
    lost=st.lists(st.booleans(), min_size=N, max_size=N),
    words=st.sampled_from(["01", ("", "Yes")]),
)
def test_what_a_column_says_is_lost_is_invalid(tmp_path_factory, name, seed, lost, words):
    path = tmp_path_factory.mktemp("poses") / "a.csv"
    header = ["t", *(f"Probe_{k}" for k in (*TURN, *PLACE)), name]
    matrices = random_poses(np.random.default_rng(seed), N)
    rows = [[*row, words[one]] for row, one in zip(rows_of(matrices), lost, strict=True)]
    probe = read_recording(written(path, header, rows)).poses["tracker_from_probe"]
    assert (~probe.valid).tolist() == lost


@pytest.mark.parametrize("word", ["2", "OK"])
def test_a_word_in_a_column_of_what_is_lost_that_says_neither_is_refused(tmp_path, word):
    header = ["t", *(f"Probe_{k}" for k in (*TURN, *PLACE)), "Probe_lost"]
    rows = [
        [*row, "0" if i else word] for i, row in enumerate(rows_of(random_poses(np.random.default_rng(0), N)))
    ]
    with pytest.raises(
        InputError, match=rf"line 2, column Probe_lost: '{word}' does not say .* write 0 or false where"
    ):
        read_recording(written(tmp_path / "a.csv", header, rows))


def test_words_that_do_not_say_whether_a_pose_holds_are_refused(tmp_path):
    header = ["t", *(f"Probe_{k}" for k in (*TURN, *PLACE)), "Probe_status"]
    rows = [[*row, "recording"] for row in rows_of(random_poses(np.random.default_rng(0), N))]
    with pytest.raises(
        InputError, match="line 2, column Probe_status: 'recording' does not say whether a pose holds"
    ):
        read_recording(written(tmp_path / "a.csv", header, rows))


@given(seed=SEEDS, column=st.sampled_from(["tool", "Tool Name", "rigid_body", "child_frame_id", "id"]))
def test_a_row_may_be_of_the_tool_that_it_names(tmp_path_factory, seed, column):
    """Rows in any order of tools give each its poses, as columns for each tool do."""
    rng = np.random.default_rng(seed)
    path = tmp_path_factory.mktemp("poses") / "a.csv"
    tools = {name: random_poses(rng, N) for name in ("Probe", "Needle", "Stylus")}
    rows = [[name, *row] for name, matrices in tools.items() for row in rows_of(matrices)]
    rows.sort(key=lambda row: (row[1], rng.random()))
    recording = read_recording(written(path, [column, "t", *TURN, *PLACE], rows))
    np.testing.assert_array_equal(recording.times, TIMES)
    assert len(recording.poses) == len(tools)
    for name, matrices in tools.items():
        poses = recording.poses[f"tracker_from_{name.lower()}"]
        assert poses.valid.all()
        np.testing.assert_allclose(poses.matrices, matrices, atol=1e-9)


def test_a_column_that_counts_rows_or_names_one_tool_parts_nothing(tmp_path):
    matrices = random_poses(np.random.default_rng(0), N)
    for name, cells in (("id", range(N)), ("tool", ["Probe"] * N)):
        rows = [[cell, *row] for cell, row in zip(cells, rows_of(matrices), strict=True)]
        recording = read_recording(written(tmp_path / "Probe.csv", [name, "t", *TURN, *PLACE], rows))
        assert list(recording.poses) == ["tracker_from_probe"]
        assert len(recording) == N


def test_rows_of_several_tools_without_times_are_refused(tmp_path):
    rows = [[tool, *row[1:]] for tool in "ab" for row in rows_of(random_poses(np.random.default_rng(0), N))]
    with pytest.raises(InputError, match="its rows are of several tools and have no times"):
        read_recording(written(tmp_path / "a.csv", ["tool", *TURN, *PLACE], rows))


@pytest.mark.parametrize(
    ("unit", "mm", "read_as"),
    [
        ("_um", 1e-3, "micrometres"),
        (" (in)", 25.4, "inches"),
        (" [cm]", 10.0, "centimetres"),
        ("", 1, "millimetres"),
    ],
)
def test_lengths_are_in_the_unit_that_the_columns_say(tmp_path, unit, mm, read_as):
    matrices = random_poses(np.random.default_rng(0), N)
    header = ["t", *TURN, *(axis + unit for axis in PLACE)]
    recording = read_recording(written(tmp_path / "Probe.csv", header, rows_of(matrices, mm)))
    np.testing.assert_allclose(recording.poses["tracker_from_probe"].matrices, matrices, rtol=1e-9, atol=1e-9)
    assert recording.provenance.lengths == read_as


def test_what_ros_prints_is_in_metres(tmp_path):
    matrices = random_poses(np.random.default_rng(0), N)
    header = [
        "%time",
        *(f"field.pose.orientation.{k}" for k in "xyzw"),
        *(f"field.pose.position.{k}" for k in "xyz"),
    ]
    rows = [[1_700_000_000_000_000_000 + round(1e9 * row[0]), *row[1:]] for row in rows_of(matrices, 1000.0)]
    recording = read_recording(written(tmp_path / "Probe.csv", header, rows))
    np.testing.assert_allclose(recording.poses["tracker_from_probe"].matrices, matrices, atol=1e-9)
    np.testing.assert_allclose(recording.times, 1.7e9 + TIMES, atol=1e-6)
    assert recording.provenance.lengths == "metres"


@given(start=st.integers(0, 86399), step_ms=st.integers(1, 3_600_000), comma=st.booleans())
def test_times_of_day_go_on_after_midnight(tmp_path_factory, start, step_ms, comma):
    path = tmp_path_factory.mktemp("poses") / "Probe.csv"
    stamps_ms = 1000 * start + step_ms * np.arange(N)
    clock = [
        f"{ms // 3_600_000 % 24:02}:{ms // 60_000 % 60:02}:{ms // 1000 % 60:02}.{ms % 1000:03}"
        for ms in stamps_ms
    ]
    rows = [
        [stamp.replace(".", ",") if comma else stamp, *row[1:]]
        for stamp, row in zip(clock, rows_of(random_poses(np.random.default_rng(0), N)), strict=True)
    ]
    recording = read_recording(written(path, ["Time", *TURN, *PLACE], rows))
    np.testing.assert_allclose(recording.times, stamps_ms / 1000, atol=1e-6)
    assert [one.code for one in recording.diagnostics] == ["time-unit"]


@pytest.mark.parametrize("cell", ["01.05.2024 12:00:00", "5/1/2024 12:00 PM", "24:00:00.5", "noon"])
def test_what_is_no_time_is_refused_with_how_to_write_one(tmp_path, cell):
    rows = [[cell, *row[1:]] for row in rows_of(random_poses(np.random.default_rng(0), N))]
    with pytest.raises(
        InputError, match=r"line 2, column t: .* is not a date and time; write .*2024-05-01T12:00:00"
    ):
        read_recording(written(tmp_path / "a.csv", ["t", *TURN, *PLACE], rows))


@pytest.mark.parametrize("nothing", ["", "NA", "N/A", "None", "null", "nan", "Missing", "-", "0"])
def test_a_pose_of_nothing_was_not_seen(tmp_path, nothing):
    """What programs write where a tool is out of view; a quaternion of zeros turns nothing."""
    matrices = random_poses(np.random.default_rng(0), N)
    rows = rows_of(matrices)
    rows[3][1:] = [nothing] * 7
    recording = read_recording(written(tmp_path / "Probe.csv", ["t", *TURN, *PLACE], rows))
    probe = recording.poses["tracker_from_probe"]
    assert np.flatnonzero(~probe.valid).tolist() == [3]
    write_recording(recording, tmp_path / "again.csv")
    again = read_recording(tmp_path / "again.csv").poses["tracker_from_probe"]
    np.testing.assert_array_equal(again.valid, probe.valid)


def test_the_word_of_excel_on_separators_is_no_header(tmp_path):
    header = ";".join(["t", *TURN, *PLACE])
    rows = [";".join(map(repr, row)) for row in rows_of(random_poses(np.random.default_rng(0), N))]
    plain, told = tmp_path / "Probe.csv", tmp_path / "told"
    plain.write_text("\n".join([header, *rows]))
    told.mkdir()
    (told / "Probe.csv").write_text("sep=;\n" + plain.read_text())
    first, second = (read_recording(path).poses["tracker_from_probe"] for path in (plain, told / "Probe.csv"))
    assert first.matrices.tobytes() == second.matrices.tobytes()


def test_a_matrix_in_a_cell_may_have_brackets(tmp_path):
    matrices = random_poses(np.random.default_rng(0), N)
    rows = [[time, str(one.tolist())] for time, one in zip(TIMES.tolist(), matrices, strict=True)]
    recording = read_recording(written(tmp_path / "a.csv", ["t", "ProbeToTrackerTransform"], rows))
    assert recording.poses["tracker_from_probe"].matrices.tobytes() == matrices.tobytes()
