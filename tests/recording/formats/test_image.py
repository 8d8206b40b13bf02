"""Single images."""

import struct
import tracemalloc
import zlib

import numpy as np
import pytest

from sonocal import FormatError, UnsupportedError
from sonocal.files.png import png
from sonocal.recording.formats import read_recording
from tests.builders.pictures import images


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
