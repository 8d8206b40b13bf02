"""What the documentation names is there: files, links, sections, modules; and the rooms are those of the table."""

import importlib.util
import re
import runpy
import sys
from pathlib import Path

import pytest
from scripts.check_imports import EVERYONE, ROOMS

from docs import draw_rooms
from sonocal.report.session import FIGURES

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
TEXTS = {page.relative_to(ROOT): page.read_text(encoding="utf-8") for page in PAGES}
PLACEHOLDER = re.compile(r"\bNAME\b|\b(test_)?mine\.py$")  # what a reader is to name
FOLDERS = ("src", "cpp", "tests", "benchmarks", "scripts", "docs")


def anchors(text):
    """As they are made from headings: small letters, blanks to hyphens, no other signs."""
    heads = re.findall(r"^#+ (.*)$", text, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", TEXTS, ids=str)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", TEXTS[page]):
        if target.startswith(("http:", "https:")):
            continue
        path, _, section = target.partition("#")
        file = (ROOT / page).parent / path if path else ROOT / page
        assert file.exists(), target
        assert not section or section in anchors(file.read_text(encoding="utf-8")), target


@pytest.mark.parametrize("page", TEXTS, ids=str)
def test_files_that_are_named_exist(page):
    for name in re.findall(rf"`((?:{'|'.join(FOLDERS)})/[\w./-]+)`", TEXTS[page]):
        assert (ROOT / name).exists() or PLACEHOLDER.search(name), name


@pytest.mark.parametrize("page", TEXTS, ids=str)
def test_modules_that_are_run_exist(page):
    for name in re.findall(r"python -m ((?:benchmarks|docs)\.\w+)", TEXTS[page]):
        assert importlib.util.find_spec(name), name


@pytest.mark.parametrize("page", TEXTS, ids=str)
def test_scripts_that_are_run_exist(page):
    for name in re.findall(r"(?<![\w/])((?:scripts|\.ci)/[\w.]+)", TEXTS[page]):
        assert (ROOT / name.rstrip(".")).exists(), name


def test_the_page_to_begin_with_names_every_figure():
    rows = re.findall(r"^\| (`\".*) \|", TEXTS[Path("docs/first-calibration.md")], flags=re.MULTILINE)
    assert set(re.findall(r'`"(\w+)"`', " ".join(rows))) == set(FIGURES)


def test_functions_stand_in_the_files_that_the_walk_names():
    text = TEXTS[Path("docs/architecture.md")]
    named = re.findall(r"`([\w.]+)`\s+(?:\(|in\s+)`(src/[\w/.]+\.py)`", text)
    assert len(named) > 30
    for name, path in named:
        source = (ROOT / path).read_text(encoding="utf-8")
        for part in name.split("."):
            assert re.search(rf"^ *(?:def|class) {part}\b", source, flags=re.MULTILINE), f"{name} in {path}"


def test_the_table_and_the_picture_of_the_rooms_are_those_that_imports_are_checked_by():
    text = TEXTS[Path("docs/architecture.md")]
    assert draw_rooms.with_table(text) == text, "run python -m docs.draw_rooms"
    assert draw_rooms.PICTURE.read_text(encoding="utf-8") == draw_rooms.picture(), (
        "run python -m docs.draw_rooms"
    )


def test_the_picture_has_every_room():
    shown = set(re.findall(r">([\w., ]+)</text>", draw_rooms.picture()))
    names = {name for text in shown for name in text.split(", ")}
    assert names >= (set(ROOMS) | EVERYONE) - {"__main__"}


def test_arrows_that_are_left_out_follow_from_the_others():
    drawn = draw_rooms.needed()

    def below(room):
        return drawn[room].union(*(below(other) for other in drawn[room]))

    for room in drawn:
        assert below(room) >= ROOMS[room] & set(drawn)
        assert all(other not in below(via) for other in drawn[room] for via in drawn[room])


def test_every_decision_is_in_the_index():
    folder = ROOT / "docs" / "decisions"
    linked = set(re.findall(r"\]\((\S+\.md)\)", (folder / "README.md").read_text(encoding="utf-8")))
    assert linked == {path.name for path in folder.glob("*.md")} - {"README.md"}


@pytest.mark.parametrize(
    "name",
    [path.stem for path in sorted((ROOT / "benchmarks").glob("*.py")) if "__main__" in path.read_text()],
)
def test_a_benchmark_says_what_it_measures_when_asked_for_help(name, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [f"{name}.py", "--help"])
    monkeypatch.delitem(sys.modules, f"benchmarks.{name}", raising=False)
    with pytest.raises(SystemExit, match=r"^0$"):
        runpy.run_module(f"benchmarks.{name}", run_name="__main__")
    said = capsys.readouterr().out
    assert said.startswith("usage: ")
    assert len(said.split()) > 15
