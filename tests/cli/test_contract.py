"""What every command keeps to: exit 0, 1 or 2; a failure is one sentence and writes nothing; JSON is whole."""

import json
import re
from pathlib import Path

import click
import numpy as np
import pytest
from click.testing import CliRunner
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import sonocal as sc
from sonocal.cli.main import main
from sonocal.simulation.scene import simulate_observations
from sonocal.simulation.sweep import SweepOptions, simulate_sweep
from sonocal.simulation.sweep_files import write_sweep
from sonocal.simulation.ultrasound import BATH
from sonocal.simulation.ultrasound_probe import curvilinear

COMMANDS = sorted(main.commands)
BAD = {
    "missing": None,
    "empty": b"",
    "blank": b" \n\n",
    "binary": bytes(range(256)) * 8,
    "prose": b"It was a dark and stormy night; the rain fell in torrents.\n",
    "half a JSON": b'{"format": "sonocal-calibration", "version": 1, "probe_from_image": [[1, 0',
    "another JSON": b'{"a": [1, 2, 3]}\n',
    "another CSV": b"name,age\nAnn,7\n",
    "another XML": b"<html><body/></html>\n",
    "another TOML": b'title = "x"\n',
    "half an image": (
        b"ObjectType = Image\nNDims = 3\nDimSize = 4 4 2\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n\0"
    ),
    "picture": b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR",
}
# Where BAD stands for a file of each command: what stands before and after it.
INPUTS = {
    "calibrate a table": (("calibrate",), ("-o", "out")),
    "calibrate with lines": (("calibrate", "sweep.igs.mha", "--lines"), ("-o", "out")),
    "calibrate a recording": (("calibrate",), ("--lines", "needle.toml", "-o", "out")),
    "calibrate from points": (
        ("calibrate", "sweep.igs.mha", "--lines", "needle.toml", "--points"),
        ("-o", "out"),
    ),
    "calibrate with a mask": (
        ("calibrate", "sweep.igs.mha", "--lines", "needle.toml", "--mask"),
        ("-o", "out"),
    ),
    "detect": (("detect",), ("--lines", "needle.toml", "-o", "out.csv")),
    "detect lines": (("detect", "sweep.igs.mha", "--lines"), ("-o", "out.csv")),
    "tool": (("tool",), ("--tool", "Needle", "-o", "out.toml")),
    "validate": (("validate",), ("table.csv", "-o", "out")),
    "validate on": (("validate", "calibration.json"), ("-o", "out")),
    "validate against": (("validate", "calibration.json", "table.csv", "--compare"), ("-o", "out")),
    "export": (("export",), ("--to", "json", "-o", "out.json")),
    "export into": (("export", "calibration.json", "--to", "plus", "--into"), ("-o", "out.xml")),
    "info": (("info",), ()),
    "info with poses": (("info", "sweep.igs.mha", "--poses"), ()),
}

SUFFIXES = (".csv", ".json", ".mha", ".nrrd", ".toml", ".xml", ".png", ".dcm", ".mp4", ".igs.mha")
# `info` shows the columns of any table.
PAIRS = [(command, kind) for command in INPUTS for kind in BAD if (command, kind) != ("info", "another CSV")]


def run(*arguments, width=80):
    return CliRunner(env={"COLUMNS": str(width), "TERM": "dumb"}).invoke(main, [str(a) for a in arguments])


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """A folder with one sound file of each kind."""
    folder = tmp_path_factory.mktemp("sound")
    options = SweepOptions(frames=12, rate_hz=4, seed=2)
    write_sweep(simulate_sweep(curvilinear(64, 64, 1.5), BATH, options), folder)
    rows = simulate_observations(2, 30, seed=5).observations
    sc.write_observations(rows, folder / "table.csv")
    sc.calibrate(rows).save(folder / "calibration.json")
    return folder


