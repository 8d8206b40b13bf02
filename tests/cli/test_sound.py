"""The speed of sound on the command line: what is asked, what is printed, which map is written."""

import json

import numpy as np
import pytest
from benchmarks.simulators.fans import fan_scan
from benchmarks.simulators.trust_judge import image_size, table
from click.testing import CliRunner

import sonocal as sc
from sonocal import existing
from sonocal.cli.main import main

SOUND = ("--probe-radius-mm", 60, "--sound-speed")


def run(*arguments):
    return CliRunner(env={"COLUMNS": "200", "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def rows_path(tmp_path_factory):
    scan = fan_scan(3, 100, 2, 0.96, still=True)
    path = tmp_path_factory.mktemp("bath") / "bath.csv"
    sc.write_observations(table(scan).with_sound(image_size_px=image_size(scan)), path)
    return path


@pytest.fixture(scope="module")
def calibrated(rows_path):
    folder = rows_path.parent / "given"
    result = run("calibrate", rows_path, *SOUND, 1478.4, "--no-report", "-o", folder)
    assert result.exit_code == 0, result.output
    assert "Sound ran at 1478 m/s as given" in " ".join(result.stdout.split())
    return folder / "calibration.json"


def test_a_speed_is_given_or_estimated(calibrated, rows_path, tmp_path):
    result = run(
        "calibrate", rows_path, *SOUND, "estimate", "--no-report", "--json", "-o", tmp_path / "found"
    )
    assert result.exit_code == 0, result.output
    sound = json.loads(result.stdout)["sound"]
    low, high = sound["by_rows_m_s"]
    assert low < 1478.4 < high
    assert sound["estimated"]
    assert not sc.load(calibrated).sound.estimated
    again = ("--assumed-sound-speed", 1450, "--probe-face-px", "249.5,0")
    other = run("calibrate", rows_path, *SOUND, 1392, *again, "--no-report", "-o", tmp_path / "other")
    assert other.exit_code == 0, other.output
    found = sc.load(tmp_path / "other" / "calibration.json").probe_from_image.matrix
    assert np.allclose(found, sc.load(calibrated).probe_from_image.matrix, atol=1e-9)


def test_exports_say_for_which_images_they_are(calibrated, tmp_path):
    plain = run("export", calibrated, "--to", "plus", "-o", tmp_path / "plain.xml")
    scanned = run("export", calibrated, "--to", "plus", "--as-scanned", "-o", tmp_path / "scanned.xml")
    assert plain.exit_code == scanned.exit_code == 0
    assert "sound runs at 1540 m/s, as the scanner assumes, and not for those of the bath" in " ".join(
        plain.stdout.split()
    )
    assert "off by up to 1.0 mm" in " ".join(scanned.stdout.split())
    found = sc.load(calibrated)
    for name, matrix in {"plain": found.probe_from_image.matrix, "scanned": found.sound.as_scanned}.items():
        written = existing.read_existing(tmp_path / f"{name}.xml").matrix
        assert np.allclose(written, matrix, rtol=1e-9)
        assert "m/s" in (tmp_path / f"{name}.xml").read_text()


def test_a_calibration_that_knows_of_no_other_speed_has_one_map(rows_path, calibrated, tmp_path):
    run("calibrate", rows_path, "--no-report", "-o", tmp_path)
    export = (
        "export",
        tmp_path / "calibration.json",
        "--to",
        "itk",
        "--as-scanned",
        "-o",
        tmp_path / "a.tfm",
    )
    refused = run(*export)
    assert refused.exit_code == 1
    assert "has one map for all images" in refused.stderr
    assert run("export", calibrated, "--to", "json", "--as-scanned", "-o", tmp_path / "b.json").exit_code == 2


def test_validation_takes_rows_of_the_same_bath(calibrated, rows_path):
    result = run("validate", calibrated, rows_path, "--no-report", "--json")
    assert result.exit_code == 0, result.output
    numbers = {one["code"]: one["value_mm"] for one in json.loads(result.stdout)["quantities"]}
    assert numbers["leave-one-frame-out"] < 0.8


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--sound-speed", 1480), 1, "which the anisotropic model finds"),
        (("--probe-radius-mm", 60), 1, "says nothing without sound_speed_m_s"),
        ((*SOUND, "fast"), 2, "neither a number of m/s nor estimate"),
        ((*SOUND, 1480, "--probe-face-px", "12"), 2, "not a place such as"),
    ],
)
def test_what_means_nothing_is_refused(rows_path, tmp_path, options, code, words):
    refused = run("calibrate", rows_path, *options, "--no-report", "-o", tmp_path / "no")
    assert refused.exit_code == code
    assert words in " ".join(refused.stderr.split())
