from xml.sax.saxutils import quoteattr

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, InputError
from sonocal.targets import (
    read_device_set,
    read_lines,
)
from tests.builders.recordings import random_poses
from tests.builders.targets import PHANTOM


def test_transforms_and_wires_of_a_real_device_set(data_folder):
    found = read_device_set(data_folder / "recordings" / "PlusDeviceSet_fCal_Sim_SpatialCalibration_1.2.xml")
    assert set(found.transforms) == {
        ("TransducerOriginPixel", "Image"),
        ("Reference", "Phantom"),
        ("Stylus", "StylusTip"),
    }
    assert found.transforms["Stylus", "StylusTip"][:3, 3].tolist() == [203.772, -12.283, 1.17469]
    assert [len(pattern) for pattern in found.patterns] == [3, 3, 3]
    assert found.wires[1].name == "2:I2_f2"
    assert found.wires[1].segment_mm.tolist() == [[40, 0, 10], [25, 40, 10]]


def test_the_older_form_is_read(data_folder):
    path = data_folder / "recordings" / "PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml"
    found = read_device_set(path)
    assert found.patterns == (("E3_e3", "F3_j3", "K3_k3"), ("E4_e4", "J4_f4", "K4_k4"))
    assert found.transforms["Probe", "Image"][0].tolist() == [-0.0094, -0.0739, -0.0028, -103.5322]
    assert found.transforms["PhantomReference", "Phantom"][2, 3] == -17.2


def test_lines_come_with_their_transforms(tmp_path):
    (tmp_path / "a.xml").write_text(PHANTOM)
    (line,), fixed = read_lines(tmp_path / "a.xml")
    assert (line.name, line.frame) == ("a", "Phantom")
    np.testing.assert_array_equal(fixed["Reference", "Phantom"][:3, 3], [5, 0, 0])


BOMB = '<!DOCTYPE x [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;&a;&a;">]>' + PHANTOM
OUTSIDE = '<!DOCTYPE x SYSTEM "file:///etc/passwd">' + PHANTOM
DECLARED = "a.xml: declares a document type or entities, which a device set never needs; delete them"


@pytest.mark.parametrize(
    ("text", "kind", "sentence"),
    [
        (BOMB, FormatError, DECLARED),
        (OUTSIDE, FormatError, DECLARED),
        ("<PlusConfiguration>", FormatError, "a.xml: is not XML (no element found: line 1, column 19)"),
        ("<a/>", InputError, "a.xml: its root is <a> where a PLUS device set has <PlusConfiguration>"),
        (
            PHANTOM.replace("1 0 0 5", "1 0 0"),
            InputError,
            "a.xml: Transform PhantomToReference needs a Matrix of 16 finite numbers; "
            "got '1 0 0  0 1 0 0  0 0 1 0  0 0 0 1'",
        ),
        (
            PHANTOM.replace("0 40 0", "0 40 inf"),
            InputError,
            "a.xml: wire 'a' needs EndPointFront and EndPointBack of three numbers, mm",
        ),
        (
            PHANTOM.replace("1 0 0 5", "0 0 0 5"),
            InputError,
            "a.xml: Transform PhantomToReference cannot be inverted, or its last row is not 0 0 0 1",
        ),
    ],
)
def test_bad_device_sets_are_refused(tmp_path, text, kind, sentence):
    (tmp_path / "a.xml").write_text(text)
    with pytest.raises(kind) as caught:
        read_device_set(tmp_path / "a.xml")
    assert str(caught.value) == sentence
    assert type(caught.value) is kind


NAMES = st.from_regex(r"[A-Z][A-Za-z0-9:_ <>&\"']{0,8}", fullmatch=True)
ROTATIONS = st.integers(0, 2**32).map(lambda seed: random_poses(np.random.default_rng(seed), 1)[0])
ENDS = st.lists(st.floats(-500, 500), min_size=6, max_size=6).map(lambda x: np.array(x).reshape(2, 3))


def words(numbers, between):
    return between.join(map(repr, np.asarray(numbers).ravel().tolist()))


