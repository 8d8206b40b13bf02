"""Poses in tables."""

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import InputError
from sonocal.recording import health
from sonocal.recording.formats import read_recording, write_recording
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
            "a.csv, row 0: the quaternion of a has length 1.41 where 1 is due; check the order of its columns",
        ),
        (
            "t,ProbeToTrackerTransform\n0,1 2 3\n",
            "a.csv, line 2, column ProbeToTrackerTransform: '1 2 3' is not 16 numbers",
        ),
        ("t,qw\n0\n", "a.csv, line 2: has 1 cells where the header has 2; quote cells that hold a comma"),
        ("t,qw\n", "a.csv: has a header but no rows; write one row an instant"),
        ("nan,qw\n0,1\n", "a.csv, line 1: lacks the column qx beside qw"),
        ("t,qx,qy,qz,x,y,z\n0,1,0,0,1,2,3\n", "a.csv, line 1: lacks the column qw beside qx"),
        ("t,qw,qx,qy,qz,y,z\n0,1,0,0,0,2,3\n", "a.csv, line 1: lacks the column x beside y"),
        (
            "t,Probe_roll,Probe_pitch,Probe_yaw,x,y,z\n0,1,2,3,1,2,3\n",
            "a.csv, line 1, column Probe_roll: roll is about another axis with every maker; name the angles by the "
            "axes that they turn about, such as Probe_ZYX_rx_deg",
        ),
        (
            "Recorded on Monday\n\nt,qw,qx,qy,qz,x,y,z\n0,1,0,0,0,1,2,3\n",
            "a.csv, line 3: has 8 cells where the header has 1; delete the lines above the header, or begin them "
            "with #",
        ),
    ],
)
def test_bad_tables_are_refused(tmp_path, text, sentence):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value) == sentence


QUATERNION = ("qw", "qx", "qy", "qz", "x", "y", "z")


@pytest.mark.parametrize(
    ("columns", "example"),
    [
        (8, "time_s,Probe_x,Probe_y,Probe_z,Probe_qx,Probe_qy,Probe_qz,Probe_qw"),
        (17, "time_s," + ",".join(f"Probe_m{i}{j}" for i in range(4) for j in range(4))),
    ],
)
@pytest.mark.parametrize("separator", ",; ")
def test_a_missing_header_is_named_and_one_is_shown(tmp_path, columns, example, separator):
    if (columns, separator) == (8, " "):
        columns = 9  # eight numbers between blanks are a TUM trajectory
    (tmp_path / "a.csv").write_text(2 * (separator.join(["0.5"] * columns) + "\n"))
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value) == (
        f"a.csv, line 1: holds {columns} numbers where a header must name the columns; put it above them, such as "
        f"{example}, in the order that your columns have"
    )


def test_blanks_between_columns_are_named(tmp_path):
    (tmp_path / "a.csv").write_text("t " + " ".join(QUATERNION) + "\n0 1 0 0 0 1 2 3\n")
    with pytest.raises(InputError, match=r"a\.csv, line 1: has blanks between its columns; write commas, "):
        read_recording(tmp_path / "a.csv")


SEEDS = st.integers(0, 2**32)
FORMS = ("cells", "matrix", "quaternion", "metres")


@st.composite
def spellings(draw):
    """How a program may spell one and the same table: order of columns, quotes, line ends,
    a mark, UTF-16, blank lines, separator, decimal comma."""
    return {
        "order": draw(st.randoms(use_true_random=False)),
        "quoting": draw(st.sampled_from([csv.QUOTE_MINIMAL, csv.QUOTE_ALL])),
        "end": draw(st.sampled_from(["\n", "\r\n"])),
        "blank": draw(st.booleans()),
        "separator": draw(st.sampled_from(",;\t")),
        "decimal_comma": draw(st.booleans()),
        "encoding": draw(st.sampled_from(["utf-8", "utf-8-sig", "utf-16"])),
    }


