"""Every table of poses as the spreadsheets and databases of the world spell it: separators, decimal commas, frames."""

import csv
import io

import numpy as np
import pytest

from sonocal import InputError, read_observations
from sonocal.detection import read_detections
from sonocal.recording.formats import read_recording
from tests.builders.recordings import random_poses
from tests.builders.tables import N, matrices_in, motive
from tests.builders.trackers import ndi_capi, ndi_toolbox, tum, vicon_bodies

LOST = {2, 7}


def plain(form, path):
    """A table as its program writes it, in English; returns its rows."""
    matrices = random_poses(np.random.default_rng(3), N)
    if form == "motive":
        motive(path, matrices, blank=LOST)
    elif form in ("matrix", "metres"):
        matrices_in(form, path, matrices, blank=LOST)
    else:
        logs = {
            "vicon": lambda tools: vicon_bodies(tools, lost=LOST, rate=99.5),
            "vicon angles": lambda tools: vicon_bodies(tools, kind="XYZ", lost=LOST),
            "capi": lambda tools: ndi_capi(tools, lost=LOST, markers=2),
            "toolbox": lambda tools: ndi_toolbox(tools, lost=LOST, separator=","),
        }
        path.write_text(logs[form]({"Needle": matrices}))
    return list(csv.reader(io.StringIO(path.read_text())))


def spelt(rows, separator, comma):
    """The rows with another separator, and decimal commas where they are wanted."""
    cells = [[cell.replace(".", ",") if comma and is_number(cell) else cell for cell in row] for row in rows]
    if separator == ",":
        return "\n".join(",".join(row) for row in cells) + "\n"
    text = io.StringIO(newline="")
    csv.writer(text, delimiter=separator, lineterminator="\n").writerows(cells)
    return text.getvalue()


def is_number(cell):
    try:
        return float(cell) is not None
    except ValueError:
        return False


FORMS = ("motive", "matrix", "metres", "vicon", "vicon angles", "capi", "toolbox")


def read(path, form):
    return read_recording(path, angles="XYZ" if form == "vicon angles" else None)


@pytest.mark.parametrize("separator", [";", "\t"])
@pytest.mark.parametrize("comma", [False, True])
@pytest.mark.parametrize("form", FORMS)
def test_a_table_says_the_same_however_its_locale_spells_numbers(tmp_path, form, separator, comma):
    path = tmp_path / "Needle.csv"
    rows = plain(form, path)
    wanted = read(path, form)
    path.write_text(spelt(rows, separator, comma))
    found = read(path, form)
    assert list(found.poses) == list(wanted.poses) != []
    for name, poses in wanted.poses.items():
        assert found.poses[name].matrices.tobytes() == poses.matrices.tobytes()
        assert found.poses[name].valid.tolist() == poses.valid.tolist()
        assert set(np.flatnonzero(~poses.valid).tolist()) == LOST
    assert found.times.tobytes() == wanted.times.tobytes()


@pytest.mark.parametrize("form", FORMS)
def test_commas_that_part_cells_and_decimals_alike_are_named(tmp_path, form):
    """Nothing tells one from the other any more: whatever is read of such a table is wrong."""
    path = tmp_path / "Needle.csv"
    path.write_text(spelt(plain(form, path), ",", comma=True))
    with pytest.raises(InputError) as caught:
        read(path, form)
    assert "if its commas are decimal ones, separate cells by semicolons" in str(caught.value)


@pytest.mark.parametrize("form", FORMS)
def test_commas_that_part_thousands_are_no_decimal_ones(tmp_path, form):
    path = tmp_path / "Needle.csv"
    rows = plain(form, path)
    row = next(i for i, cells in enumerate(rows) if sum(map(is_number, cells)) >= 8) + 1
    numbers = [i for i, cell in enumerate(rows[row]) if "." in cell and is_number(cell)]
    # The last number of a place, or of a matrix the one above it.
    at = {"motive": 8, "matrix": 12, "metres": 7}.get(form, numbers[-1] if "vicon" in form else None)
    at = at if at is not None else rows[0].index("Tz")
    rows[row][at] = "1,234"
    path.write_text(spelt(rows, ";", comma=False))
    with pytest.raises(
        InputError, match=r"has a decimal point where .* have commas; write one of the two all over"
    ):
        read(path, form)


