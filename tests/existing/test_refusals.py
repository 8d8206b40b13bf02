"""Files that hold no calibration: one sentence each, that says what the file is or lacks."""

import io
import pickle
import sys

import numpy as np
import pytest

import sonocal as sc
from sonocal.existing import Choice, matrices_in, read_existing
from tests.builders.sound import TFM

GOOD = "0 0.2 0 10\n0 0 -0.2 -20\n-0.2 0 0 30\n"


def plus(*transforms):
    rows = "".join(f'<Transform From="{a}" To="{b}" Matrix="{m}"/>' for a, b, m in transforms)
    return f"<PlusConfiguration><CoordinateDefinitions>{rows}</CoordinateDefinitions></PlusConfiguration>".encode()


def npy(value, **how):
    content = io.BytesIO()
    np.save(content, value, **how)
    return content.getvalue()


def npz(**arrays):
    content = io.BytesIO()
    np.savez(content, **arrays)
    return content.getvalue()


FLAT = GOOD + "0 0 0 1"
UNIT = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"
CASES = {
    "fifteen.txt": (
        (GOOD + "0 0 0").encode(),
        "a matrix from px to mm has 16 numbers, 4 rows of 4; got 15 numbers",
    ),
    "prose.txt": (b"the calibration is in the other file\n", "has 16 numbers, 4 rows of 4; got 7 words"),
    "words.txt": ((GOOD + "0 0 zero 1").encode(), "'zero' is no number; write 4 rows of 4 numbers"),
    "projection.txt": (
        (GOOD + "0 0 1 1").encode(),
        "the last row of a matrix from px to mm is 0 0 0 1; got 0 0 1 1",
    ),
    "infinite.txt": (
        FLAT.replace("10", "inf").encode(),
        "a number of its matrix is not finite, or too large",
    ),
    "flat.txt": (
        b"1 0 0 0\n0 1 0 0\n0 0 0 0\n0 0 0 1",
        "cannot be inverted: it maps an image to a line, or has a column",
    ),
    "long.txt": (b"1 " * 40_000, "holds 80000 bytes, more than the 65536 of a 4 x 4 matrix"),
    "empty.txt": (b"", "is empty; export it again"),
    "page.txt": (
        b"<!DOCTYPE html><html></html>",
        "is a web page (HTML), whatever its name says, and holds no matrix",
    ),
    "none.xml": (plus(), "has no Transform in its CoordinateDefinitions"),
    "other.xml": (
        plus(("Phantom", "Reference", UNIT)),
        "no transform from an image to a marker, such as ImageToProbe; it has PhantomToReference",
    ),
    "pixels.xml": (
        plus(("Image", "TransducerOriginPixel", UNIT)),
        "has no transform from an image to a marker",
    ),
    "two.xml": (
        plus(("Image", "Probe", UNIT), ("Image2", "Probe2", UNIT)),
        "has several matrices that may be the calibration: ImageToProbe, Image2ToProbe2; name one with --transform",
    ),
    "twice.xml": (
        plus(("Image", "Probe", UNIT), ("Image", "Probe", UNIT.replace("1 0 0 0", "1 0 0 5", 1))),
        "defines ImageToProbe twice, differently; delete all but one",
    ),
    "transposed.xml": (
        plus(("Image", "Probe", "1 0 0 0 0 1 0 0 0 0 1 0 5 6 7 1")),
        "Transform ImageToProbe is transposed: its last column is 0 0 0 1",
    ),
    "bspline.tfm": (
        TFM.replace(b"Affine", b"BSpline"),
        "holds a transform of the kind 'BSplineTransform_double_3_3'",
    ),
    "flat.tfm": (TFM.replace(b"3_3", b"2_2"), "a calibration is an affine transform in three dimensions"),
    "short.tfm": (
        TFM.replace(b" 30.5", b""),
        "an affine transform has 12 parameters and 3 fixed ones; got 11 and 3",
    ),
    "words.tfm": (
        TFM.replace(b"30.5", b"far"),
        "line 4: parameters are numbers; got '0 0.2 0 0 0 -0.2 -0.2 0 0 10 -20 far'",
    ),
    "none.tfm": (TFM.split(b"Transform:")[0], "holds no transform; export it again"),
    "two.tfm": (
        TFM + TFM.split(b"\n", 1)[1],
        "has several matrices that may be the calibration: 0, 1; name one with --transform",
    ),
    "odd.tfm": (b"#Insight Transform File V1.0\nnonsense\n", "line 2: is no 'name: value'; got 'nonsense'"),
    "vector.npy": (npy(np.arange(16.0)), "holds no 4 x 4 array of numbers; save the matrix alone"),
    "pickled.npy": (npy(np.array([[{}] * 4] * 4), allow_pickle=True), "holds no 4 x 4 array of numbers"),
    "complex.npy": (npy(np.eye(4) * 1j), "holds no 4 x 4 array of numbers"),
    "cut.npy": (npy(np.eye(4))[:-9], "is a damaged .npy file (numbers are missing); save it again"),
    "other.npz": (npz(a=np.arange(3)), "none of its arrays is a 4 x 4 matrix; save the matrix alone"),
    "two.npz": (
        npz(first=np.eye(4), second=np.eye(4)),
        "may be the calibration: first, second; name one with --transform",
    ),
    "cut.npz": (npz(a=np.eye(4))[:-30], "is a damaged .npz file ("),
}


