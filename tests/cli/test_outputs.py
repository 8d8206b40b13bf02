"""No command loses a file: what is read stays, what is there stays unless told, and runs do not mix."""

import os
import shutil

import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.files.png import png
from sonocal.simulation.scene import simulate_observations
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from tests.builders.calibrations import slipped_rows

COMMANDS = {
    "calibrate": ["calibrate", "table.csv", "-o", "out"],
    "calibrate a recording": ["calibrate", "sweep.igs.mha", "--lines", "needle.toml", "-o", "out"],
    "detect": ["detect", "sweep.igs.mha", "--lines", "needle.toml", "-o", "out.csv", "--sheet", "out.png"],
    "export": ["export", "calibration.json", "--to", "itk", "-o", "out.tfm"],
    "convert": ["convert", "sweep.igs.mha", "-o", "out.nrrd"],
    "convert to two files": ["convert", "sweep.igs.mha", "-o", "out.mkv"],
    "simulate": ["simulate", "-o", "out", "--frames", "2"],
    "sample": ["sample", "-o", "out"],
    "demo": ["demo", "-o", "out", "--needles", "10"],
}
# Onto what it reads, by any name of it.
ONTO_INPUT = {
    "detect": ["detect", "sweep.igs.mha", "--lines", "needle.toml", "-o", "sweep.igs.mha"],
    "detect, the sheet": ["detect", "sweep.igs.mha", "--lines", "needle.toml", "--sheet", "./needle.toml"],
    "export": ["export", "calibration.json", "--to", "json", "-o", "link.json"],
    "export into": [
        "export",
        "calibration.json",
        "--to",
        "plus",
        "--into",
        "needle.toml",
        "-o",
        "needle.toml",
    ],
    "tool": ["tool", "sweep.igs.mha", "-o", "sweep.igs.mha"],
    "convert": ["convert", "sweep.igs.mha", "-o", "./sweep.igs.mha"],
    "calibrate": ["calibrate", "observations.csv", "--lines", "needle.toml", "-o", "."],
    "calibrate, among its images": ["calibrate", "images", "--lines", "needle.toml", "-o", "images"],
}


def run(*arguments):
    return CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    write_sweep(simulate_sweep(curvilinear(), BATH, SweepOptions(frames=24, hidden_share=0, seed=3)), folder)
    rows = simulate_observations(2, 30, seed=1).observations
    sc.write_observations(rows, folder / "table.csv")
    shutil.copy(folder / "sweep.igs.mha", folder / "observations.csv")
    (folder / "images").mkdir()
    sc.calibrate(rows).save(folder / "calibration.json")
    (folder / "link.json").symlink_to(folder / "calibration.json")
    return folder


@pytest.fixture
def here(made, tmp_path, monkeypatch):
    shutil.copytree(made, tmp_path / "here", symlinks=True)
    (tmp_path / "here" / "link.json").unlink()
    (tmp_path / "here" / "link.json").symlink_to(tmp_path / "here" / "calibration.json")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


def contents(folder):
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.usefixtures("few_images")
@pytest.mark.parametrize("command", COMMANDS)
def test_a_second_run_touches_nothing_unless_told(here, command):
    assert run(*COMMANDS[command]).exit_code == 0
    before = contents(here)
    again = run(*COMMANDS[command])
    assert again.exit_code == 1
    assert "is there already; choose another place with -o, or replace it with --overwrite" in again.output
    assert contents(here) == before
    assert run(*COMMANDS[command], "--overwrite").exit_code == 0
    assert contents(here).keys() == before.keys()


@pytest.mark.parametrize("told", [[], ["--overwrite"]])
@pytest.mark.parametrize("command", ONTO_INPUT)
def test_no_command_writes_onto_what_it_reads(here, command, told):
    before = contents(here)
    refused = run(*ONTO_INPUT[command], *told)
    assert refused.exit_code == 1, refused.output
    assert "that this command reads" in refused.output or "is what this command reads" in refused.output
    assert contents(here) == before


def test_a_page_of_an_earlier_run_stands_beside_no_other_calibration(here):
    assert run(*COMMANDS["calibrate"]).exit_code == 0
    assert (here / "out" / "report.html").exists()
    (here / "out" / "calibration.json").unlink()
    refused = run(*COMMANDS["calibrate"], "--no-report")
    assert (refused.exit_code, "report.html: is there already" in refused.output) == (1, True)
    assert run(*COMMANDS["calibrate"], "--no-report", "--overwrite").exit_code == 0
    assert sorted(path.name for path in (here / "out").iterdir()) == ["calibration.json"]


