"""What the pages tell a reader to paste works as it stands there, in a folder with the files that it names."""

import ast
import json
import re
import shlex
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest
from click.testing import CliRunner

import sonocal as sc
from sonocal.cli.main import main
from sonocal.observations import parse_observations
from tests.builders.page_recordings import write_recordings
from tests.builders.pages import copy_of, write_files
from tests.builders.pasted import (
    PAGES,
    ROOT,
    blocks_in,
    commands_in,
    of_kind,
    outside_of_blocks,
    text_of,
)

# Commands of sonocal that run with fewer trials or images than a reader has the patience for.
INSTEAD = {
    "sonocal simulate --target walls --look bath --frames 60 -o tank": "sonocal simulate --target walls --look bath "
    "--frames 20 -o tank",
    "sonocal study paper-2d": "sonocal study paper-2d --trials 5",
    "sonocal study needles --trials 10000": "sonocal study needles --trials 3 -o few",
    "sonocal study needles --workers 8": "sonocal study needles --trials 3 --workers 1 -o few",
}
# Commands that no test runs, and why. What they name must be there all the same.
NOT_RUN = {
    "sonocal live --tracker optitrack:192.168.0.4 --video /dev/video0 --lines needle.toml --latency estimate": (
        "needs devices; tests/live has some"
    ),
    'sonocal live --tracker ndi:/dev/ttyUSB0 --tool Probe=probe.rom --tool Needle=1 --video "video=USB Capture" '
    "--lines needle.toml --latency estimate": "needs devices; tests/live has some",
    "sonocal replay sweep.igs.mha --port 18945 --rate 30": "waits for a client; tests/live has both",
    "sonocal live --connect localhost:18945 --lines needle.toml --until 1.5mm": "needs a server; tests/live has one",
    "sonocal studio sweep.igs.mha --lines needle.toml": "serves until somebody interrupts; tests/studio runs it",
    "sonocal studio sweep.igs.mha --lines needle.toml --compare calibrated.xml": "the same",
    "sonocal studio sweep.igs.mha --pivot pivot.igs.mha --spin spin.igs.mha": "the same",
    "sonocal studio --live localhost:18945 --lines needle.toml": "the same, of a server",
    "sonocal calibrate sweep.igs.mha --lines needle.toml --latency estimate -o without-lag": "the page's sweep is "
    "short and steady, and refused; tests/sweep/test_lagged.py runs a longer one",
    "sonocal study needles --scheduler tcp://head-node:8786": "needs a cluster; tests/studies/test_cluster.py has one",
    "sonocal reconstruct sweep.igs.mha plus.xml --like-plus plus-volume.xml -o as-plus.mha": "needs a device "
    "set that says how PLUS makes volumes; tests/reconstruction/test_plus.py has PLUS's own",
    "python3 -m venv .venv": "makes an environment: scripts/environment.sh does, before any test",
    "source .venv/bin/activate": "changes the reader's shell",
    "pip install '.[report]'": "compiles for minutes: scripts/environment.sh does, before any test",
    ".venv/bin/python -m pip install --no-build-isolation --editable .": "the same",
    "python -m benchmarks.sound --seeds 200": "takes ten minutes",
    "scripts/sdist --anew": "minutes: .ci/run does so of the tree",
    "scripts/wheels": "compiles for ten minutes",
    "scripts/wheels --check": "emulates another machine for minutes",
    "python -m sphinx -W -b html docs docs/_build": "scripts/check does",
    ".venv/bin/python scripts/check_site.py docs/_build": "scripts/check does",
    "pip install atheris": "needs the package index",
    "scripts/demo": "makes an environment and compiles; tests/test_readme.py runs its command",
    "python scripts/fuzz.py --seconds 600": "takes ten minutes",
    ".venv/bin/python scripts/fuzz.py --seconds 60": "takes a minute",
    ".venv/bin/python scripts/fuzz_calls.py --of python --calls 20000": "takes minutes",
    ".venv/bin/python scripts/fuzz_calls.py --of files --each --calls 20000": "takes an hour",
    ".venv/bin/python scripts/fuzz_calls.py --of igtl --calls 20000": "takes minutes",
    "python scripts/fuzz_calls.py --of files --each --calls 1000000 --counts counts": "takes a day",
    "PYTHON=.venv/bin/python scripts/sanitize": ".ci/run does",
    ".venv/bin/python -m pytest tests/calibration tests/laws/test_calibration.py": "these are tests",
    "python -m benchmarks.trust --seeds 50 --jobs 2 --write docs/trust.md": "measures for an hour",
}
# Python that is run elsewhere.
ELSEWHERE = {"studies.md": "tests/studies/test_docs.py"}
KINDS = {"sh", "python", "text", "toml", "csv", "xml", "json"}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    write_files(folder)
    (study,) = of_kind(text_of(ROOT / "docs" / "studies.md"), "toml")
    (folder / "mine.toml").write_text(study.replace("trials = 1000 ", "trials = 3 "))
    return folder


