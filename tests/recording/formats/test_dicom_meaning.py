"""What the values of DICOM images mean: palettes, inverted grey, colour, and mm per px of their regions."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, UnsupportedError
from sonocal.recording.formats import read_recording
from tests.builders.pictures import dicom_file, images, items, palette
from tests.builders.recordings import random_pixels

pydicom = pytest.importorskip("pydicom", reason="pydicom is not installed")

SIZES = st.tuples(st.integers(1, 5), st.integers(1, 5))


def frames_of(path):
    recording = read_recording(path)
    frames = np.stack(list(recording.frames))
    assert frames.shape[1:] == recording.frames.shape
    assert frames.dtype == recording.frames.dtype
    return frames


def fresh(tmp_path_factory):
    return tmp_path_factory.mktemp("dicom") / "a.dcm"


@given(
    grey=st.booleans(),
    depth=st.sampled_from(["uint8", "uint16"]),
    stored=st.sampled_from(["uint8", "uint16", "int16"]),
    entries=st.integers(1, 256),
    first=st.integers(-3, 9),
    implicit=st.booleans(),
    size=SIZES,
    seed=st.integers(0, 2**32),
)
def test_a_palette_says_what_the_values_mean(
    tmp_path_factory, grey, depth, stored, entries, first, implicit, size, seed
):
    rng, path = np.random.default_rng(seed), fresh(tmp_path_factory)
    least = -9 if stored[0] == "i" else 0
    first = max(first, least)
    pixels = rng.integers(first - 5, first + entries + 5, (2, *size)).clip(least, 255).astype(stored)
    table = random_pixels(rng, (entries, 3), depth)
    table = np.repeat(table[:, :1], 3, axis=1) if grey else table
    syntax = pydicom.uid.ImplicitVRLittleEndian if implicit else None
    dicom_file(path, pixels, syntax=syntax, **palette(*np.ascontiguousarray(table.T), first=first))
    found = frames_of(path)
    wanted = table[np.clip(pixels.astype(int) - first, 0, entries - 1)]
    alike = (table == table[:, :1]).all()
    np.testing.assert_array_equal(found, wanted[..., 0] if alike else wanted)
    assert found.dtype == depth


@given(
    stored=st.sampled_from(["uint8", "uint16", "int16"]),
    used=st.integers(1, 16),
    size=SIZES,
    seed=st.integers(0, 2**32),
)
def test_inverted_grey_is_turned_back(tmp_path_factory, stored, used, size, seed):
    """The darkest value becomes the brightest of the bits in use, and the other way round."""
    path, bits = fresh(tmp_path_factory), min(used, 8 * np.dtype(stored).itemsize)
    least, most = (0, 2**bits - 1) if stored[0] == "u" else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
    pixels = np.random.default_rng(seed).integers(least, most, (2, *size), endpoint=True).astype(stored)
    dicom_file(path, pixels, PhotometricInterpretation="MONOCHROME1", BitsStored=bits, HighBit=bits - 1)
    found = frames_of(path)
    assert found.dtype == stored
    np.testing.assert_array_equal(found.astype(int), least + most - pixels.astype(int))


def test_luma_and_chroma_become_red_green_blue(tmp_path):
    pixels = random_pixels(np.random.default_rng(0), (2, 3, 4, 3), "uint8")
    from pydicom.pixels import convert_color_space

    ybr = np.stack([convert_color_space(one, "RGB", "YBR_FULL") for one in pixels])
    dicom_file(tmp_path / "a.dcm", ybr, True, PhotometricInterpretation="YBR_FULL")
    assert np.abs(frames_of(tmp_path / "a.dcm").astype(int) - pixels).max() <= 2


@pytest.mark.parametrize(
    "syntax", ["ImplicitVRLittleEndian", "ExplicitVRLittleEndian", "ExplicitVRBigEndian", "RLELossless"]
)
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_every_way_of_writing_gives_the_same_pixels(tmp_path, syntax, dtype):
    pixels = random_pixels(np.random.default_rng(0), (3, 5, 7), dtype)
    if syntax == "RLELossless":
        dicom_file(tmp_path / "a.dcm", pixels)
        written = pydicom.dcmread(tmp_path / "a.dcm")
        written.compress(pydicom.uid.RLELossless)
        written.save_as(tmp_path / "a.dcm")
    else:
        order = ">" if syntax == "ExplicitVRBigEndian" else "<"
        stored = pixels.astype(pixels.dtype.newbyteorder(order))
        dicom_file(tmp_path / "a.dcm", stored, syntax=getattr(pydicom.uid, syntax))
    np.testing.assert_array_equal(frames_of(tmp_path / "a.dcm"), pixels)


@pytest.mark.parametrize(
    "change", [{"RedPaletteColorLookupTableData": b""}, {"RedPaletteColorLookupTableDescriptor": [300, 0, 8]}]
)
def test_a_palette_that_does_not_fit_is_refused(tmp_path, change):
    table = np.arange(256, dtype=np.uint8)
    dicom_file(tmp_path / "a.dcm", images((2, 4, 6)), **(palette(table, table, table) | change))
    with pytest.raises(
        FormatError, match=r"a\.dcm: its palette (lacks red, or is shorter than it says|is not described)"
    ):
        read_recording(tmp_path / "a.dcm")


def test_a_palette_in_segments_is_unrolled(tmp_path):
    """One run of 256 entries from 0 to 255, all three colours alike: grey."""
    ramp = np.array([0, 1, 0, 1, 255, 255], np.uint8).tobytes()
    fields = {f"Segmented{name}PaletteColorLookupTableData": ramp for name in ("Red", "Green", "Blue")}
    fields |= {f"{name}PaletteColorLookupTableDescriptor": [256, 0, 8] for name in ("Red", "Green", "Blue")}
    pixels = images((2, 4, 6))
    dicom_file(tmp_path / "a.dcm", pixels, PhotometricInterpretation="PALETTE COLOR", **fields)
    np.testing.assert_array_equal(frames_of(tmp_path / "a.dcm"), pixels)


def test_a_palette_that_is_missing_is_refused(tmp_path):
    dicom_file(tmp_path / "a.dcm", images((2, 4, 6)), PhotometricInterpretation="PALETTE COLOR")
    with pytest.raises(
        FormatError, match=r"a\.dcm: its palette is not described \(RedPaletteColorLookupTableDescriptor\)"
    ):
        read_recording(tmp_path / "a.dcm")


def region(box=(0, 11, 0, 15), scale=(0.02, 0.02), units=(3, 3), form=1, kind=1):
    keys = ("MinX0", "MaxX1", "MinY0", "MaxY1")
    return {
        "RegionSpatialFormat": form,
        "RegionDataType": kind,
        **{f"RegionLocation{key}": value for key, value in zip(keys, box, strict=True)},
        "PhysicalUnitsXDirection": units[0],
        "PhysicalUnitsYDirection": units[1],
        "PhysicalDeltaX": scale[0],
        "PhysicalDeltaY": scale[1],
    }


LEFT, RIGHT = region(), region((12, 23, 0, 15), (0.05, 0.05))
ALIKE = region((12, 23, 0, 15))
M_MODE = region((12, 23, 0, 15), (0.004, 0.02), (4, 3), form=2)
TEXT = region((0, 23, 0, 2), (0.0, 0.0), (0, 0), form=5)
FLOW = region((3, 8, 3, 9), kind=2)
IN_PERCENT = region(units=(1, 1))


@pytest.mark.parametrize(
    ("regions", "spacing", "severity", "words"),
    [
        ([LEFT], (0.2, 0.2), None, ""),
        ([LEFT, ALIKE], (0.2, 0.2), None, ""),
        ([LEFT, FLOW, TEXT], (0.2, 0.2), None, ""),
        (
            [LEFT, RIGHT],
            None,
            "warning",
            "parts of the image have different mm/px, and the image none: "
            "0.2 x 0.2 mm/px in 2D tissue (u 0 to 11, v 0 to 15); 0.5 x 0.5 mm/px in 2D tissue (u 12 to 23, v 0 to 15)",
        ),
        (
            [M_MODE, LEFT],
            (0.2, 0.2),
            "info",
            "mm/px are those of a part of the image, 0.2 x 0.2 mm/px in 2D tissue (u 0 to 11, v 0 to 15); "
            "it has other parts: units s x cm in M-mode tissue (u 12 to 23, v 0 to 15)",
        ),
        (
            [IN_PERCENT],
            None,
            "info",
            "no part of the image has mm/px: units percent x percent in 2D tissue (u 0 to 11, v 0 to 15)",
        ),
        ([], None, None, ""),
    ],
)
def test_each_region_has_a_scale_of_its_own(tmp_path, regions, spacing, severity, words):
    dicom_file(tmp_path / "a.dcm", images(), SequenceOfUltrasoundRegions=items(*regions))
    recording = read_recording(tmp_path / "a.dcm")
    assert recording.image.spacing_mm == (spacing if spacing is None else pytest.approx(spacing))
    said = [(one.code, one.severity, one.message) for one in recording.diagnostics]
    assert said == ([] if severity is None else [("region-scales", severity, words)])


@given(
    deltas=st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=2, max_size=2),
    units=st.integers(0, 99),
)
def test_a_scale_is_a_length_or_none(tmp_path_factory, deltas, units):
    path = fresh(tmp_path_factory)
    dicom_file(
        path, images((2, 4, 6)), SequenceOfUltrasoundRegions=items(region(scale=deltas, units=(units, units)))
    )
    spacing = read_recording(path).image.spacing_mm
    usable = units == 3 and np.isfinite(deltas).all() and 0 not in deltas
    assert (spacing is not None) == usable
    if usable:
        assert spacing == tuple(10.0 * abs(delta) for delta in deltas)


def test_pixel_spacing_serves_where_no_region_has_cm(tmp_path):
    dicom_file(tmp_path / "a.dcm", images((2, 4, 6)), PixelSpacing=[0.3, 0.2])
    assert read_recording(tmp_path / "a.dcm").image.spacing_mm == (0.2, 0.3)


@pytest.mark.parametrize("other", [{"PixelSpacing": [0.4, 0.2]}, {}])
def test_files_of_one_folder_share_their_scale_or_have_none(tmp_path, other):
    """The depth may have been changed while it was recorded."""
    for i, fields in enumerate([{"PixelSpacing": [0.3, 0.2]}] * 2 + [other]):
        dicom_file(tmp_path / f"{i}.dcm", images((4, 6)), **fields)
    recording = read_recording(tmp_path)
    assert recording.image.spacing_mm is None
    (said,) = recording.diagnostics
    last = "0.2 x 0.4 mm/px" if other else "no mm/px"
    assert (said.code, said.severity) == ("region-scales", "warning")
    assert said.message == f"images have different mm/px: 0.2 x 0.3 mm/px at first, {last} in image 2"
    (tmp_path / "2.dcm").unlink()
    assert read_recording(tmp_path).image.spacing_mm == (0.2, 0.3)


def test_a_file_of_several_images_among_others_is_refused(tmp_path):
    """Only its first image was taken, once."""
    dicom_file(tmp_path / "0.dcm", images((4, 6)))
    dicom_file(tmp_path / "1.dcm", images((3, 4, 6)))
    with pytest.raises(
        UnsupportedError, match=r"1\.dcm holds 3 images, and a folder files of one image each"
    ):
        read_recording(tmp_path)


@pytest.mark.parametrize("frames", [4, 10_000_000])
def test_more_frames_than_the_file_holds_are_refused(tmp_path, frames):
    dicom_file(tmp_path / "a.dcm", images((3, 4, 6)), NumberOfFrames=frames)
    with pytest.raises(
        FormatError, match=rf"a\.dcm: holds 72 bytes of pixels where its header asks for {frames} frames"
    ):
        read_recording(tmp_path / "a.dcm")