def respelt(path, how):
    """The same table, written by another program."""
    header, *rows = csv.reader(path.read_text().splitlines())
    order = list(range(len(header)))
    how["order"].shuffle(order)
    table = [[row[i] for i in order] for row in (header, *rows)]
    if how["blank"]:
        table.insert(2, [])
    if how["decimal_comma"] and how["separator"] != ",":
        table[1:] = [[cell.replace(".", ",") for cell in row] for row in table[1:]]
    with path.open("w", newline="", encoding=how["encoding"]) as file:
        writer = csv.writer(
            file, delimiter=how["separator"], quoting=how["quoting"], lineterminator=how["end"]
        )
        writer.writerows(table)


@pytest.mark.parametrize("form", FORMS)
@given(seed=SEEDS, how=spellings(), blank=st.sets(st.integers(0, N - 1)))
def test_the_spelling_of_a_table_changes_no_bit(tmp_path_factory, form, seed, how, blank):
    path = tmp_path_factory.mktemp("poses") / "a.csv"
    matrices_in(form, path, random_poses(np.random.default_rng(seed), N), blank)
    plain = read_recording(path)
    respelt(path, how)
    again = read_recording(path)
    assert again.poses.keys() == plain.poses.keys()
    assert again.times.tobytes() == plain.times.tobytes()
    for name, one in plain.poses.items():
        assert again.poses[name].matrices.tobytes() == one.matrices.tobytes()
        assert set(np.flatnonzero(~again.poses[name].valid).tolist()) == blank


@pytest.mark.parametrize("form", ["cells", "matrix"])
@given(seed=SEEDS)
def test_matrices_come_back_to_the_last_bit(tmp_path_factory, form, seed):
    path = tmp_path_factory.mktemp("poses") / "a.csv"
    matrices = random_poses(np.random.default_rng(seed), N)
    matrices_in(form, path, matrices)
    assert read_recording(path).poses["tracker_from_needle"].matrices.tobytes() == matrices.tobytes()


@pytest.mark.parametrize("form", FORMS)
@given(seed=SEEDS)
def test_a_table_and_a_sequence_hold_the_same(tmp_path_factory, form, seed):
    """Through a file of another format nothing changes."""
    folder = tmp_path_factory.mktemp("poses")
    matrices_in(form, folder / "a.csv", random_poses(np.random.default_rng(seed), N), blank=(1,))
    table = read_recording(folder / "a.csv")
    for suffix in (".mha", ".nrrd"):
        write_recording(table, folder / f"a{suffix}")
        again = read_recording(folder / f"a{suffix}")
        assert again.times.tobytes() == table.times.tobytes()
        mine, theirs = table.poses["tracker_from_needle"], again.poses["tracker_from_needle"]
        assert theirs.matrices.tobytes() == mine.matrices.tobytes()
        np.testing.assert_array_equal(theirs.valid, mine.valid)


@given(
    seed=SEEDS,
    status=st.lists(st.sampled_from(["OK", "ok", "1", "true", "INVALID", "", "0"]), min_size=N, max_size=N),
)
def test_a_status_other_than_ok_makes_a_pose_invalid(tmp_path_factory, seed, status):
    path = tmp_path_factory.mktemp("poses") / "a.csv"
    matrices = random_poses(np.random.default_rng(seed), N)
    cells = [" ".join(map(repr, one.ravel().tolist())) for one in matrices]
    header = ["t", "ProbeToReferenceTransform", "ProbeToReferenceTransformStatus"]
    write_table(path, header, zip(TIMES.tolist(), cells, status, strict=True))
    probe = read_recording(path).poses["reference_from_probe"]
    assert probe.valid.tolist() == [text in ("OK", "ok", "1", "true") for text in status]
    assert probe.status == tuple(status)
    assert probe.matrices.tobytes() == matrices.tobytes()


