"""Single images."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, UnsupportedError
from sonocal.files.png import png
from sonocal.recording.formats import read_recording
from tests.builders.pictures import images
from tests.builders.recordings import random_pixels


@pytest.mark.parametrize(
    ("size", "kind", "sentence"),
    [
        (
            (8000, 8000),
            UnsupportedError,
            "a.png: one frame of 8000x8000x3 uint8 takes 192000000 bytes, more than",
        ),
        (
            (60000, 60000),
            FormatError,
            "a.png: is not an image that can be read (Image size (3600000000 pixels)",
        ),
    ],
)
def test_a_picture_that_claims_to_be_huge_is_refused_before_it_is_decoded(tmp_path, size, kind, sentence):
    pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    small = png(np.zeros((2, 3, 3), dtype=np.uint8))
    header = struct.pack(">4sIIBBBBB", b"IHDR", *size, 8, 2, 0, 0, 0)
    claims = small[:12] + header + struct.pack(">I", zlib.crc32(header)) + small[33:]
    (tmp_path / "a.png").write_bytes(claims)
    tracemalloc.start()
    with pytest.raises(kind) as caught:
        read_recording(tmp_path / "a.png")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert str(caught.value).startswith(sentence)
    assert peak < 10_000_000


def test_a_single_picture_is_a_recording_of_one_frame(tmp_path):
    pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    pixels = images((1, 6, 8))[0]
    (tmp_path / "a.png").write_bytes(png(pixels))
    recording = read_recording(tmp_path / "a.png")
    assert (len(recording), recording.image.size_px, recording.provenance.format) == (1, (8, 6), "image")
    np.testing.assert_array_equal(recording.frames[0], pixels)


@pytest.mark.parametrize("suffix", [".png", ".tif", ".bmp"])
@given(
    size=st.tuples(st.integers(1, 9), st.integers(1, 9)),
    mode=st.sampled_from(["L", "RGB", "I;16", "F"]),
    seed=st.integers(0, 2**32),
)
def test_every_pixel_that_pillow_writes_is_read(tmp_path_factory, suffix, size, mode, seed):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    if (
        mode
        not in {".png": ("L", "RGB", "I;16"), ".tif": ("L", "RGB", "I;16", "F"), ".bmp": ("L", "RGB")}[suffix]
    ):
        return
    dtype = {"L": "uint8", "RGB": "uint8", "I;16": "uint16", "F": "float32"}[mode]
    pixels = random_pixels(np.random.default_rng(seed), (*size, 3) if mode == "RGB" else size, dtype)
    path = tmp_path_factory.mktemp("images") / f"a{suffix}"
    pillow.fromarray(pixels).save(path)
    recording = read_recording(path)
    frame = recording.frames[0]
    assert (frame.dtype, frame.shape, frame.tobytes()) == (pixels.dtype, pixels.shape, pixels.tobytes())
    assert recording.image.size_px == size[::-1]
    assert recording.image.channels == (3 if mode == "RGB" else 1)
    assert np.isnan(recording.times).all()
