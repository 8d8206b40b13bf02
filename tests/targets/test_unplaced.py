"""Targets whose place is unknown, or known roughly, in their file."""

import numpy as np
import pytest

from sonocal.errors import InputError
from sonocal.targets import Line, Unplaced, lines_toml, read_lines, read_targets

NAMES = 'name = "thread"\nframe = "Tracker"\n'
ROUGH = f"[[line]]\n{NAMES}from_mm = [0, 0, 0]\nto_mm = [0, 0, 200]\n"


def read(tmp_path, text):
    path = tmp_path / "a.toml"
    path.write_text(text)
    return read_targets(path)


@pytest.mark.parametrize("kind", ["point", "line", "plane"])
def test_a_place_that_nobody_knows_is_read_and_written(tmp_path, kind):
    found = read(tmp_path, f'[[{kind}]]\n{NAMES}place = "unknown"\n')
    assert (found.lines, found.points, found.planes) == ((), (), ())
    (one,) = found.unplaced
    assert (one.kind, one.name, one.frame, one.spanning_mm) == (kind, "thread", "Tracker", None)
    again = read(tmp_path, lines_toml("a.toml", (), unplaced=found.unplaced).decode()).unplaced[0]
    assert (again.kind, again.name, again.frame, again.spanning_mm) == (kind, "thread", "Tracker", None)


def test_a_rough_place_is_off_by_its_sigma_and_turned_by_what_that_does_to_its_ends(tmp_path):
    (one,) = read(tmp_path, ROUGH + "sigma_mm = 2\n").unplaced
    np.testing.assert_array_equal(one.spanning_mm, [[0, 0, 0], [0, 0, 200]])
    assert one.sigma_mm == 2
    assert one.sigma_deg == pytest.approx(np.rad2deg(np.arctan(2 / (100 * np.sqrt(2)))))
    (told,) = read(tmp_path, ROUGH + "sigma_mm = 2\nsigma_deg = 1\n").unplaced
    assert told.sigma_deg == 1
    (again,) = read(tmp_path, lines_toml("a.toml", (), unplaced=(told,)).decode()).unplaced
    np.testing.assert_array_equal(again.spanning_mm, told.spanning_mm)
    assert (again.sigma_mm, again.sigma_deg) == (2, 1)


def test_known_and_unknown_stand_in_one_file_and_lines_alone_are_the_known_ones(tmp_path):
    text = ROUGH.replace("thread", "needle") + f'[[line]]\n{NAMES}place = "unknown"\n'
    found = read(tmp_path, text)
    assert [line.name for line in found.lines] == ["needle"]
    assert [one.name for one in found.unplaced] == ["thread"]
    assert [line.name for line in read_lines(tmp_path / "a.toml")[0]] == ["needle"]
    read(tmp_path, f'[[line]]\n{NAMES}place = "unknown"\n')
    with pytest.raises(InputError, match="no \\[\\[line\\]\\] whose place is known"):
        read_lines(tmp_path / "a.toml")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f'[[line]]\n{NAMES}place = "here"\n', "line table 1: place is 'here'; write place = \"unknown\""),
        (f'[[line]]\n{NAMES}place = "unknown"\nfrom_mm = [0, 0, 0]\n', "unknown key 'from_mm'"),
        ('[[plane]]\nname = "a"\nplace = "unknown"\n', "plane table 1: lacks frame"),
        ('[[point]]\nname = ""\nframe = "T"\nplace = "unknown"\n', "a.toml, point table 1: point ''"),
        (ROUGH + "sigma_deg = 2\n", "lacks sigma_mm"),
        (ROUGH + "sigma_mm = -2\n", "sigma_mm is a positive number; got -2"),
        (ROUGH + "sigma_mm = true\n", "sigma_mm is a positive number; got True"),
        (ROUGH + "sigma_mm = 1\nsigma_deg = inf\n", "sigma_deg is a positive number; got inf"),
        (f"[[line]]\n{NAMES}sigma_mm = 1\n", "lacks from_mm, to_mm"),
    ],
)  # fmt: skip
def test_what_means_nothing_is_refused_by_table_and_key(tmp_path, text, said):
    with pytest.raises(InputError) as refused:
        read(tmp_path, text)
    assert said in str(refused.value)
    assert str(refused.value).startswith("a.toml, ")
    assert str(refused.value).count("a.toml") == 1


def test_an_unplaced_target_checks_itself():
    with pytest.raises(InputError, match="its kind is 'wire'"):
        Unplaced("wire", "a", "b")
    with pytest.raises(InputError, match="is spanned by 2 x 3 numbers"):
        Unplaced("line", "a", "b", np.zeros((3, 3)), 1.0, 1.0)
    with pytest.raises(InputError, match="sigma_mm must be a positive number; got inf"):
        Unplaced("line", "a", "b", np.eye(3)[:2])
    assert isinstance(Unplaced("line", "a", "b"), Unplaced)
    assert not isinstance(Unplaced("line", "a", "b"), Line)