@st.composite
def device_sets(draw):
    """What PLUS-like programs write: the order of attributes, blanks, comments and other elements are free."""
    transforms = draw(st.dictionaries(st.tuples(NAMES, NAMES), ROTATIONS, max_size=3))
    labels = draw(st.lists(NAMES, min_size=1, max_size=6, unique=True))
    wires = [(label, draw(ENDS.filter(lambda ends: not np.array_equal(*ends)))) for label in labels]
    blank = draw(st.sampled_from([" ", "  ", "\n\t", " \n "]))
    comment = draw(st.sampled_from(["", "<!-- Wire & Pattern -->", '<Device Id="Video" Rate="20"/>']))

    def element(tag, **attributes):
        pairs = draw(st.permutations(sorted(attributes.items())))
        return f"<{tag} {blank.join(f'{key}={quoteattr(text)}' for key, text in pairs)}/>"

    moves = [element("Transform", From=s, To=t, Matrix=words(m, blank)) for (t, s), m in transforms.items()]
    inside = [
        element("Wire", Name=n, Id=str(i), EndPointFront=words(e[0], blank), EndPointBack=words(e[1], blank))
        for i, (n, e) in enumerate(wires)
    ]
    old = draw(st.booleans())
    opened, closed = ("<NWire>", "</NWire>") if old else ('<Pattern Type="NWire">', "</Pattern>")
    patterns = [opened + blank.join(inside[i : i + 3]) + closed for i in range(0, len(inside), 3)]
    text = (
        f"<PlusConfiguration>{comment}<CoordinateDefinitions>{blank.join(moves)}</CoordinateDefinitions>"
        f"<PhantomDefinition>{comment}<Geometry>{''.join(patterns)}</Geometry></PhantomDefinition></PlusConfiguration>"
    )
    mark = draw(st.sampled_from(["", '<?xml version="1.0" encoding="utf-8"?>\n', "\ufeff"]))
    return transforms, wires, (mark + text).encode()


@given(device_sets())
def test_whatever_wrote_a_device_set_its_numbers_come_back(tmp_path_factory, made):
    transforms, wires, content = made
    path = tmp_path_factory.mktemp("devices") / "a.xml"
    path.write_bytes(content)
    found = read_device_set(path)
    assert found.transforms.keys() == transforms.keys()
    for key, matrix in transforms.items():
        assert found.transforms[key].tobytes() == matrix.tobytes()
    assert [wire.name for wire in found.wires] == [name for name, _ in wires]
    for wire, (_, ends) in zip(found.wires, wires, strict=True):
        assert wire.segment_mm.tobytes() == ends.tobytes()
        assert wire.frame == "Phantom"
    assert sum(found.patterns, ()) == tuple(name for name, _ in wires)
    assert all(len(pattern) <= 3 for pattern in found.patterns)


@given(st.sampled_from(["MyPhantom", "Block 2"]))
def test_wires_are_in_the_frame_that_the_phantom_is_said_to_have(tmp_path_factory, frame):
    path = tmp_path_factory.mktemp("devices") / "a.xml"
    said = f'<Algorithm PhantomCoordinateFrame="{frame}"/></PlusConfiguration>'
    path.write_text(PHANTOM.replace("</PlusConfiguration>", said))
    assert [wire.frame for wire in read_device_set(path).wires] == [frame]


def test_a_wire_named_twice_is_refused(tmp_path):
    wire = '<Wire Name="a" EndPointFront="0 0 0" EndPointBack="0 40 0" />'
    (tmp_path / "a.xml").write_text(PHANTOM.replace(wire, wire + wire))
    with pytest.raises(InputError, match=r"a\.xml: two lines are called 'a'; give each its own name"):
        read_device_set(tmp_path / "a.xml")


def test_a_device_set_without_wires_gives_no_lines(tmp_path):
    (tmp_path / "a.xml").write_text("<PlusConfiguration/>")
    assert read_device_set(tmp_path / "a.xml").wires == ()
    with pytest.raises(
        InputError, match="describes no phantom wires; name a device set with a PhantomDefinition"
    ):
        read_lines(tmp_path / "a.xml")


WIRE = '<Wire Name="a" EndPointFront="0 0 0" EndPointBack="0 40 0" />'
OTHER = '<Wire Name="b" EndPointFront="5 0 0" EndPointBack="5 40 0" />'


def in_patterns(*patterns):
    """A device set with these wires in each pattern."""
    whole = "".join(f'<Pattern Type="CoplanarParallelWires">{"".join(wires)}</Pattern>' for wires in patterns)
    return PHANTOM.replace(f'<Pattern Type="NWire">\n    {WIRE}\n  </Pattern>', whole)


@pytest.mark.parametrize(
    "again",
    [WIRE, '<Wire Name="a" EndPointFront="0 40 0" EndPointBack="0 0.0 0" />'],
    ids=["same", "turned round"],
)
def test_a_wire_that_two_patterns_share_is_one(tmp_path, again):
    (tmp_path / "a.xml").write_text(in_patterns((WIRE, OTHER), (again,)))
    found = read_device_set(tmp_path / "a.xml")
    assert [wire.name for wire in found.wires] == ["a", "b"]
    assert found.patterns == (("a", "b"), ("a",))
    lines, _ = read_lines(tmp_path / "a.xml")
    assert len(lines) == 2


def test_two_wires_of_one_name_in_two_patterns_are_refused(tmp_path):
    (tmp_path / "a.xml").write_text(in_patterns((WIRE,), (OTHER.replace('"b"', '"a"'),)))
    with pytest.raises(InputError, match=r"a\.xml: two lines are called 'a'; give each its own name"):
        read_device_set(tmp_path / "a.xml")
