"""`sonocal info` knows every file that a command writes."""

import json
import shlex

import numpy as np
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.report.page_file import read_page
from sonocal.simulation.truth_file import read_truth
from tests.builders.pages import write_files

WRITING = [
    "simulate -o simulated --frames 12 --hidden 0",
    "calibrate sweep.igs.mha --lines needle.toml -o calibration",
    "detect sweep.igs.mha --lines needle.toml -o candidates.csv --sheet sheet.png",
    "tool pivot.igs.mha --tool Needle -o tip.toml",
    "tool pivot.igs.mha --spin spin.igs.mha --tool Needle -o found.toml",
    "validate calibration.json needle.csv -o validation",
    "demo -o demo --needles 12",
    "study needles --trials 2 -o study",
    "export calibration.json --to plus -o plus.xml",
    "export calibration.json --to json -o copy.json",
    *(
        f"export calibration.json --to {to} -o {to}{suffix}"
        for to in ("itk", "slicer")
        for suffix in (".tfm", ".h5")
    ),
    *(f"convert sweep.igs.mha -o converted{suffix}" for suffix in (".mha", ".mhd", ".nrrd", ".mkv")),
    "convert sweep.igs.mha --without-images -o poses.csv",
]


def run(*words):
    return CliRunner(env={"TERM": "dumb", "COLUMNS": "100"}).invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """A folder, and what the commands wrote there, but for shards of a study and pixels beside a header."""
    pytest.importorskip("av", reason="PyAV is not installed")
    folder = tmp_path_factory.mktemp("written")
    write_files(folder)
    before = set(folder.rglob("*"))
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for line in WRITING:
            done = run(*shlex.split(line))
            assert done.exit_code == 0, (line, done.output)
    after = sorted(set(folder.rglob("*")) - before)
    return folder, [path for path in after if path.is_file() and path.suffix not in (".npz", ".zraw", ".raw")]


def test_info_shows_every_file_that_commands_write(written):
    _, paths = written
    assert len(paths) > len(WRITING) + 8
    for path in paths:
        shown = run("info", path)
        assert shown.exit_code == 0, (path.name, shown.output)
        assert shown.stdout.strip()
        assert json.loads(run("info", path, "--json").stdout), path.name


@pytest.mark.parametrize("name", ["study", "study/summary.json", "study/summary.csv", "study/manifest.json"])
def test_a_study_says_its_answer_from_any_of_its_files(written, name):
    folder, _ = written
    answer = json.loads((folder / "study" / "summary.json").read_text())["answers"][0]
    assert answer in " ".join(run("info", folder / name).stdout.split())


def test_a_study_that_goes_on_says_so(written, tmp_path):
    folder, _ = written
    (tmp_path / "manifest.json").write_bytes((folder / "study" / "manifest.json").read_bytes())
    assert "It goes on" in run("info", tmp_path).stdout
    (tmp_path / "alone.csv").write_bytes((folder / "study" / "summary.csv").read_bytes())
    assert "without summary.json beside it" in run("info", tmp_path / "alone.csv").stderr


def test_the_truth_is_what_was_simulated(written):
    folder, _ = written
    found, truth = sc.load(folder / "calibration" / "calibration.json"), read_truth(folder / "truth.json")
    np.testing.assert_allclose(found.probe_from_image.matrix[:, :3], truth.probe_from_image[:, :3], atol=0.01)
    assert read_truth(folder / "simulated" / "truth.json").visible.all()
    assert "shows in 12 of 12 images" in run("info", folder / "simulated" / "truth.json").stdout


def test_a_page_says_the_verdict_and_the_matrix_of_its_calibration(written):
    folder, _ = written
    page, calibration = (
        read_page(folder / "calibration" / "report.html"),
        sc.load(folder / "calibration" / "calibration.json"),
    )
    np.testing.assert_array_equal(page.probe_from_image, calibration.probe_from_image.matrix)
    verdict = sc.validation.give_verdict(calibration)
    assert (page.level, page.headline) == (verdict.level, verdict.headline)
    assert page.source == "sweep.igs.mha"
    assert verdict.headline in run("info", folder / "calibration" / "report.html").stdout


OTHERS = [
    ("calibrate",),
    ("export", "--to", "itk", "-o", "never.tfm"),
    ("detect", "--lines", "needle.toml"),
]


@pytest.mark.parametrize("name", ["simulated/truth.json", "demo/report.html", "study/summary.json"])
@pytest.mark.parametrize("command", OTHERS, ids=lambda command: command[0])
def test_other_commands_call_them_what_they_are(written, monkeypatch, name, command):
    folder, _ = written
    monkeypatch.chdir(folder)
    refused = run(command[0], name, *command[1:])
    said = {
        ".html": "is a page",
        "h.json": "is the truth of a simulated sweep",
        "y.json": "is what a study found",
    }
    words = next(words for end, words in said.items() if name.endswith(end))
    assert refused.exit_code == 1
    assert refused.stderr.startswith(f"Error: {name.rpartition('/')[2]}: {words}")
    assert refused.stderr.count("\n") == 1
