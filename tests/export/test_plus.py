from functools import lru_cache
from xml.etree import ElementTree

import numpy as np
import pytest

import sonocal as sc
from sonocal.export.plus import plus_xml, put_into_device_set
from sonocal.simulation.scene import simulate_observations
from sonocal.targets import read_device_set

OLD = '<Transform From="Image" To="Probe" Matrix="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1" Error="9" Date="010203_040506" />'
DEVICES = f"""<?xml version="1.0" encoding="UTF-8"?>
<!-- Größe > 3 & so on -->
<PlusConfiguration version="2.1">
  <DataCollection StartupDelaySec="1.0">
    <Device Id="Tracker" Note="a &gt; b > c" ><Transform From="Image" To="Probe"/></Device>
  </DataCollection>
  <CoordinateDefinitions>
    <Transform From="Phantom" To="Reference"
      Matrix="
        1 0 0 10
        0 1 0 20
        0 0 1 30
        0 0 0 1" Error="0.5" Date="091112_150000" />
    {OLD}
  </CoordinateDefinitions>
  <fCal/>
</PlusConfiguration>
"""
WITHOUT = DEVICES.replace(f"    {OLD}\n", "")
EMPTY = (
    DEVICES[: DEVICES.index("  <CoordinateDefinitions>")]
    + "  <CoordinateDefinitions Kind='a>b'/>\n</PlusConfiguration>"
)
BARE = "<PlusConfiguration version='2.1'><fCal/></PlusConfiguration>"

REPLACED = {
    "plain": DEVICES,
    "windows": DEVICES.replace("\n", "\r\n"),
    "byte order mark": "\ufeff" + DEVICES,
    "quotes": DEVICES.replace(OLD, OLD.replace('"', "'").replace("To=", "\n\t To = ")),
    "no matrix": DEVICES.replace(OLD, '<Transform From="Image" To="Probe"/>'),
    "attribute like it": DEVICES.replace("Error=", 'OldMatrix="1 2" Error='),
}
ADDED = {
    "added": WITHOUT,
    "tabs": WITHOUT.replace("    ", "\t\t").replace("  ", "\t"),
    "windows": WITHOUT.replace("\n", "\r\n"),
    "empty definitions": EMPTY,
    "no definitions": BARE,
    "nothing": "<PlusConfiguration/>",
    "one line": "<PlusConfiguration><CoordinateDefinitions></CoordinateDefinitions></PlusConfiguration>",
}


@lru_cache
def calibration(dimension=2):
    return sc.calibrate(simulate_observations(dimension, 20, seed=1).observations)


def matrix_in(content, path, image="Image", probe="Probe"):
    path.write_bytes(content)
    return read_device_set(path).transforms[probe, image]


@pytest.mark.parametrize("dimension", [2, 3])
def test_image_to_probe_equals_the_calibration_to_the_last_bit(dimension):
    found = calibration(dimension)
    transforms = ElementTree.fromstring(plus_xml(found)).findall("CoordinateDefinitions/Transform")
    assert [(t.get("From"), t.get("To")) for t in transforms] == [("Image", "Probe")]
    numbers = np.array([float(x) for x in transforms[0].get("Matrix").split()]).reshape(4, 4)
    np.testing.assert_array_equal(numbers, found.probe_from_image.matrix)
    assert float(transforms[0].get("Error")) == pytest.approx(found.fit.rms_mm, rel=1e-5)
    assert b"maps pixels to millimetres" in plus_xml(found)


@pytest.mark.parametrize("text", REPLACED.values(), ids=REPLACED)
def test_a_transform_that_stands_there_alone_changes(tmp_path, text):
    before = text.encode()
    after = put_into_device_set(calibration(), before, "a.xml")
    np.testing.assert_array_equal(matrix_in(after, tmp_path / "a.xml"), calibration().probe_from_image.matrix)
    # The tag is one piece of both files; what stands before and behind it is the same bytes.
    start = before.index(b"<Transform From", before.index(b"</DataCollection>"))
    start = before.index(b"<Transform From", start + 1)
    end = before.index(b"/>", start) + 2
    assert after[:start] == before[:start]
    assert after.endswith(before[end:])
    tag = after[start : len(after) - len(before[end:])]
    assert tag.count(b"<") == 1
    old = ElementTree.fromstring(before[start:end])
    new = ElementTree.fromstring(tag)
    assert set(new.attrib) == set(old.attrib) | {"Matrix"}
    kept = set(old.attrib) - {"Matrix", "Error", "Date"}
    assert {key: new.get(key) for key in kept} == {key: old.get(key) for key in kept}


@pytest.mark.parametrize("text", ADDED.values(), ids=ADDED)
def test_a_transform_that_is_missing_is_added_and_nothing_else_touched(tmp_path, text):
    before = text.encode()
    after = put_into_device_set(calibration(), before, "a.xml")
    np.testing.assert_array_equal(matrix_in(after, tmp_path / "a.xml"), calibration().probe_from_image.matrix)
    # What was added is one piece: before and behind it stand all of the old bytes, but for the slash of an empty tag.
    kept = common_start(before, after) + common_start(before[::-1], after[::-1])
    assert kept >= len(before) - (text.endswith(("'/>\n</PlusConfiguration>", "<PlusConfiguration/>")))
    assert b"maps pixels to millimetres" in after
    assert after.count(b"\n") == after.count(b"\r\n") or b"\r\n" not in before


