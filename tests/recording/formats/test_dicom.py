"""DICOM, as one file and as many."""

import numpy as np
import pytest

from sonocal.recording.formats import read_recording
from tests.builders.pictures import dicom_file, images
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
