"""A phantom whose place is unknown, in the file of its targets."""

import numpy as np
import pytest

from sonocal.errors import InputError
from sonocal.targets import Phantom, in_phantom, lines_toml, read_targets

WIRE = '[[line]]\nname = "a"\nframe = "Phantom"\nfrom_mm = [0, 0, 0]\nto_mm = [0, 40, 0]\n'
HEAD = '[phantom]\nframe = "Phantom"\nfixed_to = "Reference"\nplace = "unknown"\n'
SAID = "said = [[1, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\nsigma_mm = 0.2\n"


def read(tmp_path, text):
    path = tmp_path / "a.toml"
    path.write_text(text)
    return read_targets(path)


def test_its_targets_are_asked_for_together_and_written_again(tmp_path):
    other = WIRE.replace('"a"', '"b"').replace("Phantom", "Needle")
    found = read(tmp_path, WIRE + other + HEAD + SAID)
    assert [one.name for one in found.lines] == ["b"]
    (one,) = found.unplaced
    assert (one.kind, one.name, one.frame, one.spanning_mm) == ("line", "a", "Reference", None)
    np.testing.assert_array_equal(one.in_phantom_mm, [[0, 0, 0], [0, 40, 0]])
    assert (one.phantom.frame, one.phantom.sigma_mm) == ("Phantom", 0.2)
    again = read(tmp_path, lines_toml("a.toml", found.lines, unplaced=found.unplaced).decode()).unplaced[0]
    np.testing.assert_array_equal(again.in_phantom_mm, one.in_phantom_mm)
    np.testing.assert_array_equal(again.phantom.said, one.phantom.said)
    whole = in_phantom(found)
    assert [(one.name, one.frame) for one in whole.lines] == [("b", "Needle"), ("a", "Phantom")]
    assert whole.unplaced == ()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (HEAD.replace('fixed_to = "Reference"\n', ""), "a.toml, phantom: lacks fixed_to; it needs frame, fixed_to"),
        (HEAD.replace("unknown", "here"), "place is 'here'; write place = \"unknown\""),
        (HEAD + "size = 3\n", "has the unknown key 'size'"),
        (HEAD.replace('"Reference"', '"Phantom"'), "frame and fixed_to are both 'Phantom'"),
        (HEAD + "said = [[1, 0, 0, 5]]\n", "said is a rigid pose, four rows of four numbers"),
        (HEAD + "said = [[2, 0, 0, 5], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n", "said is a rigid pose"),
        (HEAD + 'said = "here"\n', "said is a rigid pose"),
        (HEAD + "sigma_mm = -1\n", "sigma_mm is a positive number; got -1"),
        (HEAD.replace('frame = "Phantom"', 'frame = "Block"'), "no target is in the phantom's frame 'Block'"),
        (HEAD.replace("[phantom]", "[[phantom]]"), "a file has one phantom; write it as [phantom]"),
        ('[[line]]\nname = "b"\nframe = "Phantom"\nplace = "unknown"\n' + HEAD, "has no place in the phantom"),
    ],
)  # fmt: skip
def test_what_means_nothing_is_refused(tmp_path, text, said):
    with pytest.raises(InputError) as refused:
        read(tmp_path, WIRE + text)
    assert said in str(refused.value)


def test_names_are_text():
    with pytest.raises(InputError, match="frame is the name of a frame"):
        Phantom("", "Reference")
