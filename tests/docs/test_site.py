"""What the site shows is all that there is: names of Python, formats, sweeps with what is said of them.

That it builds without a warning, and that no link inside is broken, is checked by scripts/check_site.py.
"""

import re

import pytest
from scripts.check_imports import EVERYONE, ROOMS

import sonocal
from docs import draw_sweeps
from sonocal.recording.formats.registry import FORMATS
from tests.builders.pasted import ROOT, text_of

API = ROOT / "docs" / "api"
# Rooms that a program does not call: the command line, bytes, the core behind the functions.
NOT_CALLED = {"__main__", "cli", "cli.screen", "_core", "files"}


def test_every_room_has_its_page():
    shown = {
        name
        for page in API.glob("*.md")
        for name in re.findall(r"automodule:: sonocal\.([\w.]+)", text_of(page))
    }
    assert {room for room in {*ROOMS, *EVERYONE} if room not in NOT_CALLED} <= shown


def test_the_face_is_whole():
    listed = re.search(r"autosummary::\n\n(.*?)```", text_of(API / "sonocal.md"), flags=re.DOTALL).group(1)
    assert set(listed.split()) == set(sonocal.__all__) - {"__version__"}


@pytest.mark.parametrize("one", [one for one in FORMATS if one.kind == "recording"], ids=lambda one: one.name)
def test_every_format_of_recordings_has_a_place_in_your_own_data(one):
    text = text_of(ROOT / "docs" / "your-data.md")
    assert one.name.split()[0] in text or any(suffix in text for suffix in one.suffixes)


@pytest.mark.parametrize("sweep", draw_sweeps.SWEEPS, ids=lambda sweep: sweep.title)
def test_a_sweep_in_the_picture_is_what_the_page_says_of_it(sweep):
    code, worst_mm = draw_sweeps.said_of(sweep)
    assert code == sweep.code
    if code:
        assert f"(findings.md#{code})" in text_of(ROOT / "docs" / "scanning.md")
    else:
        assert worst_mm < 1
