"""The command line, in process and as a real one."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.formats import FORMATS
from sonocal.cli.main import main
from sonocal.simulation.scene import simulate_observations


def run(*arguments, width=80):
    return CliRunner(env={"COLUMNS": str(width), "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "needle.csv"
    sc.write_observations(simulate_observations(2, 30, seed=5).observations, path)
    return path


@pytest.fixture
def calibrated(table, tmp_path):
    result = run("calibrate", table, "-o", tmp_path / "out")
    assert result.exit_code == 0, result.output
    return tmp_path / "out" / "calibration.json"


def test_calibrate_writes_what_python_computes(table, calibrated):
    expected = sc.calibrate(sc.read_observations(table))
    np.testing.assert_array_equal(
        sc.load(calibrated).probe_from_image.matrix, expected.probe_from_image.matrix
    )
    provenance = json.loads(calibrated.read_text())["provenance"]
    assert provenance["input"] == "needle.csv"
    assert len(provenance["sha256"]) == 64
    assert provenance["options"]["threshold_mm"] == 5.0
    assert provenance["versions"]["sonocal"] == sc.__version__


@pytest.mark.parametrize("width", [80, 200])
def test_tables_fit_the_terminal_and_say_what_to_trust_first(table, tmp_path, width):
    result = run("calibrate", table, "-o", tmp_path / "out", width=width)
    lines = result.output.splitlines()
    assert max(len(line) for line in lines if not line.startswith("Wrote")) <= width
    assert lines[0].startswith("Use it. Expect errors of the calibration up to ")
    for words in ("fitted rows", "corner", "probe_from_image (PLUS: ImageToProbe)", "mm/px", "Wrote"):
        assert words in result.output
    assert "…" not in result.output


def test_warnings_come_first(tmp_path):
    rows = simulate_observations(2, 30, outlier_share=0.4, seed=5).observations
    sc.write_observations(rows, tmp_path / "a.csv")
    result = run("calibrate", tmp_path / "a.csv", "-o", tmp_path / "out")
    assert result.output.startswith("warning many-outliers\n  11 of 30 rows are further than 5 mm")
    assert "Use it with care. " in result.output


def test_json_is_the_calibration_and_its_verdict_on_stdout_and_nothing_else(table, tmp_path):
    result = run("calibrate", table, "-o", tmp_path / "out", "--json")
    printed = json.loads(result.stdout)
    assert list(printed.pop("verdict")) == ["level", "headline", "expectation", "reasons", "codes"]
    assert len(printed.pop("cannot_show")) == 4
    assert printed.pop("rereadings") == []
    assert printed == json.loads((tmp_path / "out" / "calibration.json").read_text())


def test_plus_export_holds_the_calibration(calibrated, tmp_path):
    result = run("export", calibrated, "--to", "plus", "-o", tmp_path / "plus.xml")
    assert result.exit_code == 0
    transform = ElementTree.parse(tmp_path / "plus.xml").find(".//Transform[@From='Image'][@To='Probe']")
    matrix = np.array([float(x) for x in transform.get("Matrix").split()]).reshape(4, 4)
    np.testing.assert_array_equal(matrix, sc.load(calibrated).probe_from_image.matrix)


def test_json_export_is_a_calibration_again(calibrated, tmp_path):
    run("export", calibrated, "--to", "json", "-o", tmp_path / "again.json")
    np.testing.assert_array_equal(
        sc.load(tmp_path / "again.json").probe_from_image.matrix, sc.load(calibrated).probe_from_image.matrix
    )


@pytest.mark.parametrize("form", ["itk", "slicer"])
@pytest.mark.parametrize("suffix", [".tfm", ".h5"])
def test_transforms_are_exported_for_itk_and_slicer(calibrated, tmp_path, form, suffix):
    sitk = pytest.importorskip("SimpleITK", reason="SimpleITK, the oracle of ITK's files, is not installed")
    path = tmp_path / f"a{suffix}"
    assert run("export", calibrated, "--to", form, "-o", path).exit_code == 0
    points = np.random.default_rng(0).uniform(0, 500, (1000, 3))
    theirs = sitk.ReadTransform(path)
    mm = sc.load(calibrated).probe_from_image.apply(points)
    ras_from_lps = [-1, -1, 1]
    source, expected = (points, mm) if form == "itk" else (mm * ras_from_lps, points * ras_from_lps)
    mapped = np.array([theirs.TransformPoint(p) for p in source.tolist()])
    np.testing.assert_allclose(mapped, expected, rtol=0, atol=1e-9 if form == "itk" else 1e-8)
    refused = run("export", calibrated, "--to", form, "-o", tmp_path / "a.txt")
    assert refused.exit_code == 1
    assert refused.stderr.endswith(
        "a.txt: transforms are written as .tfm or .h5; choose one of these names\n"
    )


def test_the_matrix_is_put_into_a_device_set(calibrated, tmp_path):
    devices = tmp_path / "devices.xml"
    devices.write_text("<PlusConfiguration>\n  <CoordinateDefinitions/>\n  <fCal />\n</PlusConfiguration>\n")
    done = run(
        "export",
        calibrated,
        "--to",
        "plus",
        "--into",
        devices,
        "-o",
        tmp_path / "new.xml",
        "--probe",
        "L14",
    )
    assert done.exit_code == 0, done.output
    text = (tmp_path / "new.xml").read_text()
    assert text.startswith("<PlusConfiguration>\n  <CoordinateDefinitions>\n    <!-- ImageToL14 maps pixels")
    assert text.endswith("\n  </CoordinateDefinitions>\n  <fCal />\n</PlusConfiguration>\n")
    assert run("export", calibrated, "--to", "itk", "--into", devices, "-o", "a.tfm").exit_code == 2


def test_every_export_states_its_conventions(calibrated, tmp_path):
    for form, name in (("plus", "a.xml"), ("itk", "a.tfm"), ("slicer", "b.tfm"), ("json", "a.json")):
        run("export", calibrated, "--to", form, "-o", tmp_path / name)
        text = (tmp_path / name).read_text()
        assert "centre of the" in text, form
        assert "mm per px" in text, form


def test_info_shows_a_table_and_a_calibration(table, calibrated):
    shown = run("info", table)
    assert shown.exit_code == 0
    assert "needle.csv: sightings for a 2D probe" in shown.output
    shown = run("info", calibrated)
    assert shown.exit_code == 0
    assert "probe_from_image" in shown.output


@pytest.mark.parametrize("dimension", ["2", "3"])
def test_demo_shows_the_error_against_the_truth(tmp_path, dimension):
    result = run("demo", "-o", tmp_path / "demo", "--dimension", dimension)
    assert result.exit_code == 0, result.output
    assert "Error against the known truth" in result.output
    again = run("calibrate", tmp_path / "demo" / "observations.csv", "-o", tmp_path / "again", "--image-size",
                "500x500" if dimension == "2" else "500x500x500")  # fmt: skip
    assert again.exit_code == 0
    np.testing.assert_array_equal(
        sc.load(tmp_path / "again" / "calibration.json").probe_from_image.matrix,
        sc.load(tmp_path / "demo" / "calibration.json").probe_from_image.matrix,
    )


def test_demo_writes_and_names_the_report_and_opens_it_only_for_somebody(tmp_path, monkeypatch):
    opened = []
    monkeypatch.setattr("click.launch", opened.append)
    report = tmp_path / "demo" / "report.html"
    shown = run("demo", "-o", tmp_path / "demo")
    assert f"Report: {report.as_uri()}\n" in shown.output
    assert "Use it" in report.read_text(encoding="utf-8")
    assert opened == []
    monkeypatch.setattr("sonocal.cli.screen.terminal.somebody_looks", lambda: True)
    run("demo", "-o", tmp_path / "demo", "--overwrite")
    assert opened == [str(report)]
    without = run("demo", "-o", tmp_path / "without", "--no-report")
    assert without.exit_code == 0
    assert sorted(path.name for path in (tmp_path / "without").iterdir()) == [
        "calibration.json",
        "observations.csv",
    ]
    assert len(opened) == 1


def test_the_table_of_the_demo_is_known_as_the_calibrations_own(tmp_path):
    run("demo", "-o", tmp_path, "--no-report")
    shown = run("validate", tmp_path / "calibration.json", tmp_path / "observations.csv", "--no-report")
    assert "Leave one frame out" in shown.output
    assert "Held-out rows" not in shown.output


def test_a_known_failure_is_one_sentence_exit_1_and_writes_nothing(tmp_path):
    (tmp_path / "bad.csv").write_text("frame,target\n0,a\n")
    result = run("calibrate", tmp_path / "bad.csv", "-o", tmp_path / "out")
    assert result.exit_code == 1
    assert result.stdout == ""
    assert result.stderr.startswith("Error: bad.csv, line 1: lacks the columns u_px, v_px, ")
    assert result.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        (["calibrate", "nowhere.csv"], 1, "Error: nowhere.csv: there is no such file"),
        (["calibrate", "."], 1, "Error: .: is a directory"),
        (["calibrate", "a.csv", "--treshold-mm", "3"], 2, "No such option"),
        (["calibrate", "a.csv", "--image-size", "big"], 2, "'big' is not a size such as 640x480"),
        (
            ["export", "a.json", "--to", "stl", "-o", "b"],
            2,
            "'stl' is not one of 'plus', 'itk', 'slicer', 'json'",
        ),
        (["info", "nowhere"], 1, "Error: nowhere: there is no such file"),
    ],
)
def test_failures_and_wrong_usage_have_their_own_status(arguments, status, words):
    result = run(*arguments)
    assert result.exit_code == status
    assert words in result.stderr


def test_output_that_cannot_be_written_is_said(table, tmp_path):
    (tmp_path / "file").write_text("in the way")
    result = run("calibrate", table, "-o", tmp_path / "file")
    assert result.exit_code == 1
    assert (
        result.stderr
        == f"Error: {tmp_path / 'file'}: cannot be made a folder ({os.strerror(errno.EEXIST)}); choose another place\n"
    )
    assert (tmp_path / "file").read_text() == "in the way"


def test_info_of_something_else_says_what_it_reads(tmp_path):
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\0")
    result = run("info", tmp_path / "picture.png")
    assert result.exit_code == 1
    assert result.stderr == "Error: picture.png: is not an image that can be read (unknown kind)\n"
    (tmp_path / "song.bin").write_bytes(b"la la\0la")
    result = run("info", tmp_path / "song.bin")
    assert result.exit_code == 1
    assert result.stderr.startswith(
        "Error: song.bin: is binary data in no format that sonocal reads; it reads targets (.toml), device "
    )
    assert result.stderr.count("\n") == 1
    for one in (
        one for one in FORMATS if one.kind not in {"page", "checks"}
    ):  # which nobody looks for data in
        # Logs of trackers are known by themselves: their names are enough.
        words = (one.name,) if one.kind == "recording" else (one.header, one.name)
        assert all(word in result.stderr for word in (words if one.header else one.suffixes))


def test_a_real_process_calibrates_and_refuses(table, tmp_path):
    environment = os.environ | {"COLUMNS": "80"}

    def process(*arguments):
        command = [sys.executable, "-m", "sonocal", *map(str, arguments)]
        return subprocess.run(
            command, capture_output=True, text=True, cwd=tmp_path, env=environment, check=False
        )

    done = process("calibrate", table)
    assert (done.returncode, done.stderr) == (0, "")
    assert "Wrote calibration/calibration.json" in done.stdout
    assert (tmp_path / "calibration" / "calibration.json").exists()
    refused = process("calibrate", "no.csv")
    assert (refused.returncode, refused.stdout) == (1, "")
    assert refused.stderr == "Error: no.csv: there is no such file; check the name and the folder\n"
    assert process("--version").stdout == f"sonocal, version {sc.__version__}\n"


@pytest.mark.parametrize("command", ["", *main.commands])
def test_help_fits_the_terminal_and_keeps_its_lines(command):
    shown = run(*filter(None, [command]), "--help")
    assert shown.exit_code == 0
    assert "\\b" not in shown.output
    assert max(map(len, shown.output.splitlines())) <= 80


def test_a_bug_keeps_its_traceback(monkeypatch, table):
    def broken(*_, **__):
        raise RuntimeError("a bug")

    monkeypatch.setattr(sc, "calibrate", broken)
    assert isinstance(run("calibrate", table).exception, RuntimeError)


def test_letters_that_a_code_page_lacks_are_written_as_their_numbers(table, tmp_path):
    (tmp_path / "Ж.csv").write_bytes(Path(table).read_bytes())
    done = subprocess.run(
        [sys.executable, "-m", "sonocal", "info", "Ж.csv"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONIOENCODING": "cp1252"},
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"\\u0416.csv" in done.stdout
