"""Every command, given a file of every kind that it does not take: one sentence that says what the file is."""

import json
import shutil
from pathlib import Path

import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.files.png import png
from sonocal.observations import write_observations
from sonocal.simulation.scene import simulate_observations

PAGE = "<!DOCTYPE html>\n<html><head><title>404</title></head><body>Not found<br></body></html>\n"
NEEDLE = '[[line]]\nname = "a"\nframe = "Needle"\nfrom_mm = [0.0, 0.0, 0.0]\nto_mm = [0.0, 0.0, -333.0]\n'
DEVICES = "<PlusConfiguration>\n  <CoordinateDefinitions/>\n</PlusConfiguration>\n"
# What the sentence must call each file.
WRONG = {
    "page.html": "web page",
    "page.xml": "web page",
    "page.csv": "web page",
    "empty.txt": "empty",
    "folder": "directory",
    "picture.png": "recording",
    "other.json": "JSON",
    "needle.toml": "needles, wires or points",
    "devices.xml": "device set",
    "table.csv": "table of sightings",
    "calibration.json": "JSON",
}
TAKEN = {
    ("calibrate", "{}", "-o", "out"): ("table.csv",),
    ("calibrate", "table.csv", "-o", "out", "--expected", "{}"): ("calibration.json", "devices.xml"),
    ("calibrate", "picture.png", "-o", "out", "--lines", "{}"): ("needle.toml", "devices.xml"),
    ("validate", "{}", "table.csv", "-o", "out"): ("calibration.json",),
    ("validate", "calibration.json", "{}", "-o", "out"): ("table.csv",),
    ("validate", "calibration.json", "table.csv", "-o", "out", "--compare", "{}"): ("calibration.json",),
    ("export", "{}", "--to", "itk", "-o", "out"): ("calibration.json",),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    import numpy as np

    here = tmp_path_factory.mktemp("wrong")
    rows = simulate_observations(2, 20, seed=1).observations
    write_observations(rows, here / "table.csv")
    sc.calibrate(rows).save(here / "calibration.json")
    for name in ("page.html", "page.xml", "page.csv"):
        (here / name).write_text(PAGE)
    (here / "empty.txt").touch()
    (here / "folder").mkdir()
    (here / "picture.png").write_bytes(png(np.zeros((30, 40), dtype=np.uint8)))
    (here / "other.json").write_text(json.dumps({"matrix": [1, 2]}))
    (here / "needle.toml").write_text(NEEDLE)
    (here / "devices.xml").write_text(DEVICES)
    return here


@pytest.mark.parametrize("wrong", WRONG)
@pytest.mark.parametrize("command", TAKEN, ids=" ".join)
def test_a_file_of_another_kind_is_called_what_it_is(folder, command, wrong, monkeypatch):
    if wrong in TAKEN[command]:
        return
    monkeypatch.chdir(folder)
    there = sorted(path.name for path in Path().iterdir())
    done = CliRunner().invoke(main, [word.format(wrong) for word in command])
    assert done.exit_code == 1, done.output
    assert done.output.count("\n") == 1
    assert wrong in done.output
    assert WRONG[wrong] in done.output or (wrong == "empty.txt" and "truncated" in done.output)
    assert sorted(path.name for path in Path().iterdir()) == there


SWAPPED = {
    (
        "calibrate",
        "needle.toml",
        "--lines",
        "picture.png",
    ): "needle.toml: is a file of needles, wires or points; give it",
    (
        "calibrate",
        "calibration.json",
    ): "calibration.json: is a JSON file; a calibration is read by sonocal.load",
    ("calibrate", "picture.png"): "picture.png: is a recording; say with --lines which needle",
    (
        "calibrate",
        "picture.png",
        "--lines",
        "table.csv",
    ): "table.csv: is a table of sightings; give it to sonocal",
    (
        "tool",
        "table.csv",
        "-o",
        "needle.toml",
    ): "table.csv: is a table of sightings; give it to sonocal calibrate alone",
    (
        "detect",
        "table.csv",
        "--lines",
        "needle.toml",
    ): "table.csv: is a table of sightings; give it to sonocal",
    (
        "export",
        "table.csv",
        "--to",
        "itk",
        "-o",
        "a.tfm",
    ): "table.csv: is a table of sightings; name the calibration",
    ("calibrate", "renamed.csv", "-o", "new"): "renamed.csv, line 2: lacks the column x0_mm",
}


@pytest.mark.parametrize("command", SWAPPED, ids=" ".join)
def test_what_is_wrong_with_the_input_is_said_before_where_results_would_go(
    folder, command, monkeypatch, tmp_path
):
    shutil.copytree(folder, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    Path("renamed.csv").write_text(Path("table.csv").read_text().replace("x0_mm", "x0"))
    shutil.copytree(folder, "calibration")
    for name in ("a.tfm", "candidates.csv"):
        Path(name).write_text("mine")
    done = CliRunner().invoke(main, command)
    assert done.exit_code == 1
    assert done.output.startswith(f"Error: {SWAPPED[command]}")


@pytest.mark.parametrize("columns", [3, 4])
@pytest.mark.parametrize("separator", [" ", ",", ";", "\t"])
def test_a_matrix_that_lacks_a_part_is_no_table_without_a_header(tmp_path, columns, separator):
    path = tmp_path / "a.txt"
    row = separator.join(["0.5"] * columns)
    path.write_text("# of some program\n" + f"{row}\n" * 3)
    words = {3: "3 rows of 3 numbers, a rotation without a place", 4: "a 4 x 4 matrix without its last row"}
    done = CliRunner().invoke(main, ["info", str(path)])
    assert done.exit_code == 1
    assert words[columns] in " ".join(done.stderr.split())