def test_a_trajectory_with_decimal_commas_is_read(tmp_path):
    matrices = random_poses(np.random.default_rng(3), N)
    path = tmp_path / "Needle.txt"
    path.write_text(tum(matrices))
    wanted = read_recording(path)
    path.write_text(tum(matrices).replace(".", ","))
    found = read_recording(path)
    assert found.times.tobytes() == wanted.times.tobytes()
    key = "tracker_from_needle"
    assert found.poses[key].matrices.tobytes() == wanted.poses[key].matrices.tobytes()


def boxed(rows, how):
    """A table as people and databases print it."""
    wide = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    padded = [[cell.ljust(width) for cell, width in zip(row, wide, strict=True)] for row in rows]
    dashes = ["-" * (width + 2) for width in wide]
    if how == "bare":
        lines = ["|".join(row) for row in rows]
    elif how == "markdown":
        lines = [f"| {' | '.join(row)} |" for row in padded]
        lines.insert(1, f"|{'|'.join(dash[:-1] + ':' for dash in dashes)}|")
    elif how == "psql":
        lines = [f" {' | '.join(row)} ".rstrip() for row in padded]
        lines.insert(1, "+".join(dashes))
        lines += [f"({len(rows) - 1} rows)", ""]
    else:
        rule = f"+{'+'.join(dashes)}+"
        lines = [f"| {' | '.join(row)} |" for row in padded]
        lines = [rule, lines[0], rule, *lines[1:], rule]
    return "\n".join(lines) + "\n"


BOXES = ("bare", "markdown", "psql", "mysql")


@pytest.mark.parametrize("how", BOXES)
def test_tables_of_poses_may_have_bars(tmp_path, how):
    path = tmp_path / "Needle.csv"
    rows = plain("metres", path)
    wanted = read_recording(path)
    path.write_text(boxed(rows, how))
    found = read_recording(path)
    assert found.times.tobytes() == wanted.times.tobytes()
    assert found.poses["tracker_from_needle"].matrices.tobytes() == (
        wanted.poses["tracker_from_needle"].matrices.tobytes()
    )


@pytest.mark.parametrize("how", BOXES)
def test_tables_of_sightings_and_of_points_may_have_bars(tmp_path, how):
    """Blank cells at the end and at the start of a row stay where they are."""
    ends = [f"{axis}{i}_mm" for i in range(3) for axis in "xyz"]
    header = ["note", "frame", "target", "u_px", "v_px", *ends]
    blank = ["", "", ""]
    rows = [header, *(["", str(i), "n", *map(str, np.arange(8) + i / 8), *blank] for i in range(4))]
    (tmp_path / "plain.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    (tmp_path / "boxed.csv").write_text("# image_size_px: 64 48\n" + boxed(rows, how))
    plain, found = (read_observations(tmp_path / f"{name}.csv") for name in ("plain", "boxed"))
    assert found.points_px.tobytes() == plain.points_px.tobytes()
    assert found.segments_mm.tobytes() == plain.segments_mm.tobytes()
    assert found.image_size_px == (64, 48)
    points = [row[1:5] for row in rows]
    (tmp_path / "points.csv").write_text(boxed(points, how))
    assert read_detections(tmp_path / "points.csv").points_px[:, 0].tobytes() == plain.points_px.tobytes()


@pytest.mark.parametrize(("stated", "told"), [("ZYX", "XYZ"), ("ZYX", "zyx"), ("vector", "ZYX")])
def test_an_order_that_contradicts_the_columns_is_refused(tmp_path, stated, told):
    """What columns say goes; whoever says otherwise is told, and who says the same is not."""
    header = ["t", *(f"Probe_{stated}_r{axis}_deg" for axis in "xyz"), "Probe_x", "Probe_y", "Probe_z"]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([",".join(header), "0,10,20,30,1,2,3", "1,20,30,10,1,2,3"]))
    with pytest.raises(InputError) as caught:
        read_recording(path, angles=told)
    assert str(caught.value) == (
        f"a.csv, line 1, column Probe_{stated}_rx_deg: says that its angles are {stated}, and {told} was given; "
        "leave angles out, or rename the columns"
    )
    alike, plain = (read_recording(path, angles=one).poses["tracker_from_probe"] for one in (stated, None))
    assert alike.matrices.tobytes() == plain.matrices.tobytes()
