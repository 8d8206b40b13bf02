"""Each finding is told once, whatever command comes upon it, and a refusal's notes do not repeat its sentence."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.simulation.scene import simulate_observations
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear

# Its code and its message: two tools may each have one of a code.
TOLD = re.compile(r"^(?:warning|note) ([\w-]+)\n  (.+)$", flags=re.MULTILINE)
FEWEST_LETTERS = 60  # of what is a sentence and no cell
SCALE = ("--scanner-mm-per-px", "0.5")
COMMANDS = {
    "sound": ("calibrate", "sound.csv"),
    "outliers": ("calibrate", "outliers.csv", "--test-split", "test", *SCALE),
    "metres": ("calibrate", "metres.csv"),
    "metres, all the same": ("calibrate", "metres.csv", "--accept-units"),
    "a recording": ("calibrate", "sweep.igs.mha", "--lines", "needle.toml"),
    "info": ("info", "made/calibration.json"),
    "info of metres": ("info", "metres.csv"),
    "info of a recording": ("info", "sweep.igs.mha"),
    "validate": ("validate", "made/calibration.json", "outliers.csv", *SCALE),
    "validate on others": ("validate", "made/calibration.json", "sound.csv", *SCALE),
}


def run(*words):
    return CliRunner(env={"COLUMNS": "2000", "TERM": "dumb"}).invoke(main, words)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("once")
    rows = simulate_observations(2, 40, seed=6).observations
    off = rows.points_px + np.where(np.arange(40) < 15, 300, 0)[:, None]
    split = np.where(np.arange(40) % 3 == 0, "test", "fit")
    sc.write_observations(rows, folder / "sound.csv")
    sc.write_observations(replace(rows, split=split, points_px=off), folder / "outliers.csv")
    sc.write_observations(replace(rows, segments_mm=rows.segments_mm / 1000), folder / "metres.csv")
    options = SweepOptions(frames=60, rate_hz=8, sigma_px=0.5, sigma_mm=0.3, dropout_share=0.2, seed=2)
    write_sweep(simulate_sweep(curvilinear(250, 250, 0.48), BATH, options), folder)
    table, made = str(folder / "outliers.csv"), str(folder / "made")
    done = run("calibrate", table, *COMMANDS["outliers"][2:], "-o", made, "--no-report")
    assert done.exit_code == 0, done.output
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_a_finding_is_told_once(files, monkeypatch, tmp_path, command):
    monkeypatch.chdir(files)
    words = COMMANDS[command]
    output = ("-o", str(tmp_path / "out")) if words[0] == "calibrate" else ()
    quiet = ("--no-report",) if words[0] != "info" else ()
    shown = run(*words, *output, *quiet)
    assert shown.exit_code == (1 if command == "metres" else 0), shown.output
    codes = Counter(TOLD.findall(shown.output))
    assert set(codes.values()) <= {1}, codes
    sentences = Counter(
        line.strip() for line in shown.output.splitlines() if len(line.strip()) > FEWEST_LETTERS
    )
    assert set(sentences.values()) <= {1}, sentences.most_common(1)
    if command in ("outliers", "metres, all the same", "validate", "info"):
        assert codes, shown.output