@pytest.mark.parametrize("name", CASES)
def test_a_file_without_a_calibration_is_refused_in_a_sentence(tmp_path, name):
    content, words = CASES[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(sc.SonocalError) as caught:
        read_existing(tmp_path / name)
    assert words in str(caught.value)
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["two.xml", "two.tfm", "two.npz"])
def test_one_of_several_is_named(tmp_path, name):
    (tmp_path / name).write_bytes(CASES[name][0])
    for wanted in {"two.xml": ("ImageToProbe", "imagetoprobe"), "two.tfm": ("0", "1"), "two.npz": ("first",)}[
        name
    ]:
        assert read_existing(tmp_path / name, Choice(wanted)).matrix.shape == (4, 4)
    with pytest.raises(
        sc.InputError, match="has no transform Image9ToProbe, and no others lead there; it has"
    ):
        read_existing(tmp_path / name, Choice("Image9ToProbe"))


def hdf5(path, change):
    """An ITK transform that `change` was let at."""
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    with h5py.File(path, "w") as file:
        file["TransformGroup/0/TransformType"] = [b"AffineTransform_double_3_3"]
        file["TransformGroup/0/TransformParameters"] = np.array([0, 0.2, 0, 0, 0, -0.2, -0.2, 0, 0, 1, 2, 3])
        file["TransformGroup/0/TransformFixedParameters"] = np.zeros(3)
        change(file, h5py)
    return path


def test_an_hdf5_of_itk_4_is_read(tmp_path):
    def older(file, _):
        group = file["TransformGroup/0"]
        group.move("TransformParameters", "TranformParameters")
        group.move("TransformFixedParameters", "TranformFixedParameters")

    path = hdf5(tmp_path / "a.h5", older)
    assert read_existing(path).matrix[:3, 3].tolist() == [1, 2, 3]


def unlink(name, make):
    def change(file, h5py):
        del file[name]
        make(file, h5py)

    return change


HDF5 = {
    "other": (unlink("TransformGroup", lambda file, _: None), "is HDF5 without the group TransformGroup"),
    "no type": (unlink("TransformGroup/0/TransformType", lambda file, _: None), "a transform has no type"),
    "no numbers": (
        unlink("TransformGroup/0/TransformParameters", lambda file, _: None),
        "an affine transform has 12 parameters and 3 fixed ones; got 0 and 3",
    ),
    "a field": (
        unlink(
            "TransformGroup/0/TransformParameters",
            lambda file, _: file["TransformGroup/0"].create_dataset(
                "TransformParameters", (10**9,), "f8", chunks=(1000,)
            ),
        ),
        "an affine transform has 12 parameters and 3 fixed ones; got 0 and 3",
    ),
}


