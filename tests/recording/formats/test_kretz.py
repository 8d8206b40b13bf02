"""GE's Kretz volumes: from beams to cubes, and what is refused."""

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import FormatError, UnsupportedError
from sonocal.recording.formats import read_recording
from tests.builders.kretz import element, kretz_bytes, places_mm, some_toroid


def smooth(places):
    """Brightness that changes so slowly that straight lines between samples follow it."""
    return 120 + places @ np.array([1.1, -0.7, 0.9])


@settings(max_examples=15)
@given(
    step=st.floats(0.3, 1.0),
    first=st.floats(20, 60),
    axis=st.floats(-10, 12),
    fans=st.tuples(st.floats(0.2, 0.6), st.floats(0.1, 0.6)),
    backwards=st.tuples(st.booleans(), st.booleans()),
)
def test_what_lies_in_space_is_found_there(tmp_path_factory, step, first, axis, fans, backwards):
    """A field of space is sampled along the beams, by the layout's own formula: the cubes give it back."""
    path = tmp_path_factory.mktemp("kretz") / "a.vol"
    i, beams, images = 60, np.linspace(-fans[0], fans[0], 41), np.linspace(-fans[1], fans[1], 31)
    beams, images = (a[::-1] if back else a for a, back in zip((beams, images), backwards, strict=True))
    shape = (step, first, axis, beams, images)
    places = places_mm(i, *shape)
    middle = places.reshape(-1, 3).mean(axis=0)
    scale = 100 / np.abs(smooth(places) - smooth(middle)).max()
    voxels = np.rint(128 + scale * (smooth(places) - smooth(middle))).astype(np.uint8)
    path.write_bytes(kretz_bytes(voxels, *shape))
    recording = read_recording(path)
    volume, (du, dv, dw) = recording.frames[0], recording.image.spacing_mm
    origin = np.array([float(word) for word in recording.fields["Offset"].split()])
    w, v, u = np.nonzero(volume)
    wanted = 128 + scale * (smooth(origin + np.stack([u * du, v * dv, w * dw], axis=1)) - smooth(middle))
    assert len(w) > 0.05 * volume.size
    assert np.abs(volume[w, v, u] - wanted).max() < 2
    low, high = places.reshape(-1, 3).min(axis=0), places.reshape(-1, 3).max(axis=0)
    np.testing.assert_allclose(origin, low, atol=1e-9)
    assert (np.abs(origin + np.array([du, dv, dw]) * (np.array(volume.shape[::-1]) - 1) - high) <= du).all()


def test_the_number_of_cubes_is_bounded(tmp_path):
    voxels, *shape = some_toroid(i=2000, j=3, k=3)
    shape[0] = 0.05
    (tmp_path / "a.vol").write_bytes(kretz_bytes(voxels, *shape))
    recording = read_recording(tmp_path / "a.vol")
    assert np.prod(recording.frames.shape) <= 1.01 * 2**24
    assert recording.image.spacing_mm[0] > 0.05


def test_a_volume_of_cubes_is_read_as_it_is(tmp_path):
    voxels = some_toroid()[0]
    (tmp_path / "a.vol").write_bytes(kretz_bytes(voxels, 0.4))
    recording = read_recording(tmp_path / "a.vol")
    np.testing.assert_array_equal(recording.frames[0], voxels)
    assert recording.image.spacing_mm == (0.4,) * 3
    assert recording.diagnostics == ()


def test_it_is_told_that_beams_became_cubes(tmp_path):
    (tmp_path / "a.vol").write_bytes(kretz_bytes(*some_toroid()))
    (said,) = read_recording(tmp_path / "a.vol").diagnostics
    assert (said.code, said.severity) == ("scan-converted", "info")
    assert said.message == (
        "9 x 7 x 5 voxels along beams were brought to cubes of 0.8 mm, by a geometry that is not the maker's own"
    )


VOXELS = some_toroid()[0]
REFUSED = {
    "is a Kretz volume of GE whose voxels are compressed: 100 bytes for the 315 of 9 x 7 x 5; save it uncompressed": {
        (0xD000, 1): b"\1" * 100
    },
    "is a Kretz volume of GE whose voxels are stored in a way that is not read: 630 bytes for the 315": {
        (0xD000, 1): b"\1" * 630
    },
    "is a Kretz file of GE that holds no voxels (D000,0001), which is not read": {(0xD000, 1): None},
    "is a Kretz file of GE that holds a sequence of volumes (D600,0001), which is not read": {
        (0xD000, 1): None,
        (0xD600, 1): b"\1" * 99,
    },
    "states a volume of 9 x 0 x 5 voxels": {(0xC000, 2): struct.pack("<H", 0)},
    "its element (C000,0003) has 0 bytes where a Kretz volume has 2": {(0xC000, 3): None},
    "its element (C300,0002) has 48 bytes where a Kretz volume has 56": {(0xC300, 2): b"\0" * 48},
    "the angles of its beams do not go one way": {(0xC300, 2): np.full(7, np.pi / 2).tobytes()},
    "the angles of its images do not go one way": {(0xC300, 1): np.full(5, np.nan).tobytes()},
    "its beams start at": {(0xC100, 1): struct.pack("<d", -1)},
    "its images are turned about an axis": {(0xC200, 2): struct.pack("<d", -500)},
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_cannot_be_read_is_refused(tmp_path, words):
    (tmp_path / "a.vol").write_bytes(kretz_bytes(*some_toroid(), changed=REFUSED[words]))
    with pytest.raises((FormatError, UnsupportedError)) as caught:
        read_recording(tmp_path / "a.vol")
    assert str(caught.value).startswith(f"a.vol: {words}")


def test_a_few_bytes_claim_no_memory(tmp_path):
    head = b"KRETZFILE 1.0   " + b"".join(element(0xC000, n, b"\xff\xff") for n in (1, 2, 3))
    (tmp_path / "a.vol").write_bytes(head + struct.pack("<HHI", 0xD000, 1, 2**32 - 1))
    with pytest.raises(FormatError, match=r"a\.vol: its element \(D000,0001\) is longer than the file"):
        read_recording(tmp_path / "a.vol")
