"""Datasets of HDF5, beside h5py."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, InputError, UnsupportedError
from sonocal.cli.formats import calibration_in, format_of
from sonocal.files.hdf5 import Damaged, Filtered, open_hdf5
from sonocal.files.hdf5_bytes import Bytes
from sonocal.files.hdf5_data import CHUNKED, Dataset
from sonocal.recording.formats import read_recording

h5py = pytest.importorskip("h5py", reason="h5py is not installed")
FILTERS = [
    {},
    {"compression": "gzip"},
    {"compression": "gzip", "shuffle": True},
    {"fletcher32": True},
    {"compression": "gzip", "shuffle": True, "fletcher32": True},
]
TYPES = ["u1", "<u2", ">u2", "<i4", ">f4", "<f8"]


@given(
    shape=st.tuples(st.integers(1, 9), st.integers(1, 7), st.integers(1, 6)),
    pieces=st.none() | st.tuples(st.integers(1, 9), st.integers(1, 7), st.integers(1, 6)),
    how=st.sampled_from(FILTERS),
    kind=st.sampled_from(TYPES),
    begin=st.integers(0, 8),
    seed=st.integers(0, 2**32),
)
def test_numbers_are_those_that_h5py_wrote(tmp_path_factory, shape, pieces, how, kind, begin, seed):
    path = tmp_path_factory.mktemp("hdf5") / "a.h5"
    numbers = np.random.default_rng(seed).integers(0, 200, shape).astype(kind)
    stored = {} if pieces is None else {"chunks": tuple(map(min, pieces, shape)), **how}
    with h5py.File(path, "w") as file:
        file.create_dataset("group/numbers", data=numbers, **stored)
    found = open_hdf5(path).members()["group"].members()["numbers"].dataset()
    assert (found.shape, found.size, found.is_whole) == (shape, numbers.nbytes, True)
    np.testing.assert_array_equal(found.all(), numbers)
    assert found.all().dtype == numbers.dtype.newbyteorder("=")
    begin = min(begin, shape[0] - 1)
    np.testing.assert_array_equal(found.rows(begin, shape[0]), numbers[begin:])
    np.testing.assert_array_equal(found.rows(begin, begin + 1), numbers[begin : begin + 1])


def test_a_single_number_has_no_rows(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["frames"] = file["tforms"] = 1.5
    found = open_hdf5(tmp_path / "a.h5").members()["frames"].dataset()
    assert (found.shape, found.slab_bytes, found.all().tolist()) == ((), 8, [1.5])
    with pytest.raises(UnsupportedError, match=r"frames has shape \(\) float64"):
        read_recording(tmp_path / "a.h5")


def test_many_pieces_are_found_through_every_level_of_their_tree(tmp_path):
    numbers = np.arange(6000, dtype="u2").reshape(3000, 2)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("numbers", data=numbers, chunks=(1, 1))
    np.testing.assert_array_equal(open_hdf5(tmp_path / "a.h5").members()["numbers"].dataset().all(), numbers)


def test_what_was_never_written_is_no_whole_dataset(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        part = file.create_dataset("part", (8, 4), "u1", chunks=(2, 4))
        part[2:4] = 1
        file.create_dataset("none", (8, 4), "u1")
    members = open_hdf5(tmp_path / "a.h5").members()
    for name, there in {"part": 8, "none": 0}.items():
        found = members[name].dataset()
        assert (found.is_whole, found.stored) == (False, there)
        with pytest.raises(Damaged):
            found.all()


def test_what_is_stored_otherwise_is_said(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w", libver="latest") as file:
        file.create_dataset("numbers", data=np.ones((8, 4), "u1"), chunks=(1, 4))
    with pytest.raises(Damaged, match="lie otherwise"):
        open_hdf5(tmp_path / "a.h5").members()["numbers"].dataset().all()


OTHERS = {
    4: "szip",
    5: "n-bit",
    307: "bzip2",
    32000: "lzf",
    32001: "Blosc",
    32015: "Zstandard",
    40000: "of HDF5",
}


def filtered(path, number, **datasets):
    """A file of datasets that state a filter of some number: that of gzip, changed in their headers."""
    with h5py.File(path, "w") as file:
        for name, (numbers, compression) in datasets.items():
            file.create_dataset(name.replace("__", "/"), data=numbers, compression=compression)
    content, gzip = path.read_bytes(), struct.pack("<HHHH", 1, 8, 1, 1) + b"deflate\0"
    assert gzip in content
    path.write_bytes(content.replace(gzip, struct.pack("<H", number) + gzip[2:]))


@pytest.mark.parametrize("number", OTHERS)
def test_a_filter_that_is_not_read_is_named_before_anything_is_read(tmp_path, number):
    """Of either dataset of a scan, and of a transform: no file is called damaged for it."""
    frames, tforms = np.zeros((4, 8, 9), "u1"), np.tile(np.eye(4, dtype="f4"), (4, 1, 1))
    said = f": its numbers went through the filter {OTHERS[number]} (number {number}), which is not read; save it with "
    for name, which in (("a.h5", ("gzip", None)), ("b.h5", (None, "gzip"))):
        filtered(tmp_path / name, number, frames=(frames, which[0]), tforms=(tforms, which[1]))
        with pytest.raises(UnsupportedError) as caught:
            read_recording(tmp_path / name)
        assert str(caught.value) == f"{name}{said}gzip, or uncompressed"
    where = "TransformGroup__0__Transform"
    of_type = np.array([b"AffineTransform_double_3_3"])
    parts = {where + "Type": (of_type, None), where + "Parameters": (np.eye(4)[:3].T.ravel(), "gzip")}
    filtered(tmp_path / "c.h5", number, **parts, **{where + "FixedParameters": (np.zeros(3), None)})
    with pytest.raises(UnsupportedError) as caught:
        calibration_in(tmp_path / "c.h5")
    assert str(caught.value) == f"c.h5{said}gzip, uncompressed, or as .tfm"


def test_lzf_of_h5py_is_named(tmp_path):
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("numbers", data=np.ones((8, 4), "u1"), compression="lzf")
    with pytest.raises(Filtered, match=r"^the filter lzf \(number 32000\)$"):
        open_hdf5(tmp_path / "a.h5").members()["numbers"].dataset()


def test_what_a_file_of_hdf5_holds_says_what_it_is(tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["tforms"], file["more"] = np.ones((3, 4, 4)), 1.0
    with h5py.File(tmp_path / "scan.h5", "w") as file:
        for i in range(100):  # so many that none of the names stands in the first few kB
            file[f"{i:0400d}"] = np.ones(9)
        file["frames"], file["tforms"] = np.ones((3, 4, 5), "u1"), np.tile(np.eye(4), (3, 1, 1))
    with h5py.File(tmp_path / "matrix.h5", "w") as file:
        file["TransformGroup/0/TransformType"] = [b"AffineTransform_double_3_3"]
        file["frames"] = 1.0
    assert format_of(tmp_path / "scan.h5").name == "TUS-REC scan"
    assert format_of(tmp_path / "matrix.h5").kind == "matrix"
    with pytest.raises(UnsupportedError) as caught:
        format_of(tmp_path / "other.h5")
    assert str(caught.value) == (
        "other.h5: is HDF5 that holds more, tforms; what is read of it are transforms of ITK and 3D Slicer "
        "(TransformGroup) and scans of TUS-REC (frames, tforms)"
    )
    with pytest.raises(
        FormatError, match=r"matrix\.h5: is a matrix, such as a calibration of other software"
    ):
        read_recording(tmp_path / "matrix.h5")
    with pytest.raises(InputError, match=r"scan\.h5: is a recording; name the calibration"):
        calibration_in(tmp_path / "scan.h5")


def test_pieces_without_a_rank_are_damaged(tmp_path):
    path = tmp_path / "a.h5"
    path.write_bytes(b"x")
    layout = bytes([3, CHUNKED, 0]) + bytes(8)
    with pytest.raises(Damaged, match="not of its shape"):
        Dataset(Bytes(path), (4, 3), np.dtype("<f4"), layout, [])