@pytest.mark.parametrize("rows", [3, 4])
def test_the_last_row_of_a_matrix_may_be_left_out_and_is_believed_where_it_stands(tmp_path, rows):
    header = ["t", *(f"Needle_m{i}{j}" for i in range(rows) for j in range(4))]
    matrix = np.diag([1.0, 1, 1, 1 if rows == 3 else 2])
    write_table(tmp_path / "a.csv", header, [[0, *matrix[:rows].ravel().tolist()]])
    found = read_recording(tmp_path / "a.csv").poses["tracker_from_needle"]
    np.testing.assert_array_equal(found.matrices[0], matrix)


ORDERS = ("XYZ", "ZYX", "YZX", "xyz", "zxy", "vector")


def with_angles(path, matrices, meaning, stated, unit="deg"):
    """Three angles about x, y and z, as SciPy has them."""
    turns = Rotation.from_matrix(matrices[:, :3, :3])
    if meaning == "vector":
        angles = turns.as_rotvec()
    else:
        angles = turns.as_euler(meaning)[:, [meaning.lower().index(axis) for axis in "xyz"]]
    angles = np.rad2deg(angles) if unit == "deg" else angles
    order = f"_{meaning}" if stated else ""
    header = ["t", *(f"Probe{order}_r{a}_{unit}" for a in "xyz"), *(f"Probe_{a}" for a in "xyz")]
    rows = np.column_stack([TIMES, angles, matrices[:, :3, 3]])
    write_table(path, header, rows.tolist())


@pytest.mark.parametrize("meaning", ORDERS)
@given(seed=SEEDS, stated=st.booleans(), unit=st.sampled_from(["deg", "rad"]))
def test_angles_are_read_in_the_order_that_is_stated(tmp_path_factory, meaning, seed, stated, unit):
    path, matrices = tmp_path_factory.mktemp("poses") / "a.csv", random_poses(np.random.default_rng(seed), N)
    with_angles(path, matrices, meaning, stated, unit)
    found = read_recording(path, angles=None if stated else meaning)
    np.testing.assert_allclose(found.poses["tracker_from_probe"].matrices, matrices, atol=1e-6)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        (
            "t,Probe_rx_deg,Probe_ry_deg,Probe_rz_deg,Probe_x,Probe_y,Probe_z",
            "a.csv, line 1, column Probe_rx_deg: is an angle about one of three axes whose order is not stated; say it "
            "in the columns' names, such as Probe_ZYX_rx_deg, or with --angles: ZYX or another order of axes",
        ),
        (
            "t,ZYX_rx,ZYX_ry,ZYX_rz,x,y,z",
            "a.csv, line 1, column ZYX_rx: is an angle about one of three axes whose unit is not stated; say it in the "
            "columns' names, such as Probe_ZYX_rx_deg, or _rad",
        ),
        (
            "t,ZYX_rx_deg,ZYX_ry_rad,ZYX_rz_deg,x,y,z",
            "a.csv, line 1: its angles are in deg and rad; write one",
        ),
    ],
)
def test_no_order_and_no_unit_of_angles_is_guessed(tmp_path, header, words):
    (tmp_path / "a.csv").write_text(f"{header}\n0,10,20,30,1,2,3\n")
    with pytest.raises(InputError) as caught:
        read_recording(tmp_path / "a.csv")
    assert str(caught.value).startswith(words)


@given(seed=SEEDS, meaning=st.sampled_from(ORDERS))
def test_degrees_are_not_taken_for_the_radians_that_they_are_said_to_be(tmp_path_factory, seed, meaning):
    path, matrices = tmp_path_factory.mktemp("poses") / "a.csv", random_poses(np.random.default_rng(seed), N)
    with_angles(path, matrices, meaning, stated=True)
    path.write_text(path.read_text().replace("_deg", "_rad"))
    words = rf"column Probe_{meaning}_rx_rad: reaches .* turns; are these degrees\? call it Probe_{meaning}_rx_deg;"
    with pytest.raises(InputError, match=words):
        read_recording(path)


