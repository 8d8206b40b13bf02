"""Matrices of other software on the command line: info, validate, export, --compare, --expected."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.existing import read_existing
from sonocal.export.itk import itk_tfm
from sonocal.export.plus import plus_xml
from sonocal.export.slicer import slicer_tfm
from sonocal.simulation.scene import simulate_observations
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear
from tests.builders.calibrations import calibration_with


def run(*arguments, width=80):
    return CliRunner(env={"COLUMNS": str(width), "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    here = tmp_path_factory.mktemp("existing")
    scene = simulate_observations(2, 60, seed=5)
    sc.write_observations(scene.observations, here / "needle.csv")
    sc.calibrate(scene.observations).save(here / "calibration.json")
    truth = calibration_with(scene.probe_from_image)
    (here / "plus.xml").write_bytes(plus_xml(truth))
    (here / "itk.tfm").write_bytes(itk_tfm(truth))
    (here / "slicer.tfm").write_bytes(slicer_tfm(truth))
    matrix = scene.probe_from_image.matrix
    np.savetxt(here / "matrix.txt", matrix, fmt="%.17g")
    np.savetxt(here / "inverse.txt", np.linalg.inv(matrix), fmt="%.17g")
    np.savetxt(here / "metres.txt", np.diag([1e-3, 1e-3, 1e-3, 1]) @ matrix, fmt="%.17g")
    np.save(here / "matrix.npy", matrix)
    return here


ALIKE = ("plus.xml", "itk.tfm", "slicer.tfm", "matrix.txt", "matrix.npy")


@pytest.mark.parametrize("name", ALIKE)
def test_validate_takes_each_alike(folder, name):
    before = sorted(folder.iterdir())
    done = run("validate", folder / name, folder / "needle.csv")
    assert done.exit_code == 0, done.output
    for words in (
        "On needle.csv, ",
        "where our own calibration, not fitted to them, is off by",
        "Ours: Use it. Expect errors",
        "This matrix",
        "Ours, one frame left out",
        "Against our own calibration of the same rows, mm",
        "Turned by ",
        "What these numbers cannot show:",
        "Scale: 0.24000 mm/px along u, 0.24000 along v",
    ):
        assert words.replace("\n", " ") in " ".join(done.output.split()), words
    assert sorted(folder.iterdir()) == before
    record = json.loads(run("validate", folder / name, folder / "needle.csv", "--json").stdout)
    np.testing.assert_allclose(
        record["matrix"]["probe_from_image"], read_existing(folder / "matrix.txt").matrix, atol=1e-12
    )
    assert record["quantities"][0]["value_mm"] == pytest.approx(1.5, abs=0.7)
    assert len(record["difference"]["distance_mm"]) == 5
    assert record["own"]["verdict"]["level"] == "use"


@pytest.mark.parametrize("name", ALIKE)
def test_info_says_what_it_means(folder, name):
    done = run("info", folder / name)
    assert done.exit_code == 0, done.output
    assert "Scale: 0.24000 mm/px along u, 0.24000 along v" in done.output
    assert "The centre of the first pixel is at (" in done.output
    record = json.loads(run("info", folder / name, "--json").stdout)
    meaning = record["calibrations"] if name == "plus.xml" else record
    assert meaning[0]["scale_mm_per_px"] == pytest.approx([0.24] * 3)
    assert meaning[0]["diagnostics"] == []


@pytest.mark.parametrize("form", ["plus", "itk", "slicer"])
@pytest.mark.parametrize("name", ALIKE)
def test_export_carries_it_from_one_program_to_another(folder, tmp_path, name, form):
    output = tmp_path / ("a.xml" if form == "plus" else "a.tfm")
    done = run("export", folder / name, "--to", form, "-o", output)
    assert done.exit_code == 0, done.output
    assert "no verdict is known of it" in " ".join(done.output.split())
    np.testing.assert_allclose(
        read_existing(output).matrix, read_existing(folder / name).matrix, rtol=0, atol=1e-12
    )
    assert "sonocal has no verdict on it" in output.read_text()


def test_what_is_no_matrix_from_px_to_mm_is_exported_only_by_force(folder, tmp_path):
    for name, words in {"inverse.txt": "is it the inverse", "metres.txt": "are these metres?"}.items():
        refused = run("export", folder / name, "--to", "itk", "-o", tmp_path / "a.tfm")
        assert refused.exit_code == 1
        assert words in refused.output
        assert "--force" in refused.output
        assert not (tmp_path / "a.tfm").exists()
        assert words in " ".join(run("info", folder / name).output.split()).lower()
    done = run("export", folder / "metres.txt", "--to", "itk", "-o", tmp_path / "a.tfm", "--force")
    assert done.exit_code == 0
    turned = (
        "export",
        folder / "inverse.txt",
        "--to",
        "itk",
        "-o",
        tmp_path / "b.tfm",
        "--stored-as",
        "inverse",
    )
    assert run(*turned).exit_code == 0
    np.testing.assert_allclose(
        read_existing(tmp_path / "b.tfm").matrix, read_existing(folder / "matrix.txt").matrix, rtol=1e-9
    )


def test_a_matrix_alone_makes_no_calibration_json(folder, tmp_path):
    refused = run("export", folder / "plus.xml", "--to", "json", "-o", tmp_path / "a.json")
    assert refused.exit_code == 1
    assert "is a matrix alone, and calibration.json holds what a calibration rests on" in refused.output


@pytest.mark.parametrize("name", ALIKE)
def test_compare_and_expected_take_each_alike(folder, name):
    calibration, table = folder / "calibration.json", folder / "needle.csv"
    done = run("validate", calibration, table, "--compare", folder / name, "--no-report")
    assert done.exit_code == 0, done.output
    said = read_existing(folder / name).said
    assert f"The other calibration, {said}, against this one, mm" in " ".join(done.output.split())
    assert "They are up to " in done.output
    record = json.loads(
        run("validate", calibration, table, "--compare", folder / name, "--no-report", "--json").stdout
    )
    assert record["difference"]["rotation_deg"] < 3
    assert run("validate", calibration, table, "--expected", folder / name, "--no-report").exit_code == 0
    other = run("validate", folder / name, table, "--compare", calibration)
    assert other.exit_code == 0, other.output
    assert f"Againsttheothercalibration,{calibration},mm" in "".join(other.output.split())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            ("--expected", "plus.xml"),
            "--expected is for calibration.json; of plus.xml compare it with --compare instead",
        ),
        (("--probe", "P"), "--probe is for recordings; give their needle or wires with --lines"),
    ],
)
def test_options_that_would_do_nothing_are_wrong_usage(folder, monkeypatch, options, words):
    monkeypatch.chdir(folder)
    done = run("validate", "plus.xml", "needle.csv", *options)
    assert done.exit_code == 2, done.output
    assert words in " ".join(done.output.split())


def test_a_page_names_the_matrix_and_its_differences(folder, tmp_path):
    pytest.importorskip("jinja2", reason="jinja2 is not installed")
    table, out = folder / "needle.csv", tmp_path / "out"
    done = run("validate", folder / "plus.xml", table, "-o", out, "--compare", folder / "calibration.json")
    assert done.exit_code == 0, done.output
    assert "validation.html" in done.output
    page = (out / "validation.html").read_text(encoding="utf-8")
    for words in (
        "ImageToProbe of plus.xml (PLUS device set) on needle.csv",
        "Against our own calibration of the same rows",
        "Against the other calibration",
        "Our own calibration of the same rows:",
        "The scale is inside the matrix.",
        "The file has a matrix and nothing of what it was made from",
    ):
        assert words in page
    assert "{{" not in page
    assert run("validate", folder / "plus.xml", table, "-o", out).exit_code == 1  # nothing is replaced
    assert run("validate", folder / "plus.xml", table, "-o", tmp_path / "no", "--no-report").exit_code == 0
    assert not (tmp_path / "no").exists()
    assert run("validate", folder / "plus.xml", table).exit_code == 0
    assert not (folder / "validation.html").exists()


def test_choosing_within_our_own_file_is_wrong_usage(folder, tmp_path):
    own, table = folder / "calibration.json", folder / "needle.csv"
    for command in (
        ("validate", own, table, "--no-report"),
        ("export", own, "--to", "itk", "-o", tmp_path / "a.tfm"),
        ("calibrate", table, "-o", tmp_path / "out", "--expected", own),
    ):
        done = run(*command, "--transform", "ImageToProbe")
        assert done.exit_code == 2, done.output
        assert "--transform is for files of other software" in " ".join(done.output.split())


def test_points_whose_place_is_known_measure_a_matrix(folder, tmp_path):
    found = read_existing(folder / "plus.xml").probe_from_image
    pixels = np.random.default_rng(0).uniform(0, 500, (12, 2))
    table = np.column_stack([pixels, found @ pixels + [0.0, 3.0, 4.0]])
    header = "u_px,v_px,x_mm,y_mm,z_mm"
    np.savetxt(tmp_path / "wire.csv", table, delimiter=",", header=header, comments="", fmt="%.17g")
    done = run("validate", folder / "plus.xml", tmp_path / "wire.csv")
    assert done.exit_code == 0, done.output
    assert "is off by 5.00 mm" in done.output


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    here = tmp_path_factory.mktemp("swept")
    sweep = simulate_sweep(curvilinear(), BATH, SweepOptions(frames=60, seed=2))
    write_sweep(sweep, here)
    (here / "plus.xml").write_bytes(plus_xml(calibration_with(sweep.truth.probe_from_image)))
    return here


def test_a_recording_measures_a_matrix_and_a_calibration_of_ours(swept):
    sweep = (swept / "sweep.igs.mha", "--lines", swept / "needle.toml")
    before = sorted(swept.iterdir())
    done = run("validate", swept / "plus.xml", *sweep)
    assert done.exit_code == 0, done.output
    assert done.output.startswith("On sweep.igs.mha, ImageToProbe of plus.xml is off by ")
    assert sorted(swept.iterdir()) == before
    assert run("calibrate", *sweep, "-o", swept / "out", "--no-report").exit_code == 0
    again = run("validate", swept / "out" / "calibration.json", *sweep, "--no-report", "--json")
    assert again.exit_code == 0, again.output
    assert json.loads(again.stdout)["quantities"]


def test_plus_matrix_on_plus_images_has_the_error_that_plus_reports(data_folder, tmp_path):
    """From the images, with points that we detect: to 2 %; with those that PLUS segmented, to four digits."""
    home = data_folder / "recordings"
    reference = json.loads((data_folder / "observations" / "fcal12_ascension.reference.json").read_text())
    one = reference["reference_calibrations"][0]
    matrix = "  ".join(" ".join(map(repr, row)) for row in one["image_to_probe"])
    (tmp_path / "plus.xml").write_text(
        '<PlusConfiguration version="2.1"><CoordinateDefinitions><Transform From="Image" To="Probe" '
        f'Matrix="{matrix}" Error="{one["reported"]["ValidationMeanMm"]}"/></CoordinateDefinitions></PlusConfiguration>'
    )
    lines = ("--lines", home / "PlusDeviceSet_fCal_Sim_SpatialCalibration_1.2.xml")
    scan = (home / "fCal_Test_Validation_3NWires.igs.mha", *lines, "--centre", "mass", "--json")
    record = json.loads(run("validate", tmp_path / "plus.xml", *scan).stdout)
    assert record["matrix"]["stated_error_mm"] == 1.24684
    errors = {q["code"]: q["value_mm"] for q in record["quantities"]}
    assert errors["plus-nwire"] == pytest.approx(1.24684, rel=0.02)
    table = data_folder / "observations" / "fcal12_ascension.csv"
    nwires = [word for names in reference["nwires"] for word in ("--nwire", ",".join(names))]
    record = json.loads(
        run("validate", tmp_path / "plus.xml", table, "--split", "validation", *nwires, "--json").stdout
    )
    errors = {q["code"]: q["value_mm"] for q in record["quantities"]}
    assert errors["plus-nwire"] == pytest.approx(1.24684, rel=1e-4)
