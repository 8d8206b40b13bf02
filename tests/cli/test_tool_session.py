"""``sonocal tool --session``: a long recording read without cutting it."""

import json

import numpy as np
import pytest
from benchmarks.simulators.tool_sessions import TIPS, session
from benchmarks.tool_sessions import recording
from click.testing import CliRunner

from sonocal.cli.main import main
from sonocal.recording.formats import write_recording
from sonocal.targets import read_points_toml


@pytest.fixture
def folder(tmp_path, monkeypatch):
    write_recording(recording(session(3)), tmp_path / "session.igs.mha")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*arguments):
    return CliRunner(env={"COLUMNS": "100", "TERM": "dumb"}).invoke(main, ["tool", *arguments])


def test_tips_and_needle_are_written_and_a_time_line_is_shown(folder):
    done = run("session.igs.mha", "--session", "--page", "session.html", "-o", "found.toml")
    assert done.exit_code == 0, done.output
    assert "P pivot, S spin, T touch" in done.output
    assert b"<svg" in (folder / "session.html").read_bytes()
    tips = {point.frame: point.place_mm for point in read_points_toml(folder / "found.toml")}
    for tool in ("Stylus", "Needle"):
        assert np.linalg.norm(tips[tool] - TIPS[tool]) < 1.0
    again = run("session.igs.mha", "--session", "--json")
    assert {one["kind"] for one in json.loads(again.stdout)["stretches"]} == {
        "pivot",
        "spin",
        "touch",
        "still",
    }


def test_options_of_one_tool_and_of_sessions_do_not_mix(folder):
    assert run("session.igs.mha", "--session", "--tool", "Stylus").exit_code == 2
    assert run("session.igs.mha", "--page", "a.html").exit_code == 2
