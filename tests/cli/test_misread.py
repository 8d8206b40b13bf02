"""A matrix that was misread, on the command line: judged alone, beside a calibration of ours, and beside another."""

import dataclasses
import json
import shutil

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.simulation.scene import simulate_observations
from tests.builders.browser import CHROMIUM, opened
from tests.builders.disguises import DISGUISES, OF_IMAGES, SIZE

DIRECT = {name: one for name, one in DISGUISES.items() if one[1] == "direct"}


def run(*arguments, width=100):
    return CliRunner(env={"COLUMNS": str(width), "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


def record(*arguments):
    done = run(*arguments, "--json")
    assert done.exit_code == 0, done.output
    return json.loads(done.stdout)


def whole(result):
    assert result.exit_code == 0, result.output
    return " ".join(result.output.split())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    here = tmp_path_factory.mktemp("misread")
    made = simulate_observations(2, 60, seed=5)
    rows = dataclasses.replace(made.observations, image_size_px=SIZE)
    sc.write_observations(rows, here / "needle.csv")
    sc.calibrate(sc.read_observations(here / "needle.csv")).save(here / "calibration.json")
    truth = made.probe_from_image.matrix
    np.savetxt(here / "right.txt", truth, fmt="%.17g")
    for name, (hidden, *_) in DIRECT.items():
        np.savetxt(here / f"{name}.txt", hidden(truth), fmt="%.17g")
    known = np.random.default_rng(0).uniform(0, 500, (12, 2))
    table = np.column_stack([known, made.probe_from_image @ known])
    header = "u_px,v_px,x_mm,y_mm,z_mm"
    np.savetxt(here / "wire.csv", table, delimiter=",", header=header, comments="", fmt="%.17g")
    return here


@pytest.mark.parametrize("option", ["--compare", "--expected"])
@pytest.mark.parametrize("disguise", DIRECT)
def test_beside_ours_every_disguise_is_named_and_undone_for_programs(folder, disguise, option):
    matrix = folder / f"{disguise}.txt"
    found = record(
        "validate", folder / "calibration.json", folder / "needle.csv", option, matrix, "--no-report"
    )
    (way,) = found["rereadings"]
    words, name = DIRECT[disguise][2:]
    assert (way["file"], way["transform"], way["name"]) == (matrix.name, "", name)
    assert words in f"{way['message']}: {way['advice']}"
    truth = np.loadtxt(folder / "right.txt")
    np.testing.assert_allclose(
        np.array(way["probe_from_image"])[:3, [0, 1, 3]], truth[:3, [0, 1, 3]], rtol=0.02, atol=0.02
    )
    (note,) = [one for one in found["diagnostics"] if one["code"] == "misread-matrix"]
    assert note["severity"] == "info"
    assert (found["verdict"]["level"] == "use") == (disguise not in OF_IMAGES)
    if option == "--compare":
        apart = found["difference"]
        assert max(apart["distance_mm"]) > 15
        assert max(apart["reread"]["distance_mm"]) < 3


@pytest.mark.parametrize("option", ["--compare", "--expected"])
def test_a_matrix_that_agrees_is_not_named_and_its_list_is_empty(folder, option):
    beside = ("validate", folder / "calibration.json", folder / "needle.csv", option, folder / "right.txt")
    found = record(*beside, "--no-report")
    assert found["rereadings"] == []
    assert "reread" not in found.get("difference", {})
    assert "misread" not in whole(run(*beside, "--no-report"))


def test_both_options_at_once_judge_both(folder):
    both = ("--compare", folder / "inverse.txt", "--expected", folder / "metres.txt", "--no-report")
    found = record("validate", folder / "calibration.json", folder / "needle.csv", *both)
    assert [(one["file"], one["name"]) for one in found["rereadings"]] == [
        ("inverse.txt", "inverse"),
        ("metres.txt", "metres"),
    ]
    assert [one["code"] for one in found["diagnostics"]].count("misread-matrix") == 2


def test_expected_and_compared_in_words(folder):
    beside = ("validate", folder / "calibration.json", folder / "needle.csv", "--no-report", "--compare")
    said = whole(run(*beside, folder / "inverse.txt"))
    assert "apart as read" in said
    assert (
        "The matrix of inverse.txt is stored as the inverse of what maps px to mm. Read so, they are up to 0."
    ) in said
    assert "What to do: give --stored-as inverse." in said


def test_a_matrix_alone_is_given_as_it_is_right(folder):
    found = record("validate", folder / "inverse.txt", folder / "needle.csv")
    (way,) = found["rereadings"]
    np.testing.assert_allclose(
        way["probe_from_image"], np.loadtxt(folder / "right.txt"), rtol=1e-6, atol=1e-6
    )
    assert found["quantities"][0]["value_mm"] > 100
    assert way["quantities"][0]["value_mm"] < 3
    assert max(found["difference"]["reread"]["distance_mm"]) < 3
    said = whole(run("validate", folder / "inverse.txt", folder / "needle.csv"))
    assert "This matrix, read so" in said
    assert "The matrix of inverse.txt (4 x 4 matrix as text), read so: mm in" in said
    assert "Scale: 0.24000 mm/px along u" in said
    assert record("validate", folder / "right.txt", folder / "needle.csv")["rereadings"] == []


@pytest.mark.parametrize(("expected", "named"), [("right", []), ("inverse", ["inverse"])])
def test_calibrate_has_what_its_expectation_was_misread_as(folder, tmp_path, expected, named):
    found = record(
        "calibrate",
        folder / "needle.csv",
        "--expected",
        folder / f"{expected}.txt",
        "-o",
        tmp_path / "out",
        "--no-report",
    )
    assert [one["name"] for one in found["rereadings"]] == named
    for way in found["rereadings"]:
        np.testing.assert_allclose(way["probe_from_image"], np.loadtxt(folder / "right.txt"), atol=1e-6)
    alone = record("calibrate", folder / "needle.csv", "-o", tmp_path / "alone", "--no-report")
    assert alone["rereadings"] == []


@pytest.mark.parametrize(
    ("judged", "other", "named"),
    [
        ("right", "right", []),
        ("right", "inverse", ["inverse"]),
        ("metres", "right", ["metres"]),
        ("metres", "inverse", ["metres", "inverse"]),
        ("inverse", "inverse", ["inverse", "inverse"]),
    ],
)
def test_of_two_matrices_each_is_judged_by_ours(folder, judged, other, named):
    both = ("validate", folder / f"{judged}.txt", folder / "needle.csv", "--compare", folder / f"{other}.txt")
    found = record(*both)
    assert [one["name"] for one in found["rereadings"]] == named
    meant = found["comparison"].get("reread", found["comparison"])
    np.testing.assert_allclose(meant["distance_mm"], 0, atol=1e-6)
    said = whole(run(*both))
    assert f"Against the other calibration, the matrix of {other}.txt, mm" in said
    # The option turns both files: that is said where one alone is to be turned.
    assert ("--stored-as is for both files of a command" in said) == (other == "inverse" != judged)
    # What leads is of the matrix that is judged.
    assert said.startswith("The matrix of" if judged != "right" else "On needle.csv, the matrix of right.txt")


def test_points_tell_of_a_matrix_and_few_of_them_leave_it_to_the_calibration_beside_it(folder, tmp_path):
    found = record("validate", folder / "inverse.txt", folder / "wire.csv")
    assert [one["name"] for one in found["rereadings"]] == ["inverse"]
    assert found["diagnostics"][0]["severity"] == "warning"
    assert found["sentence"].endswith("on these points, read so by 0.00 mm: give --stored-as inverse.")
    lines = (folder / "wire.csv").read_text().splitlines()
    (tmp_path / "few.csv").write_text("\n".join(lines[:3]))
    few = ("validate", folder / "inverse.txt", tmp_path / "few.csv")
    assert record(*few)["rereadings"] == []
    found = record(*few, "--compare", folder / "calibration.json")
    assert [one["name"] for one in found["rereadings"]] == ["inverse"]
    assert f"mm from {folder / 'calibration.json'}, read so 0." in found["sentence"]


@pytest.mark.parametrize("misread", ["inverse", "right"])
def test_the_page_of_a_matrix_names_the_other_and_leads_with_what_to_do(folder, tmp_path, misread):
    pytest.importorskip("jinja2", reason="jinja2 is not installed")
    other = folder / "calibration.json"
    done = run(
        "validate", folder / f"{misread}.txt", folder / "needle.csv", "-o", tmp_path, "--compare", other
    )
    assert done.exit_code == 0, done.output
    page = (tmp_path / "validation.html").read_text(encoding="utf-8")
    assert f"<h2>Against the other calibration, {other}</h2>" in page
    assert f"<td>compared with</td><td>the other calibration, {other}</td>" in page
    assert ("Right when it is read otherwise" in page) == (misread == "inverse")
    assert ("<b>What to do: give --stored-as inverse.</b>" in page) == (misread == "inverse")
    assert ("read so, mm" in page) == (misread == "inverse")
    assert "<td>0.174412</td>" in page  # the matrix as it is right


@pytest.mark.parametrize("other", ["inverse.txt", "earlier.json"])
def test_the_page_of_ours_names_what_it_is_compared_with(folder, tmp_path, other):
    pytest.importorskip("jinja2", reason="jinja2 is not installed")
    shutil.copy(folder / "calibration.json", folder / "earlier.json")
    shutil.copy(folder / "calibration.json", tmp_path / "calibration.json")
    ours = tmp_path / "calibration.json"
    done = run("validate", ours, folder / "needle.csv", "--compare", folder / other)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "validation.html").read_text(encoding="utf-8")
    if other == "inverse.txt":
        assert "<h2>The other calibration, the matrix of inverse.txt, against this one</h2>" in page
        assert "Read so, they are up to 0." in page
    else:
        assert f"<h2>Against the other calibration, {folder / other}</h2>" in page


@pytest.mark.skipif(CHROMIUM is None, reason="no chromium; apt install chromium")
def test_a_browser_opens_the_page_of_a_misread_matrix_wide_and_narrow(folder, tmp_path):
    pytest.importorskip("jinja2", reason="jinja2 is not installed")
    both = ("--compare", folder / "metres.txt", "--scanner-mm-per-px", "0.24")
    assert (
        run("validate", folder / "inverse.txt", folder / "needle.csv", *both, "-o", tmp_path).exit_code == 0
    )
    shown = opened(tmp_path / "validation.html")
    assert shown.requests == [(tmp_path / "validation.html").as_uri()]
    assert shown.troubles == []
    assert shown.overflow <= 0
    assert shown.narrow <= 1