@pytest.mark.parametrize("angles", ["ZYZ", "ZYx", "XY", "", "rotvec"])
def test_what_is_no_order_of_axes_is_refused(tmp_path, angles):
    with_angles(tmp_path / "a.csv", random_poses(np.random.default_rng(0), N), "XYZ", stated=False)
    with pytest.raises(InputError, match=r"is no meaning of three angles|is not stated"):
        read_recording(tmp_path / "a.csv", angles=angles)


@pytest.mark.parametrize(
    "header",
    [
        "t,Probe_qw,Probe_qx,Probe_qy,Probe_qz,Probe_x,Probe_y,Probe_z",
        "t,Probe.qw,Probe.qx,Probe.qy,Probe.qz,Probe.x,Probe.y,Probe.z",
        "t,Probe QW,Probe QX,Probe QY,Probe QZ,Probe Tx [mm],Probe Ty [mm],Probe Tz [mm]",
        "t,Probe:q_w,Probe:q_x,Probe:q_y,Probe:q_z,Probe:pos_x,Probe:pos_y,Probe:pos_z",
        "t,Probe/orientation.w,Probe/orientation.x,Probe/orientation.y,Probe/orientation.z,Probe/position.x,"
        "Probe/position.y,Probe/position.z",
    ],
)
def test_names_may_be_spelt_as_other_programs_do(tmp_path, header):
    (tmp_path / "a.csv").write_text(f"{header}\n0,0,1,0,0,1,2,3\n")
    (probe,) = read_recording(tmp_path / "a.csv").poses.values()
    assert probe.plus_name == "ProbeToTracker"
    np.testing.assert_array_equal(
        probe.matrices[0], [[1, 0, 0, 1], [0, -1, 0, 2], [0, 0, -1, 3], [0, 0, 0, 1]]
    )


@pytest.mark.parametrize(
    "header",
    [
        "qw,qx,qy,qz,x,y,z",
        "pose.orientation.w,pose.orientation.x,pose.orientation.y,pose.orientation.z,pose.position.x,"
        "pose.position.y,pose.position.z",
    ],
)
def test_a_file_names_the_tool_where_no_column_does(tmp_path, header):
    (tmp_path / "Stylus.csv").write_text(f"t,{header}\n0,1,0,0,0,1,2,3\n")
    assert list(read_recording(tmp_path / "Stylus.csv").poses) == ["tracker_from_stylus"]


@pytest.mark.parametrize("form", ["cells", "matrix"])
def test_transposed_matrices_are_called_so(tmp_path, form):
    matrices = random_poses(np.random.default_rng(0), N)
    matrices_in(form, tmp_path / "a.csv", np.swapaxes(matrices, 1, 2))
    recording = read_recording(tmp_path / "a.csv")
    with pytest.raises(
        InputError, match="NeedleToTracker is transposed: its place stands in the last row; write"
    ):
        recording.between("Tracker", "Needle")
    (warning,) = [one for one in health(recording) if one.code == "non-rigid-poses"]
    assert f"{N} poses are transposed" in warning.message


def test_long_names_and_cells_cost_no_more_than_their_length(tmp_path):
    """Names of separators alone are what a pattern would take the square of."""
    (tmp_path / "a.csv").write_text("t,qw,qx,qy,qz,x,y,z," + "_" * 100_000 + "\n0,1,0,0,0,1,2,3,4\n")
    assert len(read_recording(tmp_path / "a.csv")) == 1
    many = [f"Tool{i}_{k}" for i in range(2000) for k in ("qw", "qx", "qy", "qz", "x", "y", "z")]
    (tmp_path / "a.csv").write_text(",".join(["t", *many]) + "\n0" + ",1,0,0,0,1,2,3" * 2000 + "\n")
    assert len(read_recording(tmp_path / "a.csv").poses) == 2000
