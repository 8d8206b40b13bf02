"""Needles, wires and points in their own file."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.targets import Line, Point, lines_toml, read_lines, read_points_toml, read_targets, write_lines
from tests.builders.targets import LINE, PHANTOM, POINT


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


# Quotes, escapes, control characters, other scripts, what ends a table, half a character.
NAMES = st.one_of(
    st.text(min_size=1, max_size=12),
    st.sampled_from(
        [
            '"',
            "\\",
            "''",
            "[[line]]",
            "a\nb",
            "#",
            "\x00",
            "\x7f",
            "\u2028",
            "Nadel \u00e4",
            "\U0001f489",
            "= 1",
        ]
    ),
)
PLACES = st.lists(st.floats(-1e8, 1e8), min_size=3, max_size=3).map(np.array)


def refused_for(kind, *others):
    """Lines of no length are no lines; the law is of those that are."""
    try:
        return kind(*others)
    except InputError:
        return None


@given(
    names=st.lists(NAMES, min_size=1, max_size=4, unique=True),
    frames=st.lists(NAMES, min_size=4, max_size=4),
    places=st.lists(PLACES, min_size=8, max_size=8),
    remarks=st.lists(
        st.text(st.characters(codec="utf-8", exclude_categories=["C", "Z"]), max_size=9), max_size=2
    ),
)
def test_targets_of_any_name_come_back_to_the_last_bit(tmp_path_factory, names, frames, places, remarks):
    path = tmp_path_factory.mktemp("toml") / "targets.toml"
    made = [
        refused_for(Line, name, frame, np.array(places[2 * i : 2 * i + 2]))
        for i, (name, frame) in enumerate(zip(names, frames, strict=False))
    ]
    lines = [line for line in made if line is not None]
    points = [Point(name, frame, place) for name, frame, place in zip(names, frames, places, strict=False)]
    path.write_bytes(lines_toml("targets.toml", lines, points, remarks))
    again = read_targets(path)
    assert [(x.name, x.frame) for x in again.lines] == [(x.name, x.frame) for x in lines]
    assert [(x.name, x.frame) for x in again.points] == [(x.name, x.frame) for x in points]
    assert b"".join(x.segment_mm.tobytes() for x in again.lines) == b"".join(
        x.segment_mm.tobytes() for x in lines
    )
    assert b"".join(x.place_mm.tobytes() for x in again.points) == b"".join(
        x.place_mm.tobytes() for x in points
    )
    if lines:
        assert [x.name for x in read_lines(path)[0]] == [x.name for x in lines]
    assert [x.name for x in read_points_toml(path)] == [x.name for x in points]


@given(
    order=st.permutations([LINE, LINE.replace('"n"', '"m"'), POINT]),
    mark=st.booleans(),
    windows=st.booleans(),
)
def test_order_mark_and_line_ends_mean_nothing(tmp_path_factory, order, mark, windows):
    path = tmp_path_factory.mktemp("toml") / "a.toml"
    text = "\n".join(["# mm", *order]).encode()
    path.write_bytes(b"\xef\xbb\xbf" * mark + (text.replace(b"\n", b"\r\n") if windows else text))
    found = read_targets(path)
    assert {line.name for line in found.lines} == {"n", "m"}
    assert [point.name for point in found.points] == ["tip"]


@pytest.mark.parametrize(
    "make", [lambda name: Line(name, "Needle", np.eye(3)[:2]), lambda name: Point(name, "N", [1, 2, 3])]
)
def test_names_that_cannot_be_written_are_refused_at_once(make):
    with pytest.raises(InputError, match="is not Unicode text; name it otherwise"):
        make("\udcff")
    with pytest.raises(InputError, match="needs a name and the frame"):
        make("")


@pytest.mark.parametrize("place", [[1, 2], [1, 2, np.nan], [[1, 2, 3]], [np.inf, 0, 0]])
def test_a_point_has_three_finite_numbers(place):
    with pytest.raises(InputError, match="point 'tip': needs a place of three finite numbers, mm"):
        Point("tip", "Stylus", np.array(place))


@given(text=st.text(max_size=60))
def test_any_text_is_targets_or_a_sentence(tmp_path_factory, text):
    path = tmp_path_factory.mktemp("toml") / "a.toml"
    path.write_bytes((LINE + text).encode("utf-8", "ignore"))
    try:
        assert read_targets(path).lines
    except InputError as error:
        assert str(error).startswith("a.toml")


def test_a_file_of_targets_is_known_by_its_content(tmp_path):
    """A device set and a file of needles under each other's names."""
    (tmp_path / "a.xml").write_text(LINE)
    (tmp_path / "a.toml").write_text(PHANTOM)
    assert read_lines(tmp_path / "a.xml")[0][0].frame == "Needle"
    assert read_lines(tmp_path / "a.toml")[0][0].frame == "Phantom"


PLANE = '[[plane]]\nname = "floor"\nframe = "Tracker"\n'


def test_planes_come_by_points_or_by_a_normal(tmp_path):
    path = tmp_path / "a.toml"
    path.write_text(
        PLANE
        + "through_mm = [[0, 0, 5], [200.0, 0, 5], [0, 200, 5]]\n"
        + PLANE.replace("floor", "wall")
        + "point_mm = [1, 2, 3]\nnormal = [2, 0, 0]\n"
    )
    found = read_targets(path)
    assert [plane.name for plane in found.planes] == ["floor", "wall"]
    assert found.lines == found.points == ()
    np.testing.assert_array_equal(found.planes[0].points_mm, [[0, 0, 5], [200, 0, 5], [0, 200, 5]])
    np.testing.assert_allclose(found.planes[1].points_mm[:, 0], 1.0)
    np.testing.assert_allclose(found.planes[1].points_mm.mean(axis=0), [1, 2, 3], atol=1e-12)
    (tmp_path / "b.toml").write_bytes(lines_toml("b.toml", (), planes=found.planes))
    again = read_targets(tmp_path / "b.toml").planes
    assert [plane.points_mm.tobytes() for plane in again] == [
        plane.points_mm.tobytes() for plane in found.planes
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (PLANE, "a.toml, plane table 1: lacks through_mm"),
        (PLANE + "normal = [0, 0, 1]", "a.toml, plane table 1: lacks point_mm"),
        (
            PLANE + "point_mm = [0, 0, 0]\nnormal = [0, 0, 0]",
            "a.toml, plane table 1: normal is (0, 0, 0); give the direction at right angles to the plane",
        ),
        (
            PLANE + "through_mm = [[0, 0, 0], [1, 1, 1]]",
            "a.toml, plane table 1: each of through_mm is three numbers",
        ),
        (
            PLANE + "through_mm = [[0, 0, 0], [1, 1, 1], [2, 2, 2]]",
            "a.toml, plane 'floor': has three points on one line; give three that span it",
        ),
        (2 * (PLANE + "point_mm = [0, 0, 0]\nnormal = [0, 0, 1]\n"), "a.toml: two planes are called 'floor'"),
    ],
)
def test_bad_planes_are_refused(tmp_path, text, says):
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError) as caught:
        read_targets(tmp_path / "a.toml")
    assert str(caught.value).startswith(says)
