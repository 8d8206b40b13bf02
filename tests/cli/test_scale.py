"""A known scale on the command line: of tables and of recordings; what is printed, written and refused."""

import json

import numpy as np
import pytest
from benchmarks.models import SCANS
from benchmarks.simulators.scans import SCALE
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear


def run(*arguments):
    return CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module", params=[2, 3])
def rows_path(tmp_path_factory, request):
    path = tmp_path_factory.mktemp("scale") / "needle.csv"
    sc.write_observations(SCANS["moved"](1, request.param)[0], path)
    return path


def test_a_known_scale_is_kept_told_and_reported(rows_path, tmp_path):
    result = run("calibrate", rows_path, "--scale", SCALE, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    said = " ".join(result.stdout.split())
    assert "The rows agree with the scale given: 0.2" in said
    assert f"{SCALE:.5f} mm/px, as given" in said
    assert "One scale or " in said
    kept = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert (kept["model"], kept["scale_mm_per_px"]) == ("rigid", [SCALE])
    assert np.shape(kept["covariance"]) == (6, 6)
    assert [one["narrower"] for one in kept["models"]] == ["rigid", "similarity"]
    assert kept["provenance"]["options"]["scale_mm_per_px"] == SCALE
    assert "The rows agree with the scale given" in (tmp_path / "out" / "report.html").read_text()
    assert sc.load(tmp_path / "out" / "calibration.json").probe_from_image.scales[0] == SCALE
    for command in (("validate",), ("export", "--to", "itk", "-o", tmp_path / "out.tfm")):
        calibration, rows = tmp_path / "out" / "calibration.json", [rows_path] * (command[0] == "validate")
        done = run(command[0], calibration, *rows, *command[1:])
        assert done.exit_code == 0, done.output


def test_a_wrong_scale_is_warned_of_with_both_numbers(rows_path, tmp_path):
    result = run("calibrate", rows_path, "--scale", 0.25, "-o", tmp_path / "out", "--no-report", "--json")
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    (finding,) = (one for one in told["diagnostics"] if one["code"] == "known-scale-disagrees")
    assert "0.25000 were given" in finding["message"]
    assert "they have 0.2" in finding["message"]
    assert told["verdict"]["level"] != "use"


def test_a_recording_takes_a_known_scale(tmp_path):
    options = SweepOptions(frames=80, rate_hz=10, sigma_px=0.5, sigma_mm=0.3, seed=2)
    sweep = simulate_sweep(curvilinear(250, 250, 0.48), BATH, options)
    recording, needle = write_sweep(sweep, tmp_path)[:2]
    folder = tmp_path / "out"
    result = run("calibrate", recording, "--lines", needle, "--scale", 0.48, "--no-report", "-o", folder)
    assert result.exit_code == 0, result.output
    found = sc.load(folder / "calibration.json")
    assert found.model == "rigid"
    assert (found.probe_from_image.scales == 0.48).all()
    assert not found.models[0].contradicts
    result = run(
        "calibrate",
        recording,
        "--lines",
        needle,
        "--scale",
        0.7 * 0.48,
        "--no-report",
        "-o",
        tmp_path / "far",
        "--json",
    )
    told = json.loads(result.stdout)
    assert told["verdict"]["level"] == "stop"
    assert "known-scale-disagrees" in [one["code"] for one in told["diagnostics"]]
    assert "known-scale-unchecked" not in [one["code"] for one in told["diagnostics"]]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--scale", -1), "--scale must be a positive number"),
        (("--scale", 0.24, "--model", "anisotropic"), "leave out one of them"),
    ],
)
def test_what_does_not_go_together_is_said(rows_path, tmp_path, arguments, sentence):
    result = run("calibrate", rows_path, *arguments, "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert sentence in " ".join(result.output.split())
    assert not (tmp_path / "out").exists()
