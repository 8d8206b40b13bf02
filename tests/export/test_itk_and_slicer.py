import io

import numpy as np
import pytest

from sonocal.export import itk, slicer
from sonocal.geometry import AxisScaled
from tests.builders.calibrations import calibration_with
from tests.builders.similarities import random_similarity

WRITERS = {
    ".tfm": (itk.itk_tfm, slicer.slicer_tfm),
    ".h5": (itk.itk_h5, slicer.slicer_h5),
}
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0])


def transforms(seed):
    similarity = random_similarity(seed)
    return similarity, AxisScaled(
        similarity.rotation, similarity.translation, np.array([0.078, 0.074, 0.076])
    )


def written(content, suffix, tmp_path):
    sitk = pytest.importorskip("SimpleITK", reason="SimpleITK, the oracle of ITK's files, is not installed")
    if suffix == ".h5":
        pytest.importorskip("h5py", reason="h5py is not installed")
    path = tmp_path / f"a{suffix}"
    path.write_bytes(content)
    return sitk.ReadTransform(path)


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("seed", range(3))
def test_itk_maps_points_as_we_do(tmp_path, suffix, seed):
    points = np.random.default_rng(seed).uniform(-100, 900, (1000, 3))
    for probe_from_image in transforms(seed):
        theirs = written(WRITERS[suffix][0](calibration_with(probe_from_image)), suffix, tmp_path)
        mapped = np.array([theirs.TransformPoint(p) for p in points.tolist()])
        np.testing.assert_allclose(mapped, probe_from_image.apply(points), rtol=0, atol=1e-9)


@pytest.mark.parametrize("suffix", WRITERS)
@pytest.mark.parametrize("seed", range(3))
def test_slicers_form_maps_back(tmp_path, suffix, seed):
    """As Slicer reads it: the file's inverse, from LPS to its own RAS axes, is the transform to parent."""
    points = np.random.default_rng(seed).uniform(-100, 900, (1000, 3))
    for probe_from_image in transforms(seed):
        from_parent_lps = written(WRITERS[suffix][1](calibration_with(probe_from_image)), suffix, tmp_path)
        mapped = [
            from_parent_lps.TransformPoint(p)
            for p in (probe_from_image.apply(points) @ LPS_FROM_RAS).tolist()
        ]
        np.testing.assert_allclose(np.array(mapped) @ LPS_FROM_RAS, points, rtol=0, atol=1e-8)
        to_parent_lps = from_parent_lps.GetInverse()
        mapped = [to_parent_lps.TransformPoint(p) for p in (points @ LPS_FROM_RAS).tolist()]
        np.testing.assert_allclose(
            np.array(mapped) @ LPS_FROM_RAS, probe_from_image.apply(points), rtol=0, atol=1e-8
        )


def test_the_files_say_what_they_hold():
    found = calibration_with(random_similarity(0))
    assert b"to millimetres in the probe marker's frame" in itk.itk_tfm(found)
    assert b"this file holds its inverse in LPS" in slicer.slicer_tfm(found)
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    for content, words in (
        (itk.itk_h5(found), "the mm per px are inside the matrix"),
        (slicer.slicer_h5(found), "this file holds its inverse in LPS"),
    ):
        with h5py.File(io.BytesIO(content)) as file:
            assert words in file.attrs["convention"]