def common_start(a, b):
    return next((i for i, (x, y) in enumerate(zip(a, b, strict=False)) if x != y), min(len(a), len(b)))


def test_the_added_transform_is_indented_as_its_neighbours():
    lines = put_into_device_set(calibration(), WITHOUT.encode(), "a.xml").decode().splitlines()
    place = next(i for i, line in enumerate(lines) if 'To="Probe" Matrix' in line)
    assert lines[place].startswith("    <Transform From=")
    assert lines[place - 1].startswith("    <!-- ImageToProbe maps pixels")
    assert lines[place + 1] == "  </CoordinateDefinitions>"


@pytest.mark.parametrize(
    "name", ["fCal_Sim_SpatialCalibration_1.2", "NwirePhantomFreehand_vtkVolumeReconstructorTest2"]
)
def test_real_device_sets_keep_their_bytes_and_read_the_same(data_folder, tmp_path, name):
    path = data_folder / "recordings" / f"PlusDeviceSet_{name}.xml"
    before, old = path.read_bytes(), read_device_set(path)
    after = put_into_device_set(calibration(), before, path.name)
    (tmp_path / "a.xml").write_bytes(after)
    new = read_device_set(tmp_path / "a.xml")
    assert new.transforms.keys() == old.transforms.keys() | {("Probe", "Image")}
    for key, matrix in new.transforms.items():
        expected = calibration().probe_from_image.matrix if key == ("Probe", "Image") else old.transforms[key]
        np.testing.assert_array_equal(matrix, expected)
    assert [wire.name for wire in new.wires] == [wire.name for wire in old.wires]
    # Put in again, only the date may differ.
    again = put_into_device_set(calibration(), after, path.name)
    assert len(again) == len(after)
    start = common_start(before, after)
    end = common_start(before[::-1], after[::-1])
    assert b"<" not in before[start : len(before) - end]


def test_frames_may_have_other_names(tmp_path):
    content = put_into_device_set(calibration(), DEVICES.encode(), "a.xml", "Image_2D", "L14")
    matrix = matrix_in(content, tmp_path / "a.xml", "Image_2D", "L14")
    np.testing.assert_array_equal(matrix, calibration().probe_from_image.matrix)
    assert OLD.encode() in content
    assert b"L14" in plus_xml(calibration(), "Image", "L14")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"<a>", "a.xml: is not XML (no element found: line 1, column 3)"),
        (b"<a/>", "a.xml: its root is <a> where a PLUS device set has <PlusConfiguration>"),
        (
            DEVICES.replace(OLD, OLD + OLD).encode(),
            "a.xml: defines ImageToProbe 2 times; delete all but one",
        ),
        (
            DEVICES.replace(
                OLD, OLD.replace("Image", "x").replace("Probe", "Image").replace("x", "Probe")
            ).encode(),
            "a.xml: leads from Image to Probe by other transforms already; PLUS allows one way between two frames, "
            "so delete one of them",
        ),
        (
            DEVICES.replace(
                OLD, OLD.replace("Image", "Phantom") + OLD.replace("Probe", "Reference")
            ).encode(),
            "a.xml: leads from Image to Probe by other transforms already; PLUS allows one way between two frames, "
            "so delete one of them",
        ),
        (
            b'<!DOCTYPE a [<!ENTITY b "c">]><PlusConfiguration/>',
            "a.xml: declares a document type or entities, which a device set never needs; delete them",
        ),
        (DEVICES.encode("latin-1"), "a.xml: byte 46 is not UTF-8; save the device set as UTF-8"),
        (DEVICES.encode("utf-16"), "a.xml: byte 0 is not UTF-8; save the device set as UTF-8"),
        (
            DEVICES.replace("UTF-8", "klingon").encode(),
            "a.xml: says that its encoding is 'klingon'; save the device set as UTF-8 and say so in its first line",
        ),
        (
            DEVICES.replace("UTF-8", "iso-8859-1").encode(),
            "a.xml: says that its encoding is 'iso-8859-1'; save the device set as UTF-8 and say so in its first line",
        ),
        (
            b"<a>" * 200_000 + b"</a>" * 200_000,
            "a.xml: has elements more than 100 deep, which no device set has",
        ),
    ],
)
def test_what_is_no_device_set_is_refused(content, sentence, tmp_path):
    with pytest.raises(sc.InputError) as caught:
        put_into_device_set(calibration(), content, "a.xml")
    assert str(caught.value) == sentence
    if not isinstance(caught.value, sc.FormatError):
        return  # what it says of the transform is no matter of who only reads
    (tmp_path / "a.xml").write_bytes(content)
    with pytest.raises(sc.FormatError) as read:
        read_device_set(tmp_path / "a.xml")
    assert str(read.value) == sentence


def test_ascii_may_be_called_by_the_name_of_what_has_it(tmp_path):
    ascii_only = DEVICES.encode("ascii", "replace").replace(b"UTF-8", b"windows-1252")
    (tmp_path / "a.xml").write_bytes(ascii_only)
    assert read_device_set(tmp_path / "a.xml").transforms
    assert b"windows-1252" in put_into_device_set(calibration(), ascii_only, "a.xml")
