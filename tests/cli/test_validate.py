"""sonocal validate, and the report that it and sonocal calibrate write."""

import dataclasses
import json
import sys

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.simulation.scene import simulate_observations


def run(*arguments):
    return CliRunner(env={"COLUMNS": "80", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture
def folder(tmp_path):
    rows = simulate_observations(2, 60, seed=5).observations
    rows = dataclasses.replace(rows, split=np.where(np.arange(60) < 40, "fit", "test"))
    sc.write_observations(rows, tmp_path / "needle.csv")
    result = run(
        "calibrate",
        tmp_path / "needle.csv",
        "-o",
        tmp_path,
        "--fit-split",
        "fit",
        "--test-split",
        "test",
        "--no-report",
    )
    assert result.exit_code == 0, result.output
    assert not (tmp_path / "report.html").exists()
    return tmp_path


def test_calibrate_writes_the_report_beside_the_calibration(folder):
    result = run("calibrate", folder / "needle.csv", "-o", folder / "out")
    assert result.exit_code == 0, result.output
    assert "Wrote" in result.output
    assert (folder / "out" / "report.html").read_text().startswith("<!doctype html>")


def test_held_out_rows_have_a_say_in_the_report_of_calibrate(folder):
    rows = sc.read_observations(folder / "needle.csv")
    moved = rows.segments_mm + np.where(rows.split == "test", 4.0, 0.0)[:, None, None]
    sc.write_observations(dataclasses.replace(rows, segments_mm=moved), folder / "moved.csv")
    done = run(
        "calibrate", folder / "moved.csv", "-o", folder / "out", "--fit-split", "fit", "--test-split", "test"
    )
    assert done.exit_code == 0, done.output
    page = (folder / "out" / "report.html").read_text(encoding="utf-8")
    assert "<strong>Use it with care</strong>" in page
    assert "Held-out rows are off by" in page


def test_validate_without_a_report_writes_nothing(folder):
    before = sorted(folder.iterdir())
    done = run("validate", folder / "calibration.json", folder / "needle.csv", "--no-report")
    assert done.exit_code == 0, done.output
    assert sorted(folder.iterdir()) == before
    assert "Wrote" not in done.output


def test_validate_prints_the_verdict_and_numbers_and_writes_the_report(folder):
    result = run("validate", folder / "calibration.json", folder / "needle.csv")
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert lines[0].startswith("Use it. Expect errors of the calibration up to ")
    assert max(len(line) for line in lines if not line.startswith("Wrote")) <= 80
    for words in (
        "Held-out rows",
        "Leave one frame out",
        "Repeatability, corners",
        "95 % interval",
        "What they are:",
    ):
        assert words in result.output
    assert "Held-out rows" in (folder / "validation.html").read_text()


def test_json_has_every_number_with_its_interval(folder):
    result = run("validate", folder / "calibration.json", folder / "needle.csv", "--json", "--no-report")
    numbers = {q["code"]: q for q in json.loads(result.stdout)["quantities"]}
    assert set(numbers) == {
        "held-out",
        "leave-one-frame-out",
        "repeatability-corners",
        "repeatability-centre",
    }
    assert all(q["low_mm"] < q["value_mm"] < q["high_mm"] and q["definition"] for q in numbers.values())
    assert not (folder / "report.html").exists()


def test_another_calibration_is_compared(folder):
    run("calibrate", folder / "needle.csv", "-o", folder / "b", "--fit-split", "test", "--no-report")
    arguments = (
        "validate",
        folder / "calibration.json",
        folder / "needle.csv",
        "--compare",
        folder / "b" / "calibration.json",
    )
    result = run(*arguments, "--no-report")
    assert "They differ by up to " in result.output
    assert json.loads(run(*arguments, "--json", "--no-report").stdout)["comparison"]["shared_input"] is False


def test_a_cross_wire_table_is_known_by_its_columns(folder):
    cal = sc.load(folder / "calibration.json")
    pixels = np.random.default_rng(0).uniform(0, 500, (12, 2))
    places = cal.probe_from_image @ pixels + np.array([0.0, 3.0, 4.0])
    table = "\n".join(",".join(map(repr, map(float, row))) for row in np.column_stack([pixels, places]))
    (folder / "wire.csv").write_text("u_px,v_px,x_mm,y_mm,z_mm\n" + table + "\n")
    result = run("validate", folder / "calibration.json", folder / "wire.csv")
    assert result.exit_code == 0, result.output
    assert "PRA, cross-wire" in result.output
    assert " 5.000 " in result.output


def test_the_scanners_scale_is_compared(folder):
    result = run(
        "calibrate", folder / "needle.csv", "-o", folder / "c", "--scanner-mm-per-px", "0.3", "--no-report"
    )
    assert "warning scale-differs-from-scanner" in result.output
    codes = [d.code for d in sc.load(folder / "c" / "calibration.json").warnings]
    assert codes == ["scale-differs-from-scanner"]


def test_without_the_libraries_of_the_report_the_calibration_is_still_written(folder, monkeypatch):
    monkeypatch.setitem(sys.modules, "jinja2", None)
    result = run("calibrate", folder / "needle.csv", "-o", folder / "d")
    assert result.exit_code == 0
    assert result.stderr.startswith("Note: the report needs jinja2, which is not installed; pip install")
    assert [path.name for path in (folder / "d").iterdir()] == ["calibration.json"]


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["validate", "no.json", "no.csv"], 1, "Error: no.json: there is no such file"),
        (
            ["validate", "a.json", "b.csv", "--nwire", "left,right"],
            2,
            "is not three targets such as left,middle,right",
        ),
        (["validate", "a.json"], 2, "Missing argument 'INPUT'"),
    ],
)
def test_failures_and_wrong_usage_have_their_own_status(arguments, status, words):
    result = run(*arguments)
    assert result.exit_code == status
    assert words in result.stderr


