"""Every reader of the public face, given a file of every other kind: called what it is, and who takes it."""

import itertools

import numpy as np
import pytest

import sonocal as sc
from sonocal.detection import read_detections
from sonocal.files.elsewhere import NAMES, USES
from sonocal.observations import observations_csv
from sonocal.simulation.scene import simulate_observations
from sonocal.targets import read_lines
from sonocal.validation import read_point_sightings

READERS = {
    "observations": sc.read_observations,
    "recording": sc.read_recording,
    "calibration": sc.load,
    "targets": read_lines,
    "points": read_detections,
    "known points": read_point_sightings,
}
ALIKE = {frozenset(("points", "known points"))}
POSES = b"# of a tracker\ntime_s,Probe_qw,Probe_qx,Probe_qy,Probe_qz,Probe_x,Probe_y,Probe_z\n"
NEEDLE = b'[[line]]\nname = "a"\nframe = "N"\nfrom_mm = [0.0, 0.0, 0.0]\nto_mm = [0.0, 0.0, -9.0]\n'
PLAIN = {
    "points.csv": ("points", b"# by hand\nframe,u_px,v_px\n0,1,2\n"),
    "known.csv": ("known points", b"# measured\nu_px,v_px,x_mm,y_mm,z_mm\n1,2,3,4,5\n2,2,3,4,6\n"),
    "devices.xml": ("device set", b"<PlusConfiguration/>"),
    "needle.toml": ("targets", NEEDLE),
    "poses.csv": ("recording", POSES),
}
FILES = {"table.csv": "observations", "calibration.json": "calibration"} | {
    name: kind for name, (kind, _) in PLAIN.items()
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    here = tmp_path_factory.mktemp("kinds")
    rows = simulate_observations(2, 20, seed=1).observations.with_sound(image_size_px=(500, 500))
    (here / "table.csv").write_bytes(observations_csv(rows))
    sc.calibrate(rows).save(here / "calibration.json")
    for name, (_, content) in PLAIN.items():
        (here / name).write_bytes(content)
    moves = np.column_stack([np.arange(3), np.tile([1, 0, 0, 0], (3, 1)), np.arange(9).reshape(3, 3)])
    with (here / "poses.csv").open("a") as file:
        np.savetxt(file, moves, delimiter=",")
    return here


@pytest.mark.parametrize(("reader", "name"), [*itertools.product(READERS, FILES)])
def test_a_file_in_anothers_place_is_called_what_it_is(folder, reader, name):
    kind = FILES[name]
    if reader == kind or frozenset((reader, kind)) in ALIKE or (reader, kind) == ("targets", "device set"):
        return
    with pytest.raises(sc.InputError) as caught:
        READERS[reader](folder / name)
    said = str(caught.value)
    # Tables of poses are known by the formats of recordings alone, which these readers do not import.
    assert said == f"{name}: is {NAMES[kind]}; {USES[kind]}" or (kind == "recording" and name in said)


@pytest.mark.parametrize("name", ["points.csv", "known.csv", "poses.csv", "table.csv", "needle.toml"])
def test_comment_lines_above_a_header_hide_nothing(folder, name):
    assert READERS[FILES[name]](folder / name) is not None


def test_misnamed_columns_are_named_and_not_taken_for_another_table(folder):
    text = (folder / "table.csv").read_text().replace("x0_mm", "x0")
    (folder / "renamed.csv").write_text(text)
    with pytest.raises(
        sc.InputError, match=r"renamed\.csv, line 2: lacks the column x0_mm; the header has frame"
    ):
        sc.read_observations(folder / "renamed.csv")
