"""Of any calibration: what is written reads back to the last bit, and says what to think of it."""

import io
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.existing.matrix import LPS_FROM_RAS
from sonocal.export.itk import itk_h5, itk_tfm
from sonocal.export.plus import plus_xml, put_into_device_set
from sonocal.export.slicer import slicer_h5, slicer_matrix, slicer_tfm
from sonocal.validation import give_verdict
from tests.builders.calibrations import calibration_with, parted_rows, slipped_rows, sound_calibration
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 10_000)
names = st.text("abcXYZ_09", min_size=1, max_size=8)
BARE = b"<PlusConfiguration version='2.1'><fCal/></PlusConfiguration>"


def numbers(content):
    """The 4 x 4 matrix of an ITK text transform."""
    (line,) = [line for line in content.decode().splitlines() if line.startswith("Parameters: ")]
    values = np.array([float(text) for text in line.split()[1:]])
    return np.vstack([np.column_stack([values[:9].reshape(3, 3), values[9:]]), [0, 0, 0, 1]])


def plus_matrix(content, image="Image", probe="Probe"):
    found = ElementTree.fromstring(content).findall(f".//Transform[@From='{image}'][@To='{probe}']")
    assert len(found) == 1
    return np.array([float(text) for text in found[0].get("Matrix").split()]).reshape(4, 4)


@given(seeds, names, names)
def test_numbers_read_back_to_the_last_bit(seed, image, probe):
    found = calibration_with(random_similarity(seed))
    matrix = found.probe_from_image.matrix
    np.testing.assert_array_equal(plus_matrix(plus_xml(found, image, probe), image, probe), matrix)
    np.testing.assert_array_equal(numbers(itk_tfm(found)), matrix)
    np.testing.assert_array_equal(numbers(slicer_tfm(found)), slicer_matrix(found.probe_from_image))


@given(seeds, names, names)
def test_a_device_set_holds_what_its_own_file_holds(seed, image, probe):
    if image == probe:
        return
    found = calibration_with(random_similarity(seed))
    there = put_into_device_set(found, BARE, "devices.xml", image, probe)
    np.testing.assert_array_equal(plus_matrix(there, image, probe), found.probe_from_image.matrix)
    assert give_verdict(found).remark.encode() in there


@given(seeds, seeds)
def test_putting_another_calibration_in_changes_the_numbers_alone(seed, other):
    first, second = (calibration_with(random_similarity(s)) for s in (seed, other))
    there = put_into_device_set(first, BARE, "devices.xml")
    again = put_into_device_set(second, there, "devices.xml")
    np.testing.assert_array_equal(plus_matrix(again), second.probe_from_image.matrix)
    start, end = there.index(b"<Transform"), there.index(b"/>", there.index(b"<Transform"))
    assert again.startswith(there[:start])
    assert again.endswith(there[end:])
    np.testing.assert_array_equal(plus_matrix(put_into_device_set(first, again, "d.xml")), plus_matrix(there))


@given(seeds)
def test_slicers_matrix_undone_is_the_calibration(seed):
    transform = random_similarity(seed)
    back = np.linalg.inv(LPS_FROM_RAS @ slicer_matrix(transform) @ LPS_FROM_RAS)
    np.testing.assert_allclose(back, transform.matrix, rtol=1e-9, atol=1e-9)


def calibrations():
    return [
        sound_calibration(),
        sc.calibrate(slipped_rows()),
        sc.calibrate(parted_rows(moved_mm=4.0), test_split="test"),
        sc.calibrate(parted_rows(count=40).select(np.arange(4))),
    ]


@pytest.mark.parametrize("which", range(4))
def test_every_file_that_has_comments_has_the_verdict(which):
    found = calibrations()[which]
    remark = give_verdict(found).remark
    for content in (itk_tfm(found), slicer_tfm(found)):
        assert [line for line in content.decode().splitlines() if "verdict" in line] == [f"# {remark}"]
    assert f"{remark} -->" in plus_xml(found).decode()
    assert f"{remark} -->" in put_into_device_set(found, BARE, "devices.xml").decode()
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    for content in (itk_h5(found), slicer_h5(found)):
        with h5py.File(io.BytesIO(content)) as file:
            assert file.attrs["verdict"] == remark


def test_a_frame_that_no_comment_can_name_is_refused():
    with pytest.raises(sc.InputError, match=r"devices\.xml: a frame's name must not hold '--'"):
        put_into_device_set(sound_calibration(), BARE, "devices.xml", "Im--age")