def test_two_numbers_of_the_scanner_are_one_along_each_axis(folder):
    command = (
        "calibrate",
        folder / "needle.csv",
        "-o",
        folder / "c",
        "--no-report",
        "--model",
        "anisotropic",
    )
    assert run(*command, "--scanner-mm-per-px", "0.24,0.25").exit_code == 0
    assert sc.load(folder / "c" / "calibration.json").options.scanner_mm_per_px == (0.24, 0.25)
    for odd in ("0.24,", "0", "0.1,0.2,0.3", "-1", "nan"):
        done = run(*command, "--overwrite", f"--scanner-mm-per-px={odd}")
        assert (done.exit_code, "such as 0.24, or two such as 0.24,0.25" in done.output) == (2, True)


def test_a_refused_argument_goes_by_the_name_of_its_option(folder):
    for option, sentence in {
        "--sigma-mm=-1": "--sigma-mm must be a positive number; got -1.0",
        "--tolerance-mm=0": "--tolerance-mm must be a positive number; got 0.0",
        "--test-split=fit": "--fit-split and --test-split are both 'fit'; held-out rows must not be fitted",
    }.items():
        done = run("calibrate", folder / "needle.csv", "-o", folder / "c", "--fit-split", "fit", option)
        assert done.output == f"Error: {sentence}\n"


def test_validate_prints_warnings_before_its_tables(folder):
    cal = sc.load(folder / "calibration.json")
    pixels = np.random.default_rng(0).uniform(0, 500, (12, 2))
    table = np.column_stack([pixels, cal.probe_from_image @ pixels + [0.0, 3.0, 4.0]])
    np.savetxt(folder / "wire.csv", table, delimiter=",", header="u_px,v_px,x_mm,y_mm,z_mm", comments="")
    said = run("validate", folder / "calibration.json", folder / "wire.csv", "--no-report").output
    assert (
        said.index("warning points-")
        < said.index("What was measured contradicts")
        < said.index("PRA, cross-wire  ")
    )
