"""Long recordings of several tools: what each did is found without cutting them."""

import re
from itertools import pairwise

import numpy as np
import pytest
from benchmarks.simulators.tool_sessions import SHAFT, TIPS, session
from benchmarks.tool_sessions import is_right, judged, recording

import sonocal as sc
from sonocal.recording import Poses, Recording
from sonocal.report import tool_session_html
from sonocal.tools import find_tool_session


@pytest.fixture(scope="module")
def made():
    one = session(3)
    return one, find_tool_session(recording(one))


def test_every_stretch_is_found_and_none_is_made_up():
    count, tips = judged(4)
    assert all(key[-1] is True for key in count)
    assert max(tips) < 1.0


def test_tips_axes_and_touches_are_where_they_are(made):
    one, found = made
    assert all(is_right(did, found) for did in one.did)
    for tool in ("Stylus", "Needle"):
        assert np.linalg.norm(found.tools[tool].points[0].tip_mm - TIPS[tool]) < 1.0
    axis = found.tools["Needle"].spin.direction
    assert np.degrees(np.arccos(abs(axis @ SHAFT))) < 0.5
    needle = found.tools["Needle"].needle.line.segment_mm
    assert np.linalg.norm(needle[0] - TIPS["Needle"]) < 1.0
    touched = np.array([s.found.point_mm for s in found.stretches if s.kind == "touch"])
    seats = np.array([place for kind, place in one.seats["Stylus"] if kind == "touch"])
    np.testing.assert_allclose(touched, seats, atol=1.0)


def test_stretches_of_a_tool_do_not_overlap(made):
    for tool in made[1].seen:
        own = [one for one in made[1].stretches if one.tool == tool]
        assert all(a.last < b.first for a, b in pairwise(own))


def test_moving_the_room_moves_places_and_nothing_else(made):
    one, found = made
    motion = np.eye(4)
    motion[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    motion[:3, 3] = 10, 20, 30
    poses = [Poses.of(tool, "Tracker", motion @ each) for tool, each in one.poses.items()]
    again = find_tool_session(Recording(one.times, poses={each.name: each for each in poses}))
    assert [(s.tool, s.kind, s.first, s.last) for s in again.stretches] == [
        (s.tool, s.kind, s.first, s.last) for s in found.stretches
    ]


def test_a_known_tip_needs_no_pivot():
    one = session(5)
    pivot = next(did for did in one.did if (did.tool, did.kind) == ("Stylus", "pivot"))
    one.poses["Stylus"][pivot.first : pivot.last + 1] = np.nan
    touches = [did for did in one.did if did.kind == "touch"]
    blind = find_tool_session(recording(one))
    assert not [s for s in blind.stretches if s.kind == "touch"]
    told = find_tool_session(recording(one), tips_mm={"Stylus": TIPS["Stylus"]})
    assert all(is_right(did, told) for did in touches)


def test_two_pivots_that_tell_two_tips_are_named():
    one = session(6)
    later = {tool: each.copy() for tool, each in one.poses.items()}
    later["Stylus"][:, :3, 3] += later["Stylus"][:, :3, :3] @ [8.0, 0.0, 0.0]  # the marker slipped by 8 mm
    times = np.concatenate([one.times, one.times[-1] + 0.05 + one.times])
    poses = [Poses.of(tool, "Tracker", np.concatenate([one.poses[tool], later[tool]])) for tool in TIPS]
    found = find_tool_session(Recording(times, poses={each.name: each for each in poses}))
    told = [d.message for d in found.diagnostics if "points" in d.message]
    assert told
    assert "Stylus was pivoted about two points" in told[0]
    assert float(re.search(r"points ([\d.]+) mm apart", told[0])[1]) == pytest.approx(8.0, abs=0.5)


def test_tools_that_lie_are_refused():
    rng = np.random.default_rng(1)
    still = np.tile(np.eye(4), (400, 1, 1))
    still[:, :3, 3] = rng.normal(0, 0.2, (400, 3))
    poses = Poses.of("Stylus", "Tracker", still)
    with pytest.raises(sc.InputError, match="was pivoted, spun or held"):
        find_tool_session(Recording(np.arange(400) / 20, poses={poses.name: poses}))


def test_the_page_has_the_time_line(made):
    page = tool_session_html(made[1], [("Stylus", "pivot", "0.0", "9.0", "tip to +-0.1")]).decode()
    assert "<svg" in page
    assert "tip to \N{PLUS-MINUS SIGN}0.1" in page