def id_of(page):
    return str(page.relative_to(ROOT))


def clear_output(words):
    """The file that a command makes is not there yet, whoever made it before for other commands to find."""
    for option in ("-o", "--sheet"):
        if option in words and (made := Path(words[words.index(option) + 1])).is_file():
            made.unlink()


def run_command(typed, files):
    if typed in NOT_RUN:
        return
    command, _, piped = INSTEAD.get(typed, typed).partition(" < ")
    words = shlex.split(command)
    assert words[0] == "sonocal", f"{typed}: is neither run nor among those that are not"
    copy_of(files, Path())
    clear_output(words)
    given = Path(piped).read_bytes() if piped else None
    done = CliRunner(env={"TERM": "dumb"}).invoke(main, words[1:], input=given, catch_exceptions=False)
    assert done.exit_code == 0, f"{typed}\n{done.output}"


@pytest.mark.usefixtures("few_images")
@pytest.mark.parametrize("page", [page for page in PAGES if blocks_in(text_of(page))], ids=id_of)
def test_a_page_runs_from_top_to_bottom(page, files, tmp_path, monkeypatch):
    """Commands and Python one after the other: each finds the files as they were and what those before it made."""
    monkeypatch.chdir(copy_of(files, tmp_path))
    monkeypatch.setenv("MPLBACKEND", "agg")
    if page.name == "your-data.md":
        write_recordings(sc.read_recording("sweep.igs.mha"), tmp_path)
    names = {"__name__": "__main__"}
    for block in blocks_in(text_of(page)):
        if block.kind == "sh":
            for typed in filter(None, block.text.splitlines()):
                run_command(typed, files)
        elif block.kind == "python" and page.name in ELSEWHERE:
            assert page.name in text_of(ROOT / ELSEWHERE[page.name])
        elif block.kind == "python":
            exec(compile(block.text, id_of(page), "exec"), names)


@pytest.mark.parametrize("page", PAGES, ids=id_of)
def test_files_on_pages_can_be_read(page):
    read = {
        "toml": tomllib.loads,
        "json": json.loads,
        "xml": ElementTree.fromstring,
        "csv": lambda text: text.startswith("frame,") and parse_observations(text.encode(), page.name),
        "python": ast.parse,
    }
    for block in blocks_in(text_of(page)):
        assert block.kind in KINDS or block.kind.startswith("{"), f"{block.kind}: of no kind that is tested"
        read.get(block.kind, str)(block.text)


@pytest.mark.parametrize("page", PAGES, ids=id_of)
def test_nothing_to_paste_escapes_these_tests(page):
    """Blocks are fenced, and a command is a line without prompt or remark: as it stands it is pasted into any shell."""
    text = text_of(page)
    typed = r"(?:sonocal|python|pip|scripts|import|from) "
    assert not re.search(rf"\n\n {{4,}}{typed}", outside_of_blocks(text))
    assert not any(re.search(rf"^{typed}", block, flags=re.MULTILINE) for block in of_kind(text, "text"))
    for line in commands_in(text):
        assert not re.search(r"\s{2}|\s#|^[#$>]|\\$", line), line


def test_every_exception_is_on_a_page():
    typed = {command for page in PAGES for command in commands_in(text_of(page))}
    assert {*INSTEAD, *NOT_RUN} <= typed


@pytest.mark.parametrize("command", NOT_RUN)
def test_scripts_and_modules_that_are_not_run_are_there_with_their_options(command):
    words = [word for word in shlex.split(command) if "=" not in word or word.startswith("-")]
    tool, *rest = words
    if tool.endswith("python") and rest[0] == "-m" and rest[1].startswith("benchmarks."):
        check_options(ROOT / (rest[1].replace(".", "/") + ".py"), rest[2:])
    elif tool.endswith("python") and rest[0].startswith("scripts/"):
        check_options(ROOT / rest[0], rest[1:])
    elif tool.endswith("python") and rest[:2] == ["-m", "pytest"]:
        assert all((ROOT / path).exists() for path in rest[2:])
    elif tool.startswith("scripts/"):
        check_options(ROOT / tool, rest)


@pytest.mark.parametrize("page", PAGES, ids=id_of)
def test_modules_and_scripts_that_are_named_have_the_options_named(page):
    for module, options in re.findall(r"`python -m (benchmarks\.\w+)([^`]*)`", text_of(page)):
        check_options(ROOT / (module.replace(".", "/") + ".py"), options.split())


def check_options(script, words):
    """The file is there, and its source has every option given."""
    assert script.is_file(), script
    missing = [word for word in words if word.startswith("--") and word not in text_of(script)]
    assert not missing, f"{script.name} knows no {missing}"


def test_extras_that_pages_install_are_in_the_package():
    extras = tomllib.loads(text_of(ROOT / "pyproject.toml"))["project"]["optional-dependencies"]
    named = {name for page in PAGES for name in re.findall(r"(?:sonocal|'\.)\[(\w+)\]", text_of(page))}
    assert named == set(extras)