@pytest.mark.parametrize("which", HDF5)
def test_hdf5_without_a_transform_is_refused_in_a_sentence(tmp_path, which):
    change, words = HDF5[which]
    path = hdf5(tmp_path / "a.h5", change)
    with pytest.raises(sc.SonocalError) as caught:
        read_existing(path)
    assert words in str(caught.value)


def test_an_hdf5_looks_into_no_other_file(tmp_path):
    """Links and external data may name any file of this machine."""
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    secret = hdf5(tmp_path / "secret.h5", lambda file, _: None)
    (tmp_path / "secret.bin").write_bytes(np.zeros(12).tobytes())
    links = {
        "TransformGroup": h5py.ExternalLink(str(secret), "TransformGroup"),
        "TransformGroup/0/TransformParameters": h5py.ExternalLink(
            str(secret), "TransformGroup/0/TransformParameters"
        ),
    }
    for name, link in links.items():

        def linked(file, _, name=name, link=link):
            del file[name]
            file[name] = link

        with pytest.raises(sc.SonocalError):
            read_existing(hdf5(tmp_path / "a.h5", linked))

    def outside(file, _):
        del file["TransformGroup/0/TransformParameters"]
        external = [(str(tmp_path / "secret.bin"), 0, 96)]
        file["TransformGroup/0"].create_dataset("TransformParameters", (12,), "f8", external=external)

    with pytest.raises(sc.SonocalError, match="is HDF5 that is damaged, or other than ITK writes it"):
        read_existing(hdf5(tmp_path / "a.h5", outside))


def test_it_is_read_where_h5py_is_not_installed(tmp_path, monkeypatch):
    path = hdf5(tmp_path / "a.h5", lambda file, _: None)
    monkeypatch.setitem(sys.modules, "h5py", None)
    assert read_existing(path).matrix[:3, 3].tolist() == [1, 2, 3]


FORMS = {
    "as h5py writes": {},
    "in the newer form, as ITK writes": {"libver": ("v108", "v108")},
}
PIECES = {
    "whole": {},
    "compressed": {"chunks": (12,), "compression": "gzip"},
    "in one piece": {"chunks": (12,)},
    "high byte first": {"dtype": ">f8"},
    "float": {"dtype": "f4"},
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("pieces", PIECES)
def test_whatever_way_hdf5_holds_the_numbers(tmp_path, form, pieces):
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    numbers = np.array([0, 0.25, 0, 0, 0, -0.25, -0.25, 0, 0, 1, 2, 3])
    with h5py.File(tmp_path / "a.h5", "w", **FORMS[form]) as file:
        group = file.create_group("TransformGroup/0")
        group.create_dataset("TransformType", data=[b"AffineTransform_double_3_3"])
        group.create_dataset("TransformParameters", data=numbers, **PIECES[pieces])
        group.create_dataset("TransformFixedParameters", data=np.zeros(3))
        file.attrs["convention"] = "for 3D Slicer: it holds the inverse, in LPS" + "." * 200
    found = read_existing(tmp_path / "a.h5", Choice(stored_as="direct"))
    assert found.matrix[:3].tolist() == [[0, 0.25, 0, 1], [0, 0, -0.25, 2], [-0.25, 0, 0, 3]]
    assert [one.form for one in matrices_in(tmp_path / "a.h5")] == ["slicer"]


def test_nothing_pickled_is_ever_loaded(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("it was loaded",))

    header = npy(np.array([[0] * 4] * 4, dtype=object), allow_pickle=True)
    start = header[: header.index(b"\n") + 1]
    (tmp_path / "a.npy").write_bytes(start + pickle.dumps(Bomb()))
    with pytest.raises(sc.FormatError):
        read_existing(tmp_path / "a.npy")
