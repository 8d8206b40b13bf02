"""Help is whole at any width; its examples are run as they stand there; words are completed by the tab key."""

import itertools
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal import devices, igtl, live, studio
from sonocal.cli.help import COMPLETION, Command
from sonocal.cli.main import main
from tests.builders.live import served
from tests.builders.pages import copy_of, write_files
from tests.builders.tracker_devices import Played

WIDTHS = (40, 80, 200)
COMMANDS = sorted(main.commands)
# Simulations of thousands and of images by the hundred: a few show that the line is one.
FEWER = {
    "study needles": ["--trials", "3", "-o", "few"],
    "study needles --trials 100 -o quick": ["--trials", "3"],
    "simulate -o simulated": ["--frames", "12"],
    "simulate --target walls --look bath --frames 120 -o tank": ["--frames", "12"],
    "reconstruct sweep.igs.mha calibration.json -o fine.nrrd --spacing 0.25 --threads 2": ["--spacing", "1"],
    "live --connect localhost:18944 --lines needle.toml": ["--images", "60"],
    "live --connect localhost:18944 --lines needle.toml --until 0.5mm -o today": ["--images", "60"],
    "simulate --probe linear --look bath --frames 200 -o in-water": ["--frames", "12"],
    "simulate --latency 0.08 --dropouts 0.1 -o with-faults": ["--frames", "12"],
}


def help_of(*words, width):
    done = CliRunner(env={"COLUMNS": str(width), "TERM": "dumb"}).invoke(main, [*words, "--help"])
    assert done.exit_code == 0
    return done.output


def words_of(text):
    return re.sub(r"[ \n\\]+", " ", text)


@pytest.mark.parametrize("name", [None, *COMMANDS])
def test_help_says_the_same_at_any_width_and_nothing_is_cut(name):
    shown = {width: help_of(*([name] if name else []), width=width) for width in (*WIDTHS, 60, 101, 1000)}
    assert {words_of(text) for text in shown.values()} == {words_of(shown[80])}
    for width, text in shown.items():
        assert "…" not in text
        assert max(map(len, text.splitlines())) <= min(width, 100), width


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_every_word_of_every_option(name, width):
    shown = words_of(help_of(name, width=width))
    for param in main.commands[name].params:
        if isinstance(param, click.Option):
            assert words_of(param.help.partition("  [")[0]) in shown


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_stands_in_one_group(name):
    command = main.commands[name]
    assert isinstance(command, Command)
    grouped = [one for names in command.groups.values() for one in names]
    options = [param.name for param in command.params if isinstance(param, click.Option)]
    assert sorted(grouped) == sorted(options)
    for title in command.groups:
        assert f"\n{title}:\n" in help_of(name, width=80)


def examples_in(text):
    """As a shell reads them."""
    lines = text.partition("\nExamples:\n")[2].replace("\\\n", "").splitlines()
    return [" ".join(line.split()) for line in lines if line.strip()]


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", COMMANDS)
def test_examples_are_lines_to_paste_at_any_width(name, width):
    assert examples_in(help_of(name, width=width)) == list(main.commands[name].examples)
    assert all(line.startswith(f"sonocal {name}") for line in main.commands[name].examples)
    assert len(main.commands[name].examples) > 1


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    write_files(folder)
    shutil.copy(folder / "needle.csv", folder / "observations.csv")
    runner = CliRunner()
    done = runner.invoke(
        main, ["export", str(folder / "calibration.json"), "--to", "plus", "-o", str(folder / "plus.xml")]
    )
    assert done.exit_code == 0, done.output
    settings = (
        '<VolumeReconstruction ReferenceCoordinateFrame="Tracker" OutputSpacing="1 1 1"/></PlusConfiguration>'
    )
    devices = (folder / "plus.xml").read_text().replace("</PlusConfiguration>", settings)
    (folder / "plus-volume.xml").write_text(devices)
    return folder


