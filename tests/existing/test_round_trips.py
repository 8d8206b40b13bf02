"""Of any calibration: what we export is read back, and other programs' own files are read as they read them."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.existing import Choice, read_existing
from sonocal.existing.matrix import affine_inverse, slicer_form
from sonocal.export.itk import itk_h5, itk_tfm
from sonocal.export.plus import plus_xml, put_into_device_set
from sonocal.export.slicer import slicer_h5, slicer_tfm
from sonocal.geometry import AxisScaled
from tests.builders.calibrations import calibration_with
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 10_000)
scales = st.floats(0.02, 1.4)
WRITERS = {
    "plus.xml": plus_xml,
    "itk.tfm": itk_tfm,
    "itk.h5": itk_h5,
    "slicer.tfm": slicer_tfm,
    "slicer.h5": slicer_h5,
}


def image_like(seed, scale, stretch=1.0):
    """A similarity, or a stretched one, as a scanner's image has it."""
    one = random_similarity(seed)
    return AxisScaled(one.rotation, one.translation, scale * np.array([1.0, stretch, np.sqrt(stretch)]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("existing")


@pytest.mark.parametrize("name", WRITERS)
@given(seed=seeds, scale=scales, stretch=st.floats(0.8, 1.25))
def test_our_exports_read_back(folder, name, seed, scale, stretch):
    """Whatever the scale, since they say which way they go."""
    if name.endswith(".h5"):
        pytest.importorskip("h5py", reason="h5py is not installed")
    found = calibration_with(image_like(seed, scale, stretch))
    (folder / name).write_bytes(WRITERS[name](found))
    back = read_existing(folder / name)
    np.testing.assert_allclose(back.matrix, found.probe_from_image.matrix, rtol=0, atol=1e-12)
    assert back.notes == ()
    assert back.probe_from_image.scales == pytest.approx(found.probe_from_image.scales, rel=1e-12)


@pytest.mark.parametrize("name", WRITERS)
@given(seed=seeds, scale=scales)
def test_what_was_read_is_exported_again_and_is_the_same(folder, name, seed, scale):
    if name.endswith(".h5"):
        pytest.importorskip("h5py", reason="h5py is not installed")
    (folder / "first.xml").write_bytes(plus_xml(calibration_with(image_like(seed, scale))))
    first = read_existing(folder / "first.xml")
    (folder / name).write_bytes(WRITERS[name](first))
    np.testing.assert_allclose(read_existing(folder / name).matrix, first.matrix, rtol=0, atol=1e-12)


@given(seed=seeds, scale=scales)
def test_slicers_form_is_its_own_inverse(seed, scale):
    matrix = image_like(seed, scale).matrix
    np.testing.assert_allclose(slicer_form(slicer_form(matrix)), matrix, rtol=0, atol=1e-12)
    np.testing.assert_allclose(affine_inverse(matrix) @ matrix, np.eye(4), rtol=0, atol=1e-9)


def test_the_error_of_another_matrix_does_not_stay_in_a_device_set(folder):
    ours = plus_xml(calibration_with(random_similarity(0)))
    (folder / "bare.txt").write_text("0.2 0 0 1\n0 0.2 0 2\n0 0 0.2 3\n0 0 0 1\n")
    bare = read_existing(folder / "bare.txt")
    (folder / "into.xml").write_bytes(put_into_device_set(bare, ours, "into.xml"))
    back = read_existing(folder / "into.xml")
    np.testing.assert_array_equal(back.matrix, bare.matrix)
    assert back.stated_error_mm is None


NOTATIONS = {
    "blanks": lambda m: "\n".join(" ".join(map(repr, row)) for row in m),
    "one line": lambda m: " ".join(repr(x) for row in m for x in row),
    "commas": lambda m: "\n".join(",".join(map(repr, row)) for row in m),
    "tabs and a remark": lambda m: "% mm\n" + "\n".join("\t".join(map(repr, row)) for row in m),
    "matlab": lambda m: "T = [" + "; ".join(", ".join(map(repr, row)) for row in m) + "];",
    "json": json.dumps,
    "json, indented": lambda m: json.dumps(m, indent=2),
    "python": lambda m: f"ImageToProbe = np.array({m!r})",
    "numpy": lambda m: f"array({m!r})",
    "decimal commas": lambda m: "\n".join(" ".join(map(repr, row)).replace(".", ",") for row in m),
    "decimal commas and whole numbers": lambda m: "\n".join(
        " ".join(f"{x:g}" if x == round(x) else repr(x).replace(".", ",") for x in row) for row in m
    ),
    "decimal commas, semicolons": lambda m: "\n".join(
        ";".join(map(repr, row)).replace(".", ",") for row in m
    ),
    "exponents": lambda m: "\n".join(" ".join(f"{x:.17e}" for x in row) for row in m),
    "windows": lambda m: "\ufeff" + "\r\n".join(" ".join(map(repr, row)) for row in m) + "\r\n",
}


@pytest.mark.parametrize("notation", NOTATIONS)
@given(seed=seeds, scale=scales)
def test_a_matrix_in_any_notation_is_read_to_the_last_bit(folder, notation, seed, scale):
    matrix = image_like(seed, scale).matrix
    (folder / "matrix.txt").write_bytes(NOTATIONS[notation](matrix.tolist()).encode())
    back = read_existing(folder / "matrix.txt")
    np.testing.assert_array_equal(back.matrix, matrix)
    assert back.notes == ()
    (folder / "matrix.txt").write_bytes(NOTATIONS[notation](matrix.T.tolist()).encode())
    turned = read_existing(folder / "matrix.txt")
    np.testing.assert_array_equal(turned.matrix, matrix)
    assert [note.code for note in turned.notes] == ["transposed-matrix"]


@given(seed=seeds, scale=scales, order=st.sampled_from("CF"), kind=st.sampled_from(["<f8", ">f8"]))
def test_numpys_files_are_read_to_the_last_bit(folder, seed, scale, order, kind):
    matrix = image_like(seed, scale).matrix
    stored = np.array(matrix, dtype=kind, order=order)
    np.save(folder / "a.npy", stored)
    np.savez(folder / "b.npz", stored)
    np.savez_compressed(folder / "c.npz", ImageToProbe=stored, ProbeToTracker=np.eye(4), t=np.arange(3))
    np.savez(folder / "d.npz", image_from_probe=np.linalg.inv(matrix))
    for name in ("a.npy", "b.npz", "c.npz"):
        np.testing.assert_array_equal(read_existing(folder / name).matrix, matrix)
    back = read_existing(folder / "d.npz")
    assert back.transform == "probe_from_image"
    np.testing.assert_allclose(back.matrix, matrix, rtol=0, atol=1e-9)


@given(seed=seeds, scale=st.floats(0.02, 0.99), centre=st.booleans())
def test_what_simpleitk_writes_is_read_as_it_maps_points(folder, seed, scale, centre):
    """Its own file says nothing of which way it goes; below 1 mm/px the scale does."""
    sitk = pytest.importorskip("SimpleITK", reason="SimpleITK, the oracle of ITK's files, is not installed")
    matrix = image_like(seed, scale).matrix
    theirs = sitk.AffineTransform(3)
    theirs.SetMatrix(matrix[:3, :3].ravel().tolist())
    theirs.SetTranslation(matrix[:3, 3].tolist())
    if centre:
        theirs.SetCenter((310.0, -12.5, 40.0))
    points = np.random.default_rng(seed).uniform(-100, 900, (20, 3))
    mapped = np.array([theirs.TransformPoint(point) for point in points.tolist()])
    suffixes = [".tfm"]
    try:
        import h5py  # noqa: F401 - whether it is there
    except ImportError:
        pass
    else:
        suffixes.append(".h5")
    for suffix in suffixes:
        path = folder / f"sitk{suffix}"
        sitk.WriteTransform(theirs, str(path))
        back = read_existing(path)
        np.testing.assert_allclose(back.probe_from_image.apply(points), mapped, rtol=0, atol=1e-9)
        assert [note.code for note in back.notes] == ["direction-by-scale"]
        # The same as 3D Slicer saves it: the inverse, in LPS.
        other = sitk.AffineTransform(3)
        held = slicer_form(matrix)
        other.SetMatrix(held[:3, :3].ravel().tolist())
        other.SetTranslation(held[:3, 3].tolist())
        sitk.WriteTransform(other, str(path))
        back = read_existing(path)
        np.testing.assert_allclose(back.matrix, matrix, rtol=1e-9, atol=1e-9)
        assert "as 3D Slicer stores transforms" in back.notes[0].message
        direct = read_existing(path, Choice(stored_as="direct"))
        np.testing.assert_allclose(direct.matrix, held, rtol=1e-12, atol=1e-9)


@given(seed=seeds, scale=scales)
def test_a_chain_of_transforms_is_the_product(folder, seed, scale):
    whole = image_like(seed, scale).matrix
    pixels = np.diag([1.0, 1.0, 1.0, 1.0])
    pixels[:3, 3] = -410, 5, 0
    parts = {
        ("Image", "TransducerOriginPixel"): pixels,
        ("Probe", "TransducerOriginPixel"): pixels @ np.linalg.inv(whole),
        ("StylusTip", "Stylus"): np.eye(4),
    }
    rows = "".join(
        f'<Transform From="{a}" To="{b}" Matrix="{" ".join(repr(float(x)) for x in m.ravel())}"/>'
        for (a, b), m in parts.items()
    )
    text = f"<PlusConfiguration><CoordinateDefinitions>{rows}</CoordinateDefinitions></PlusConfiguration>"
    (folder / "chain.xml").write_text(text)
    back = read_existing(folder / "chain.xml")
    assert back.transform == "ImageToProbe"
    np.testing.assert_allclose(back.matrix, whole, rtol=1e-9, atol=1e-8)
    asked = read_existing(folder / "chain.xml", Choice("ProbeToImage", "inverse"))
    np.testing.assert_allclose(asked.matrix, whole, rtol=1e-9, atol=1e-8)


def test_plus_own_matrices_are_read_with_what_it_says_of_them(data_folder):
    path = data_folder / "recordings" / "PlusDeviceSet_NwirePhantomFreehand_vtkVolumeReconstructorTest2.xml"
    found = read_existing(path)
    assert (found.transform, found.stated_error_mm, found.date) == (
        "ImageToProbe",
        0.508027,
        "2011.08.19 14:11:53",
    )
    assert found.matrix[0].tolist() == [-0.0094, -0.0739, -0.0028, -103.5322]
    with pytest.raises(
        sc.InputError, match="has no transform from an image to a marker, such as ImageToProbe; it has "
    ):
        read_existing(data_folder / "recordings" / "PlusDeviceSet_fCal_Sim_SpatialCalibration_1.2.xml")
