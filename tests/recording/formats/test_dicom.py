"""DICOM, as one file and as many."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.recording.formats import read_recording
from tests.builders.pictures import dicom_file, images
from tests.builders.recordings import random_pixels
from tests.builders.tables import N


def test_multi_frame_dicom(tmp_path):
    pydicom = pytest.importorskip("pydicom", reason="pydicom is not installed")
    region = pydicom.Dataset()
    region.PhysicalUnitsXDirection = region.PhysicalUnitsYDirection = 3
    region.PhysicalDeltaX, region.PhysicalDeltaY = 0.02, 0.03
    pixels = images()
    dicom_file(
        tmp_path / "a.dcm",
        pixels,
        FrameTime="50",
        ContentTime="010203.5",
        SequenceOfUltrasoundRegions=[region],
    )
    recording = read_recording(tmp_path / "a.dcm")
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels)
    np.testing.assert_allclose(recording.times, 3723.5 + 0.05 * np.arange(N))
    assert recording.image.spacing_mm == pytest.approx((0.2, 0.3))


def test_dicom_files_are_ordered_by_their_time(tmp_path):
    pixels = images()
    for i in range(4):
        dicom_file(tmp_path / f"{3 - i}.dcm", pixels[i], AcquisitionTime=f"00000{i}.25")
    recording = read_recording(tmp_path)
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels[:4])
    np.testing.assert_allclose(recording.times, np.arange(4) + 0.25)


@given(
    dtype=st.sampled_from(["uint8", "uint16", "int16"]),
    colour=st.booleans(),
    n=st.integers(1, 4),
    size=st.tuples(st.integers(1, 5), st.integers(1, 5).map(lambda k: 2 * k)),
    seed=st.integers(0, 2**32),
)
def test_every_pixel_comes_back(tmp_path_factory, dtype, colour, n, size, seed):
    pytest.importorskip("pydicom", reason="pydicom is not installed")
    dtype = "uint8" if colour else dtype
    pixels = random_pixels(np.random.default_rng(seed), (n, *size, *((3,) if colour else ())), dtype)
    path = tmp_path_factory.mktemp("dicom") / "a.dcm"
    dicom_file(path, pixels, colour)
    recording = read_recording(path)
    frames = np.stack(list(recording.frames))
    assert (frames.dtype, frames.shape, frames.tobytes()) == (pixels.dtype, pixels.shape, pixels.tobytes())
    assert recording.image.size_px == size[::-1]


@given(steps=st.lists(st.integers(1, 500), min_size=N - 1, max_size=N - 1), start=st.integers(0, 86399))
def test_times_follow_the_vector_from_the_files_own(tmp_path_factory, steps, start):
    pytest.importorskip("pydicom", reason="pydicom is not installed")
    path = tmp_path_factory.mktemp("dicom") / "a.dcm"
    clock = f"{start // 3600:02d}{start // 60 % 60:02d}{start % 60:02d}"
    dicom_file(path, images(), ContentTime=clock, FrameTimeVector=[0, *steps])
    np.testing.assert_allclose(read_recording(path).times, start + np.cumsum([0, *steps]) / 1000, rtol=1e-12)


@given(st.permutations(range(4)))
def test_files_without_times_keep_the_order_of_their_names(tmp_path_factory, order):
    pytest.importorskip("pydicom", reason="pydicom is not installed")
    folder, pixels = tmp_path_factory.mktemp("dicom"), images()
    for i in order:  # written in any order
        dicom_file(folder / f"{i}.dcm", pixels[i])
    recording = read_recording(folder)
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels[:4])
    assert np.isnan(recording.times).all()
