"""Targets whose place nobody knows, on the command line: what is read, printed, written and refused."""

import json

import numpy as np
import pytest
from benchmarks.simulators.places import Noise, image_points, sweep
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from tests.builders.tank import unplaced_table

THREAD = '[[line]]\nname = "thread"\nframe = "Tracker"\nplace = "unknown"\n'


def run(*arguments):
    return CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def tank(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tank")
    scene = sweep("line", 60, 5, Noise())
    sc.write_observations(unplaced_table(scene, image_size_px=(501, 501)), folder / "tank.csv")
    (folder / "thread.toml").write_text(THREAD)
    return folder, scene


def test_a_table_of_poses_is_calibrated_and_its_thread_told(tank, tmp_path):
    folder, scene = tank
    out = tmp_path / "out"
    result = run("calibrate", folder / "tank.csv", "--targets", folder / "thread.toml", "-o", out)
    assert result.exit_code == 0, result.output
    said = " ".join(result.stdout.split())
    assert "Line 'thread' is at (" in said
    assert "mm in the frame Tracker" in said
    found = sc.load(out / "calibration.json")
    there = image_points() @ scene.truth[:3, :3].T + scene.truth[:3, 3]
    assert np.linalg.norm(found.probe_from_image @ image_points() - there, axis=1).max() < 1.5
    target = found.targets["thread"]
    away = scene.place - target.middle_mm
    assert np.linalg.norm(np.cross(away, target.direction), axis=1).max() < 2
    page = (out / "report.html").read_text()
    assert "thread" in page
    assert "in the frame Tracker" in page
    # What it wrote is a table like any other: with its lines in it.
    rows = sc.read_observations(out / "observations.csv")
    assert rows.lines_only
    assert found.provenance["input"] == "observations.csv"
    assert found.provenance["recorded"]["table"]["input"] == "tank.csv"
    for command in (
        ("validate", out / "calibration.json", out / "observations.csv"),
        ("info", out / "calibration.json"),
    ):
        done = run(*command)
        assert done.exit_code == 0, done.output


def test_the_same_in_json(tank, tmp_path):
    folder, _ = tank
    arguments = ("--targets", folder / "thread.toml", "-o", tmp_path / "out", "--no-report", "--json")
    result = run("calibrate", folder / "tank.csv", *arguments)
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["targets"]["thread"]["kind"] == "line"
    assert len(told["targets"]["thread"]["covariance"]) == 4


def test_what_is_missing_is_refused_in_a_sentence_and_nothing_is_written(tank, tmp_path):
    folder, _ = tank
    still = tmp_path / "still.csv"
    sc.write_observations(unplaced_table(sweep("line", 60, 5, Noise(), motion="translation")), still)
    placed = tmp_path / "placed.csv"
    random = np.random.default_rng(0)
    sc.write_observations(sc.Observations(random.random((9, 2)), random.random((9, 2, 3))), placed)
    known = tmp_path / "known.toml"
    known.write_text(THREAD.replace("thread", "wire"))
    for source, targets, said in [
        (folder / "tank.csv", None, "target 'thread' is given by its pose alone; say in a file of targets"),
        (folder / "tank.csv", known, "target 'thread' is none of the targets wire"),
        (
            still,
            folder / "thread.toml",
            "still.csv: the target's place is not known, and the probe hardly turned",
        ),
        (
            placed,
            folder / "thread.toml",
            "placed.csv: is a table of sightings, which has its lines in it; leave out",
        ),
        (folder / "tank.csv", folder / "tank.csv", "tank.csv"),
    ]:
        more = () if targets is None else ("--targets", targets)
        result = run("calibrate", source, *more, "-o", tmp_path / "none")
        assert result.exit_code == 1, result.output
        assert said in " ".join(result.stderr.split())
        assert not (tmp_path / "none").exists()


def test_info_shows_the_targets_and_the_table(tank):
    folder, _ = tank
    targets, table = run("info", folder / "thread.toml"), run("info", folder / "tank.csv")
    assert targets.exit_code == 0, targets.output
    assert table.exit_code == 0, table.output
    assert "unknown" in targets.stdout
    assert "thread" in targets.stdout


def test_other_commands_say_that_the_place_is_missing(tank, tmp_path):
    folder, _ = tank
    out = tmp_path / "out"
    assert (
        run("calibrate", folder / "tank.csv", "--targets", folder / "thread.toml", "-o", out).exit_code == 0
    )
    result = run("validate", out / "calibration.json", folder / "tank.csv")
    assert result.exit_code == 1
    assert "says nothing of where its target 'thread' is" in " ".join(result.stderr.split())
