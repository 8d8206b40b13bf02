"""A file may be piped in: ``-`` is read as the file is, and nothing of it stays."""

import json
import tempfile
from pathlib import Path

import pytest
from click.testing import CliRunner

from sonocal.cli.main import main
from tests.builders.pages import copy_of, write_files

TABLES = {
    "calibrate": (["calibrate", "needle.csv", "--json", "--no-report", "-o", "out"], "needle.csv"),
    "validate": (["validate", "calibration.json", "needle.csv", "--json", "--no-report"], "needle.csv"),
    "validate a calibration": (
        ["validate", "calibration.json", "needle.csv", "--json", "--no-report"],
        "calibration.json",
    ),
    "validate known points": (
        ["validate", "calibration.json", "crosswire.csv", "--json", "--no-report"],
        "crosswire.csv",
    ),
    "points": (
        [
            "calibrate",
            "sweep.igs.mha",
            "--lines",
            "needle.toml",
            "--points",
            "points.csv",
            "--json",
            "-o",
            "out",
        ],
        "points.csv",
    ),
    "info of sightings": (["info", "needle.csv", "--json"], "needle.csv"),
    "info of points": (["info", "points.csv", "--json"], "points.csv"),
    "info of a needle": (["info", "needle.toml", "--json"], "needle.toml"),
    "info of a calibration": (["info", "calibration.json", "--json"], "calibration.json"),
    "info of devices": (["info", "devices.xml", "--json"], "devices.xml"),
    "info of a recording": (["info", "sweep.igs.mha", "--json"], "sweep.igs.mha"),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    write_files(folder)
    return folder


@pytest.fixture
def here(files, tmp_path, monkeypatch):
    monkeypatch.chdir(copy_of(files, tmp_path))
    return tmp_path


def run(*words, piped=None):
    return CliRunner(env={"TERM": "dumb"}).invoke(main, words, input=piped, catch_exceptions=False)


def without(record, name):
    """A record but for the name of the file and when it was made."""
    text = json.dumps(record).replace(f'"{name}"', '"stdin"').replace(f"{name}: ", "stdin: ")
    record = json.loads(text)
    if isinstance(record, dict):
        record.pop("created", None)
    return record


@pytest.mark.parametrize("command", TABLES)
def test_what_is_piped_in_is_read_as_its_file_is(here, monkeypatch, command):
    words, name = TABLES[command]
    spool = here / "spool"
    spool.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(spool))
    named = run(*words)
    assert named.exit_code == 0, named.output
    overwrite = ["--overwrite"] if "-o" in words else []
    piped = run(*("-" if word == name else word for word in words), *overwrite, piped=Path(name).read_bytes())
    assert piped.exit_code == 0, piped.output
    assert without(json.loads(piped.stdout), name) == without(json.loads(named.stdout), name)
    assert not list(spool.iterdir())


def test_only_one_file_is_piped_in(here):
    done = run("validate", "-", "-", piped=b"")
    assert done.exit_code == 2
    assert "- stands for one file alone" in done.stderr


@pytest.mark.parametrize("content", [b"", b"\0\1", b"prose\n", b'{"a": 1}'])
def test_messages_call_it_stdin(here, content):
    before = sorted(here.rglob("*"))
    for words in (["calibrate", "-"], ["info", "-"], ["export", "-", "--to", "plus", "-o", "a.xml"]):
        done = run(*words, piped=content)
        assert done.exit_code == 1
        assert done.stderr.startswith("Error: stdin")
        assert tempfile.gettempdir() not in done.stderr
    assert sorted(here.rglob("*")) == before


def test_a_page_on_a_piped_calibration_stands_where_the_command_runs(here):
    piped = Path("calibration.json").read_bytes()
    Path("empty").mkdir()
    done = run("validate", "-", "needle.csv", "-o", "empty", piped=piped)
    assert done.exit_code == 0, done.output
    assert Path("empty/validation.html").exists()
    assert "holds another calibration" in run("validate", "-", "needle.csv", piped=piped).stderr


def test_outputs_are_files(here):
    run("export", "calibration.json", "--to", "plus", "-o", "-")
    assert Path("-").exists()  # a name as any other