def test_what_somebody_else_made_stays(here):
    (here / "out").mkdir()
    theirs = {
        "contact-sheet.png": b"\x89PNG another program",
        "observations.csv": b"mine",
        "note.txt": b"note",
    }
    for name, content in theirs.items():
        (here / "out" / name).write_bytes(content)
    assert run(*COMMANDS["calibrate"], "--overwrite").exit_code == 0
    assert {name: (here / "out" / name).read_bytes() for name in theirs} == theirs


def test_a_validation_stands_beside_its_own_calibration_and_no_other(here):
    assert run(*COMMANDS["calibrate"]).exit_code == 0
    page = here / "out" / "report.html"
    before = page.read_bytes()
    assert run("validate", "out/calibration.json", "table.csv").exit_code == 0
    assert page.read_bytes() == before
    again = run("validate", "out/calibration.json", "table.csv")
    assert (again.exit_code, "validation.html: is there already" in again.output) == (1, True)
    assert run("validate", "out/calibration.json", "table.csv", "--overwrite").exit_code == 0
    (here / "other").mkdir()
    sc.calibrate(simulate_observations(2, 30, seed=2).observations).save(here / "other" / "calibration.json")
    beside = run("validate", "out/calibration.json", "table.csv", "-o", "other", "--overwrite")
    assert (beside.exit_code, "holds another calibration" in beside.output) == (1, True)
    stale = run(*COMMANDS["calibrate"])
    assert "is there already" in stale.output
    assert run(*COMMANDS["calibrate"], "--overwrite").exit_code == 0
    assert not (here / "out" / "validation.html").exists()


def test_what_is_not_to_be_used_is_exported_only_by_force(here):
    sc.calibrate(slipped_rows()).save(here / "slipped.json")
    for form, name in (("plus", "a.xml"), ("itk", "a.tfm"), ("slicer", "b.tfm"), ("json", "b.json")):
        command = ("export", "slipped.json", "--to", form, "-o", name)
        refused = run(*command)
        assert refused.exit_code == 1
        assert "marker-slipped" in refused.output
        assert not (here / name).exists()
        assert run(*command, "--force").exit_code == 0
        assert (here / name).exists()


def test_a_demonstration_takes_the_next_folder(here):
    names = []
    for _ in range(3):
        before = {path.name for path in here.iterdir()}
        assert run("demo", "--no-report", "--needles", "10").exit_code == 0
        names += {path.name for path in here.iterdir()} - before
    assert names == ["sonocal-demo", "sonocal-demo-2", "sonocal-demo-3"]


def test_a_refused_recording_leaves_an_earlier_calibration_as_it_was(here):
    assert run(*COMMANDS["calibrate a recording"]).exit_code == 0
    before = contents(here / "out")
    (here / "needle.toml").write_text(
        '[[line]]\nname = "needle"\nframe = "Needle"\nfrom_mm = [900.0, 0.0, 0.0]\nto_mm = [900.0, 900.0, 0.0]\n'
    )
    refused = run(*COMMANDS["calibrate a recording"], "--overwrite")
    assert refused.exit_code == 1
    assert contents(here / "out").keys() - before.keys() == {here / "out" / "refused-contact-sheet.png"}
    assert {path: content for path, content in contents(here / "out").items() if path in before} == before


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no pipes with a name")
@pytest.mark.parametrize("told", [(), ("--overwrite",)])
def test_a_pipe_is_no_place_for_a_result(here, told):
    os.mkfifo(here / "pipe.xml")
    refused = run("export", "calibration.json", "--to", "plus", "-o", "pipe.xml", *told)
    assert (refused.exit_code, "is a pipe or a device" in refused.output) == (1, True)
    assert (here / "pipe.xml").is_fifo()


def test_pictures_say_what_made_them(tmp_path):
    import numpy as np

    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    (tmp_path / "a.png").write_bytes(png(np.arange(12, dtype=np.uint8).reshape(3, 4)))
    with pillow.open(tmp_path / "a.png") as picture:
        assert picture.info == {"Software": "sonocal"}
        np.testing.assert_array_equal(np.asarray(picture), np.arange(12).reshape(3, 4))
