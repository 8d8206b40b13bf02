"""Independent readers and writers of MetaIO and NRRD, in every type and dimension, both ways."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.recording import ArrayFrames, ImageGeometry, Recording
from sonocal.recording.formats import read_recording, write_recording
from tests.builders.recordings import random_pixels, random_recording
from tests.builders.strategies import TYPES

sitk = pytest.importorskip("SimpleITK", reason="SimpleITK, the oracle of MetaIO, is not installed")
nrrd = pytest.importorskip("nrrd", reason="pynrrd, the oracle of NRRD, is not installed")

SHAPES = st.lists(st.integers(1, 5), min_size=2, max_size=3).map(tuple)
SEEDS = st.integers(0, 2**32)
SPACINGS = st.floats(0.01, 5)


def pixels_of(shape, dtype, seed):
    return random_pixels(np.random.default_rng(seed), shape, dtype)


def lone_image(pixels, dimension, spacing=None):
    frames = ArrayFrames(pixels[None])
    return Recording(
        times=np.array([np.nan]), frames=frames, image=ImageGeometry.of(frames, dimension, "MFA", spacing)
    )


def assert_frame(recording, pixels):
    frame = recording.frames[0]
    assert (frame.dtype, frame.shape) == (pixels.dtype, pixels.shape)
    assert frame.tobytes() == pixels.tobytes()


@given(shape=SHAPES, dtype=st.sampled_from(TYPES), seed=SEEDS, compress=st.booleans(), data=st.data())
def test_simpleitk_reads_images_that_we_write(tmp_path_factory, shape, dtype, seed, compress, data):
    spacing = tuple(data.draw(st.lists(SPACINGS, min_size=len(shape), max_size=len(shape))))
    pixels = pixels_of(shape, dtype, seed)
    for suffix in (".mha", ".mhd", ".nrrd"):
        path = tmp_path_factory.mktemp("ours") / f"a{suffix}"
        write_recording(lone_image(pixels, len(shape), spacing), path, compress)
        theirs = sitk.ReadImage(path)
        assert sitk.GetArrayFromImage(theirs).tobytes() == pixels.tobytes()
        assert theirs.GetSize() == shape[::-1]
        np.testing.assert_allclose(theirs.GetSpacing(), spacing, rtol=1e-14)


@given(shape=SHAPES, dtype=st.sampled_from(TYPES), seed=SEEDS, compress=st.booleans(), data=st.data())
def test_we_read_images_that_simpleitk_writes(tmp_path_factory, shape, dtype, seed, compress, data):
    spacing = data.draw(st.lists(SPACINGS, min_size=len(shape), max_size=len(shape)))
    pixels = pixels_of(shape, dtype, seed)
    image = sitk.GetImageFromArray(pixels)
    image.SetSpacing(spacing)
    for suffix in (".mha", ".mhd", ".nrrd", ".nhdr"):
        path = tmp_path_factory.mktemp("theirs") / f"a{suffix}"
        sitk.WriteImage(image, path, useCompression=compress)
        recording = read_recording(path)
        assert_frame(recording, pixels)
        assert recording.image.size_px == shape[::-1]
        np.testing.assert_allclose(recording.image.spacing_mm, spacing, rtol=1e-5)  # MetaIO writes six digits


@given(shape=SHAPES, dtype=st.sampled_from(TYPES), seed=SEEDS, encoding=st.sampled_from(["raw", "gzip"]))
def test_we_read_images_that_pynrrd_writes(tmp_path_factory, shape, dtype, seed, encoding):
    pixels = pixels_of(shape, dtype, seed)
    for suffix, big in ((".nrrd", False), (".nrrd", True), (".nhdr", False)):
        path = tmp_path_factory.mktemp("theirs") / f"a{suffix}"
        stored = pixels.T.astype(pixels.dtype.newbyteorder(">")) if big else pixels.T
        nrrd.write(str(path), stored, {"encoding": encoding, "kinds": ["domain"] * len(shape)})
        assert_frame(read_recording(path), pixels)


@given(n=st.integers(2, 4), shape=SHAPES, dtype=st.sampled_from(TYPES), seed=SEEDS, compress=st.booleans())
def test_pynrrd_reads_sequences_that_we_write(tmp_path_factory, n, shape, dtype, seed, compress):
    recording = random_recording(seed, n, shape[::-1], dtype)
    path = tmp_path_factory.mktemp("ours") / "a.nrrd"
    write_recording(recording, path, compress)
    theirs, header = nrrd.read(str(path))
    assert theirs.T.tobytes() == np.stack(list(recording.frames)).tobytes()
    assert list(header["kinds"]) == ["domain"] * len(shape) + ["list"]
    for i, stamp in enumerate(recording.times.tolist()):
        assert float(header[f"Seq_Frame{i:04d}_Timestamp"]) == stamp


@given(n=st.integers(2, 4), shape=SHAPES, dtype=st.sampled_from(TYPES), seed=SEEDS, compress=st.booleans())
def test_simpleitk_reads_sequences_that_we_write(tmp_path_factory, n, shape, dtype, seed, compress):
    recording = random_recording(seed, n, shape[::-1], dtype)
    path = tmp_path_factory.mktemp("ours") / "a.mha"
    write_recording(recording, path, compress)
    theirs = sitk.ReadImage(path)
    assert sitk.GetArrayFromImage(theirs).tobytes() == np.stack(list(recording.frames)).tobytes()
    for i, stamp in enumerate(recording.times.tolist()):
        assert float(theirs.GetMetaData(f"Seq_Frame{i:04d}_Timestamp")) == stamp


@given(seed=SEEDS, suffixes=st.permutations([".mha", ".mhd", ".nrrd"]))
def test_going_through_every_format_loses_nothing(tmp_path_factory, seed, suffixes):
    """A recording copied from format to format is the recording, fields and all."""
    recording = random_recording(seed, 3, (4, 3), "uint16")
    first = tmp_path_factory.mktemp("copies") / "0.mha"
    write_recording(recording, first)
    last = first
    for i, suffix in enumerate([*suffixes, ".mha"], 1):
        path = first.parent / f"{i}{suffix}"
        write_recording(read_recording(last), path)
        last = path
    again = read_recording(last)
    assert dict(again.fields).items() >= dict(recording.fields).items()
    assert dict(again.item_fields) == dict(recording.item_fields)
    for name, one in recording.poses.items():
        assert again.poses[name].matrices.tobytes() == one.matrices.tobytes()
        assert again.poses[name].status == one.status
