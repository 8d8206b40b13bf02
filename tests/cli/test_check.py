"""``sonocal check``: the verdict on the screen, the log beside the calibration."""

import json

import numpy as np
import pytest
from benchmarks.simulators.checks import first_day, knock, later
from benchmarks.simulators.trust_judge import image_size, table
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.observations import write_observations


@pytest.fixture(scope="module")
def made():
    scan = first_day(3)
    rows = [
        table(later(3, motion @ scan.truth)) for motion in (np.eye(4), knock(np.random.default_rng(5), 3.0))
    ]
    return sc.calibrate(table(scan), image_size_px=image_size(scan)), rows


@pytest.fixture
def folder(made, tmp_path, monkeypatch):
    calibration, rows = made
    calibration.save(tmp_path / "calibration.json")
    for name, one in zip(("sound.csv", "knocked.csv"), rows, strict=True):
        write_observations(one, tmp_path / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments):
    return CliRunner(env={"COLUMNS": "100", "TERM": "dumb"}).invoke(main, [*arguments])


def test_every_check_is_logged_and_drawn(folder):
    first = run("check", "calibration.json", "sound.csv")
    assert first.exit_code == 0, first.output
    before = (folder / "calibration.checks.jsonl").read_bytes()
    second = run("check", "calibration.json", "knocked.csv", "--json")
    assert second.exit_code == 0, second.output
    assert json.loads(second.stdout)["verdict"] == "changed"
    after = (folder / "calibration.checks.jsonl").read_bytes()
    assert after.startswith(before)
    assert after.count(b"\n") == 2
    assert b"<svg" in (folder / "calibration.checks.html").read_bytes()
    shown = run("info", "calibration.checks.jsonl")
    assert shown.exit_code == 0, shown.output
    assert "changed" in shown.output


def test_nothing_but_a_log_is_added_to(folder):
    before = (folder / "sound.csv").read_bytes()
    for log in ("sound.csv", "calibration.json", "knocked.csv"):
        done = run("check", "calibration.json", "sound.csv", "--log", log)
        assert done.exit_code == 1, done.output
    assert (folder / "sound.csv").read_bytes() == before
    assert run("check", "calibration.json", "sound.csv", "--no-log").exit_code == 0
    assert not (folder / "calibration.checks.jsonl").exists()
    assert run("check", "calibration.json", "sound.csv", "--no-log", "--log", "a").exit_code == 2


def test_a_page_of_somebody_else_is_left(folder):
    (folder / "calibration.checks.html").write_text("<html>mine</html>")
    done = run("check", "calibration.json", "sound.csv")
    assert done.exit_code == 1
    assert "--no-report" in done.output
    assert (folder / "calibration.checks.html").read_text() == "<html>mine</html>"
    assert (folder / "calibration.checks.jsonl").exists()