def not_for_ever(
    folder, opener, tool_of, other_of, first=(), *, host, port, ready, begin, recorded, needle, other
):
    """In place of the studio's server, which serves until somebody interrupts: tests/studio runs that."""
    assert begin is None or callable(begin)
    assert len(recorded) == 2
    assert callable(opener)
    assert callable(ready)
    assert needle is None or (callable(tool_of) and needle.pivot.exists() and needle.spin.exists())
    assert other is None or callable(other_of(other))
    assert all(path.exists() for path in first)
    assert (host, port) in {("127.0.0.1", 0), ("127.0.0.1", 8800)}
    folder.mkdir(parents=True)


@pytest.fixture
def there(files, request, monkeypatch):
    """A server wherever a line of ``live`` connects; and a ``replay`` that waits for nobody: tests/live has both."""
    line = request.getfixturevalue("line")
    if line.startswith("sonocal replay"):
        monkeypatch.setattr(live.Replay, "run", lambda *_, **__: 0)
    if not line.startswith("sonocal live"):
        yield
        return
    sweep = sc.read_recording(files / "sweep.igs.mha")
    played = Played(sweep)
    monkeypatch.setattr(devices, "open_tracker", lambda text, tools: played)
    monkeypatch.setattr(devices, "open_video", lambda text: played)
    with served(sweep) as port:
        monkeypatch.setattr(igtl, "address", lambda _: ("127.0.0.1", port))
        yield


@pytest.mark.usefixtures("there", "few_images")
@pytest.mark.parametrize("line", [line for name in COMMANDS for line in main.commands[name].examples])
def test_every_example_runs(line, files, tmp_path, monkeypatch):
    monkeypatch.chdir(copy_of(files, tmp_path))
    monkeypatch.setattr(studio, "serve", not_for_ever)
    typed, _, piped = line.removeprefix("sonocal ").partition(" < ")
    words = shlex.split(typed)
    made = next(
        (Path(value) for option, value in itertools.pairwise(words) if option in ("-o", "--sheet")),
        None,
    )
    if made is not None and made.is_file():
        made.unlink()
    content = Path(piped).read_bytes() if piped else None
    done = CliRunner(env={"TERM": "dumb"}).invoke(
        main, [*words, *FEWER.get(typed, ())], input=content, catch_exceptions=False
    )
    assert done.exit_code == 0, done.output
    assert made is None or made.exists()


def test_every_line_with_fewer_trials_is_an_example():
    assert set(FEWER) <= {
        line.removeprefix("sonocal ") for one in main.commands.values() for line in one.examples
    }


def complete(shell, *words):
    """What a shell is told of the last word."""
    environment = os.environ | {
        "_SONOCAL_COMPLETE": f"{shell}_complete",
        "COMP_WORDS": " ".join(("sonocal", *words)),
        "COMP_CWORD": str(len(words)) if shell != "fish" else words[-1],
    }
    done = subprocess.run(
        [sys.executable, "-m", "sonocal"], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_commands_are_completed(shell):
    found = complete(shell, "cal")
    assert "calibrate" in found
    assert "demo" not in found


def test_words_are_completed():
    assert "--threshold-mm" in complete("bash", "calibrate", "--thr")
    assert "anisotropic" in complete("zsh", "calibrate", "--model", "a")
    assert "needles" in complete("fish", "study", "nee")
    assert "file" in complete("bash", "info", "a")


@pytest.mark.parametrize("line", COMPLETION)
def test_lines_for_the_shells_are_shown_and_make_their_scripts(line):
    for width in WIDTHS:
        assert line in " ".join(help_of(width=width).replace("\\\n", "").split())
    name, shell = re.search(r"(_SONOCAL_COMPLETE)=(\w+)_source", line).groups()
    done = subprocess.run(
        [sys.executable, "-m", "sonocal"],
        env=os.environ | {name: f"{shell}_source"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert "_SONOCAL_COMPLETE=" in done.stdout
    if shutil.which(shell):
        assert subprocess.run([shell, "-n"], input=done.stdout, text=True, check=False).returncode == 0
