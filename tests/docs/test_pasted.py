"""What the pages tell a reader to paste works as it stands there, in a folder with the files that it names.

What the README begins with, `.venv/bin/sonocal`, needs no file: tests/test_readme.py runs it in an empty folder.
"""

import ast
import re
import shlex
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import pytest
from click.testing import CliRunner

from sonocal.cli.main import main
from tests.builders.pages import copy_of, write_files
from tests.builders.pasted import PAGES, ROOT, command_of, commands_in, snippets_in, text_of

# Commands of sonocal that are not run as they stand, and why; what is run in their place.
INSTEAD = {
    # thousands of trials: a few show that the command is one
    "sonocal study paper-2d": "sonocal study paper-2d --trials 5",
    "sonocal study needles --trials 10000": "sonocal study needles --trials 3 -o few",
    "sonocal study needles --workers 8": "sonocal study needles --trials 3 --workers 1 -o few",
    # 500 images: fewer are a recording, too
    "sonocal simulate -o simulated": "sonocal simulate -o simulated --frames 40 --hidden 0",
    # the capitals stand for the reader's own file
    "sonocal calibrate RECORDING --lines needle.toml -o calibration": (
        "sonocal calibrate sweep.igs.mha --lines needle.toml -o calibration"
    ),
    "sonocal detect RECORDING --lines needle.toml -o candidates.csv --sheet contact-sheet.png": (
        "sonocal detect sweep.igs.mha --lines needle.toml -o candidates.csv --sheet contact-sheet.png"
    ),
    # a cluster that is not there; tests/studies/test_cluster.py has one
    "sonocal study needles --scheduler tcp://head-node:8786": None,
}
# Python that is run elsewhere.
ELSEWHERE = {"studies.md": "tests/studies/test_docs.py"}
# What a snippet takes for given.
GIVEN = {
    "validation.md": "import matplotlib; matplotlib.use('agg'); from matplotlib.pyplot import gca; axis = gca()\n"
}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    write_files(folder)
    (folder / "mine.toml").write_text(study_on_the_page())
    return folder


def study_on_the_page():
    """Of few trials."""
    page = text_of(ROOT / "docs" / "studies.md")
    block = re.search(r"^    name = .*?(?=^\|)", page, flags=re.MULTILINE | re.DOTALL).group()
    return textwrap.dedent(block).replace("trials = 1000 ", "trials = 3 ")


def clear_output(words):
    """The file that a command makes is not there yet, whoever made it before for other commands to find."""
    for option in ("-o", "--sheet"):
        if option in words and (made := Path(words[words.index(option) + 1])).is_file():
            made.unlink()


def id_of(page):
    return str(page.relative_to(ROOT))


WITH_COMMANDS = [page for page in PAGES if commands_in(text_of(page))]
WITH_SNIPPETS = [page for page in PAGES if snippets_in(text_of(page))]


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=id_of)
def test_commands_of_sonocal_run_one_after_the_other(page, files, tmp_path, monkeypatch):
    """Each finds the files as they were and what those before it made."""
    monkeypatch.chdir(tmp_path)
    typed = [command for command in commands_in(text_of(page)) if command.startswith("sonocal ")]
    for wanted in filter(None, (INSTEAD.get(command, command) for command in typed)):
        copy_of(files, tmp_path)
        clear_output(shlex.split(wanted))
        done = CliRunner(env={"TERM": "dumb"}).invoke(main, shlex.split(wanted)[1:], catch_exceptions=False)
        assert done.exit_code == 0, f"{wanted}\n{done.output}"


@pytest.mark.parametrize("page", WITH_SNIPPETS, ids=id_of)
def test_python_on_pages_runs(page, files, tmp_path):
    if page.name in ELSEWHERE:
        assert page.name in text_of(ROOT / ELSEWHERE[page.name])
        return
    folder = copy_of(files, tmp_path)
    (folder / "sonocal-demo").mkdir()
    (folder / "sonocal-demo" / "observations.csv").write_bytes((folder / "needle.csv").read_bytes())
    for snippet in snippets_in(text_of(page)):
        program = GIVEN.get(page.name, "") + snippet
        done = subprocess.run(
            [sys.executable, "-c", program], cwd=folder, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=id_of)
def test_scripts_and_modules_that_pages_name_are_there_with_their_options(page):
    for command in commands_in(text_of(page)):
        words = [word for word in shlex.split(command) if "=" not in word or word.startswith("-")]
        tool, *rest = words
        if (
            tool.endswith("python")
            and rest[0] == "-m"
            and rest[1].split(".")[0] in ("benchmarks", "scripts", "docs")
        ):
            check_options(ROOT / (rest[1].replace(".", "/") + ".py"), rest[2:])
        elif tool.endswith("python") and rest[0].startswith("scripts/"):
            check_options(ROOT / rest[0], rest[1:])
        elif tool.endswith("python") and rest[:2] == ["-m", "pytest"]:
            assert all((ROOT / path).exists() for path in rest[2:])
        elif tool.startswith("scripts/") or tool == ".ci/run":
            check_options(ROOT / tool, rest)


def check_options(script, words):
    """The file is there, and its source has every option given."""
    assert script.is_file(), script
    missing = [word for word in words if word.startswith("--") and word not in text_of(script)]
    assert not missing, f"{script.name} knows no {missing}"


def test_extras_that_pages_install_are_in_the_package():
    extras = tomllib.loads(text_of(ROOT / "pyproject.toml"))["project"]["optional-dependencies"]
    named = {name for page in PAGES for name in re.findall(r"(?:sonocal|'\.)\[(\w+)\]", text_of(page))}
    assert named == set(extras)


def test_every_line_in_the_place_of_another_is_on_a_page():
    assert set(INSTEAD) <= {command for page in PAGES for command in commands_in(text_of(page))}


def test_remarks_are_no_part_of_a_command():
    lines = [
        "sonocal info a.mha   # its faults",
        "sonocal tool b \\",
        "  --tool Needle    the tip",
        "name = 1",
    ]
    text = "".join(f"    {line}\n" for line in lines)
    assert commands_in(text) == ["sonocal info a.mha", "sonocal tool b --tool Needle"]
    assert command_of("sonocal study  all") == "sonocal study"


def test_snippets_are_python():
    assert all(ast.parse(snippet) for page in PAGES for snippet in snippets_in(text_of(page)))
