"""Every script runs as it is, in a folder of its own, and stands in the list."""

import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))


@pytest.mark.usefixtures("few_images")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_a_script_runs_and_says_something(script, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(script), run_name="__main__")
    assert len(capsys.readouterr().out.splitlines()) >= 2


def test_all_are_numbered_and_in_the_list():
    listed = (FOLDER / "README.md").read_text(encoding="utf-8")
    assert [script.name[:2] for script in SCRIPTS] == [f"{i:02}" for i in range(1, len(SCRIPTS) + 1)]
    for path in [*SCRIPTS, *FOLDER.glob("*.ipynb")]:
        assert f"[{path.name}]({path.name})" in listed