@pytest.fixture
def here(sound, tmp_path, monkeypatch):
    """The working folder, with the sound files in it."""
    for path in sound.iterdir():
        (tmp_path / path.name).symlink_to(path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def listing(folder):
    return {path.name: path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


def assert_refused_in_one_sentence(result, names=()):
    assert result.exit_code == 1, (result.exit_code, result.output, result.exception)
    assert result.stdout == ""
    assert result.stderr.startswith("Error: ")
    assert result.stderr.count("\n") == 1, result.stderr
    assert len(result.stderr) < 750
    for name in names:
        assert name in result.stderr, result.stderr


@pytest.mark.parametrize(("command", "kind"), PAIRS)
def test_a_file_that_is_not_what_is_asked_for_is_refused_by_its_name_and_nothing_is_written(
    here, command, kind
):
    before_it, after_it = INPUTS[command]
    suffix = {"export into": ".xml", "calibrate with a mask": ".png"}.get(command, ".dat")
    bad = Path(f"bad{suffix}")
    if BAD[kind] is not None:
        bad.write_bytes(BAD[kind])
    before = listing(here)
    assert_refused_in_one_sentence(run(*before_it, bad, *after_it), [bad.name])
    assert listing(here) == before


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("kind", ["empty", "binary", "prose"])
@pytest.mark.parametrize("command", ["calibrate a table", "validate", "export", "info", "tool", "detect"])
def test_a_good_name_on_a_bad_file_helps_nothing(here, command, kind, suffix):
    if suffix == ".mp4":
        pytest.importorskip("av", reason="PyAV is not installed")
    before_it, after_it = INPUTS[command]
    Path(f"bad{suffix}").write_bytes(BAD[kind])
    before = listing(here)
    assert_refused_in_one_sentence(run(*before_it, f"bad{suffix}", *after_it), ["bad"])
    assert listing(here) == before


@pytest.mark.parametrize("command", INPUTS)
def test_an_empty_folder_is_no_file(here, command):
    before_it, after_it = INPUTS[command]
    Path("folder").mkdir()
    before = listing(here)
    assert_refused_in_one_sentence(run(*before_it, "folder", *after_it), ["folder"])
    assert listing(here) == before


@pytest.mark.parametrize("kind", ["missing", "empty", "prose", "binary", "another TOML"])
def test_a_study_that_is_none_is_refused(here, kind):
    if BAD[kind] is not None:
        Path("mine.toml").write_bytes(BAD[kind])
    before = listing(here)
    assert_refused_in_one_sentence(run("study", "mine.toml", "-o", "out"), ["mine.toml"])
    assert listing(here) == before


@pytest.mark.parametrize(
    ("arguments", "out"),
    [
        (["calibrate", "table.csv", "--no-report"], "file"),
        (["demo", "--no-report"], "file"),
        (["export", "calibration.json", "--to", "json"], "file/a.json"),
        (["export", "calibration.json", "--to", "plus"], "missing/a.xml"),
        (["export", "calibration.json", "--to", "itk"], "missing/a.tfm"),
        (["simulate", "--frames", "1"], "file"),
        (["sample"], "file"),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else value,
)
def test_a_place_that_cannot_be_written_is_said_and_what_stands_there_stays(here, arguments, out):
    Path("file").write_text("in the way")
    before = listing(here)
    assert_refused_in_one_sentence(run(*arguments, "-o", out), [out.split("/", maxsplit=1)[0]])
    assert listing(here) == before


@pytest.mark.parametrize("command", COMMANDS)
def test_wrong_usage_has_status_2_and_writes_nothing(here, command):
    before = listing(here)
    for arguments in (["--no-such-option"], ["a", "b", "c", "d"]):
        result = run(command, *arguments)
        assert result.exit_code == 2, (arguments, result.output)
        assert result.stdout == ""
        assert "Usage: " in result.stderr
        assert "Traceback" not in result.output
    assert listing(here) == before


def options_of(command):
    return [
        name for param in command.params for name in (*param.opts, *param.secondary_opts) if name[0] == "-"
    ]


@pytest.mark.parametrize("width", [40, 80, 200])
@pytest.mark.parametrize("name", COMMANDS)
def test_help_names_every_option_at_any_width(name, width):
    shown = run(name, "--help", width=width)
    assert shown.exit_code == 0
    assert shown.stderr == ""
    assert "Traceback" not in shown.output
    words = set(re.split(r"[\s,\[\]=/]+", shown.output))
    assert set(options_of(main.commands[name])) <= words
    assert shown.output == run(name, "-h", width=width).output


@pytest.mark.parametrize("width", [40, 80, 200])
def test_the_groups_help_names_every_command(width):
    shown = run("--help", width=width)
    assert shown.exit_code == 0
    for name in COMMANDS:
        assert re.search(rf"^ +{name}\b", shown.output, re.MULTILINE)


def test_the_groups_help_has_a_whole_line_for_every_command():
    lines = run("--help").output.partition("Commands:\n")[2].partition("\n\n")[0].splitlines()
    assert len(lines) == len(COMMANDS)
    for name, line in zip(COMMANDS, lines, strict=True):
        assert re.fullmatch(rf"  {name} +[A-Z].*[^.]\.", line), line


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_says_in_words_what_it_does(name):
    for param in main.commands[name].params:
        if isinstance(param, click.Option):
            assert param.help, param.opts
            assert param.help.rstrip().endswith((".", "]")), param.help


WITH_JSON = {
    "calibrate": ["calibrate", "table.csv", "-o", "out", "--no-report", "--overwrite"],
    "validate": ["validate", "calibration.json", "table.csv", "--no-report"],
    "info of a table": ["info", "table.csv"],
    "info of a calibration": ["info", "calibration.json"],
    "info of a recording": ["info", "sweep.igs.mha"],
    "info of a needle": ["info", "needle.toml"],
}


@pytest.mark.parametrize("width", [40, 200])
@pytest.mark.parametrize("command", WITH_JSON)
def test_json_is_one_value_without_nan_whatever_the_terminal(here, command, width):
    shown = run(*WITH_JSON[command], "--json", width=width)
    assert shown.exit_code == 0, shown.output

    def refuse(word):
        raise AssertionError(word)

    assert json.loads(shown.stdout, parse_constant=refuse)
    assert shown.stdout == run(*WITH_JSON[command], "--json", width=80).stdout or command == "calibrate"


@pytest.mark.parametrize("command", WITH_JSON)
def test_tables_for_people_are_shown_at_any_width(here, command):
    for width in (40, 80, 200):
        shown = run(*WITH_JSON[command], width=width)
        assert shown.exit_code == 0, shown.output
        assert shown.stdout.strip()
        assert "Traceback" not in shown.output


def test_the_file_written_is_the_json_printed_and_the_answer_python_gives(here):
    shown = run("calibrate", "table.csv", "-o", "out", "--json", "--no-report")
    written = json.loads(Path("out/calibration.json").read_text())
    printed = json.loads(shown.stdout)
    assert {name: printed[name] for name in written} == written
    expected = sc.calibrate(sc.read_observations("table.csv")).probe_from_image.matrix
    np.testing.assert_array_equal(written["probe_from_image"], expected)
    assert run("info", "out/calibration.json").exit_code == 0


def test_the_report_and_the_printing_change_nothing_in_the_calibration(here):
    run("calibrate", "table.csv", "-o", "plain", "--no-report")
    run("calibrate", "table.csv", "-o", "full", "--json", width=40)
    plain, full = (json.loads(Path(name, "calibration.json").read_text()) for name in ("plain", "full"))
    for record in (plain, full):
        record.pop("created")
    assert plain == full
    assert sorted(p.name for p in Path("plain").iterdir()) == ["calibration.json"]


@settings(max_examples=25)
@given(
    st.sampled_from(
        ["--threshold-mm", "--tolerance-mm", "--sigma-px", "--sigma-mm", "--max-samples", "--seed"]
    ),
    st.sampled_from(["0", "-1", "nan", "inf", "-inf", "abc", "", "1e400", "0x3"]),
)
def test_numbers_that_make_no_sense_are_wrong_usage_or_one_sentence(sound, option, value):
    assume((option, value) != ("--seed", "0"))
    result = run("calibrate", sound / "table.csv", "-o", sound / "never", option, value)
    assert result.exit_code in {1, 2}, (option, value, result.output)
    assert not isinstance(result.exception, (ValueError, TypeError, OverflowError))
    assert result.stdout == ""
    if result.exit_code == 1:
        assert_refused_in_one_sentence(result, [option])
    assert not (sound / "never").exists()


@settings(max_examples=25)
@given(st.text(st.characters(codec="ascii", min_codepoint=32), max_size=12))
def test_no_size_of_an_image_but_two_or_three_whole_numbers_is_taken(sound, text):
    result = run("calibrate", sound / "table.csv", "-o", sound / "never", f"--image-size={text}")
    assert result.exit_code in {1, 2}
    assert not (sound / "never").exists()
