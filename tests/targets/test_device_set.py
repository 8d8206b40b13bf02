import numpy as np
import pytest

from sonocal import FormatError, InputError
from sonocal.targets import (
    read_device_set,
    read_lines,
)
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
