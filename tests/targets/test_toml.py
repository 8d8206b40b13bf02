"""Needles, wires and points in their own file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.targets import Line, read_lines, write_lines
from tests.builders.targets import LINE


@given(
    name=st.text(min_size=1, max_size=20).filter(lambda s: s.isprintable() or "\x7f" in s or "\n" in s),
    numbers=st.lists(st.floats(-1e6, 1e6), min_size=6, max_size=6).filter(lambda x: x[:3] != x[3:]),
)
def test_lines_written_are_lines_read(tmp_path_factory, name, numbers):
    path = tmp_path_factory.mktemp("toml") / "lines.toml"
    segment = np.array(numbers).reshape(2, 3)
    write_lines([Line(name, "Needle", segment), Line(name + "2", "Probe", segment)], path)
    again, _ = read_lines(path)
    assert [line.name for line in again] == [name, name + "2"]
    assert again[0].segment_mm.tobytes() == segment.tobytes()


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "a.toml: has no [[line]] table; write one a needle or wire: name, frame, from_mm, to_mm"),
        (LINE + LINE, "a.toml: two lines are called 'n'; give each its own name"),
        (
            LINE.replace("to_mm", "till"),
            "a.toml, line table 1: lacks to_mm; it needs name, frame, from_mm, to_mm",
        ),
        (
            LINE + "x = 1",
            "a.toml, line table 1: has the unknown key 'x'; known are name, frame, from_mm, to_mm",
        ),
        (
            LINE.replace("0, 1]", "0, 0]"),
            "a.toml, line 'n': has zero length; give two different points of it",
        ),
        (
            LINE.replace("0, 1]", "0, nan]"),
            "a.toml, line table 1: to_mm is three numbers in mm such as [0.0, 0.0, -333.0]; got [0, 0, nan]",
        ),
        (LINE.replace('"n"', "3"), "a.toml, line table 1: name and frame are text in quotes"),
    ],
)
def test_bad_lines_are_refused(tmp_path, text, sentence):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        read_lines(tmp_path / "a.toml")
    assert str(caught.value) == sentence
