"""Volumes in DICOM: Enhanced US Volume, Philips' Cartesian export, and private ones that are named."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import FormatError, UnsupportedError
from sonocal.recording import health
from sonocal.recording.formats import read_recording
from sonocal.recording.formats.parts.dicom_file import Item
from tests.builders.kretz import kretz_bytes, some_toroid
from tests.builders.pictures import PHILIPS_CLASS, dicom_file, images, items, palette, plane, volume_file

pydicom = pytest.importorskip("pydicom", reason="pydicom is not installed")


def stack(n=2, planes=3, seed=0):
    """(n, planes, 4, 6) pixels."""
    return np.random.default_rng(seed).integers(0, 255, (n, planes, 4, 6), dtype=np.uint8)


@given(
    n=st.integers(1, 3),
    planes=st.integers(2, 5),
    step=st.floats(0.05, 3),
    seed=st.integers(0, 2**32),
    timed=st.booleans(),
    turned=st.booleans(),
)
def test_planes_in_any_order_make_the_volumes_that_they_are_of(
    tmp_path_factory, n, planes, step, seed, timed, turned
):
    """In any frame w runs along u x v: no volume is mirrored. Without times, a plane that comes again is the next's."""
    rng, path = np.random.default_rng(seed), tmp_path_factory.mktemp("volume") / "a.dcm"
    pixels = stack(n, planes, seed)
    turn = Rotation.random(random_state=int(seed % 1000)).as_matrix() if turned else np.eye(3)
    axes = turn[:, :2].T.ravel() if turned else None
    where = [(t, w) for t in range(n) for w in range(planes)]
    order = (
        rng.permutation(len(where))
        if timed
        else np.concatenate([t * planes + rng.permutation(planes) for t in range(n)])
    )
    where = [where[i] for i in order]
    described = [plane(turn @ [3.0, -2.0, step * w], 0.25 * t if timed else None, axes) for t, w in where]
    volume_file(path, described, np.stack([pixels[t, w] for t, w in where]), ContentTime="000010")
    recording = read_recording(path)
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels)
    assert recording.image.size_px == (6, 4, planes)
    assert recording.image.spacing_mm == pytest.approx((0.3, 0.4, step))
    wanted = 10 + 0.25 * np.arange(n) if timed or n == 1 else np.full(n, np.nan)
    np.testing.assert_allclose(recording.times, wanted)


def test_a_sweep_whose_planes_have_times_of_their_own_is_one_volume(tmp_path):
    pixels = stack(1, 5)[0]
    described = [plane([0, 0, 0.5 * w], time=0.1 * w) for w in range(5)]
    volume_file(tmp_path / "a.dcm", described, pixels)
    recording = read_recording(tmp_path / "a.dcm")
    assert (len(recording), recording.image.size_px) == (1, (6, 4, 5))
    np.testing.assert_array_equal(recording.frames[0], pixels)


def test_tissue_is_taken_from_a_volume_with_flow(tmp_path):
    pixels = stack(2, 3)
    kinds = ["TISSUE_INTENSITY", "FLOW_VELOCITY"]
    described = [plane([0, 0, 0.5 * w], kind=kind) for kind in kinds for w in range(3)]
    volume_file(tmp_path / "a.dcm", described, pixels.reshape(6, 4, 6))
    recording = read_recording(tmp_path / "a.dcm")
    assert len(recording) == 1
    np.testing.assert_array_equal(recording.frames[0], pixels[0])


def test_a_volume_of_a_palette_goes_through_it(tmp_path):
    pixels, table = stack(1, 3)[0], np.arange(256, dtype=np.uint8)[::-1].copy()
    described = [plane([0, 0, 0.5 * w]) for w in range(3)]
    volume_file(tmp_path / "a.dcm", described, pixels, **palette(table, table, table))
    np.testing.assert_array_equal(read_recording(tmp_path / "a.dcm").frames[0], 255 - pixels)


def test_a_single_plane_is_an_image(tmp_path):
    pixels = stack(2, 1)[:, 0]
    volume_file(tmp_path / "a.dcm", [plane([0, 0, 0], time=t) for t in (0, 0.5)], pixels)
    recording = read_recording(tmp_path / "a.dcm")
    assert (recording.image.size_px, recording.times.tolist()) == ((6, 4), [0, 0.5])
    assert recording.image.spacing_mm == (0.3, 0.4)


SOUND = [[0, 0, 0.5 * w] for w in range(4)]
REFUSED = {
    "its planes are not evenly spaced": ([[0, 0, z] for z in (0, 0.5, 1.0, 1.6)], {}),
    "its planes do not lie one behind the other": ([[0.2 * w, 0, 0.5 * w] for w in range(4)], {}),
    "its planes are not parallel": (SOUND, {3: {"axes": [0, 1, 0, 1, 0, 0]}}),
    "its rows and columns are not at right angles": (
        SOUND,
        {i: {"axes": [1, 0, 0, 1, 0, 0]} for i in range(4)},
    ),
    "its first volume has 3 planes and number 2 has 1": (
        [SOUND[0], SOUND[1], SOUND[2], SOUND[0]],
        {i: {"time": float(i == 3)} for i in range(4)},
    ),
}


@pytest.mark.parametrize("words", REFUSED)
def test_planes_that_make_no_volume_are_refused(tmp_path, words):
    places, more = REFUSED[words]
    described = [plane(place, **more.get(i, {})) for i, place in enumerate(places)]
    volume_file(tmp_path / "a.dcm", described, stack(1, 4)[0])
    with pytest.raises((UnsupportedError, FormatError), match=f"a.dcm: {words}"):
        read_recording(tmp_path / "a.dcm")


def test_a_volume_that_does_not_say_where_its_planes_lie_is_refused(tmp_path):
    volume_file(tmp_path / "a.dcm", [{}] * 4, stack(1, 4)[0])
    with pytest.raises(FormatError, match="does not say where its planes lie"):
        read_recording(tmp_path / "a.dcm")
    volume_file(tmp_path / "b.dcm", [plane([0, 0, 0])] * 3, stack(1, 4)[0])
    with pytest.raises(FormatError, match="says where 3 of its 4 planes lie"):
        read_recording(tmp_path / "b.dcm")


def test_planes_absurdly_far_away_are_refused(tmp_path):
    volume_file(tmp_path / "a.dcm", [plane([0, 0, 1e300 * w]) for w in range(4)], stack(1, 4)[0])
    with pytest.raises(FormatError, match="its ImagePositionVolume is not 3 numbers"):
        read_recording(tmp_path / "a.dcm")


def test_items_where_text_is_due_are_no_text():
    # Turning them into text would look up tags that are in no dictionary.
    inner = pydicom.Dataset()
    inner.add_new(0x2E382E35, "UN", b"")
    held = {
        "SOPClassUID": pydicom.Sequence([inner]),
        "Manufacturer": pydicom.multival.MultiValue(str, ["GE", "Kretz"]),
    }
    assert Item("a.dcm", held).text("SOPClassUID") == ""
    assert Item("a.dcm", held).text("Manufacturer") == "GE\\Kretz"


def philips(path, pixels, slices=3, syntax=None, **fields):
    scale = {
        "PhysicalDeltaX": 0.05,
        "PhysicalDeltaY": 0.06,
        "PhysicalUnitsXDirection": 3,
        "PhysicalUnitsYDirection": 3,
    }
    private = {
        0x30010010: ("LO", "Philips3D"),
        0x30011001: ("UL", slices),
        0x30011002: ("US", 3),
        0x30011003: ("FD", 0.07),
    }
    dicom_file(
        path,
        pixels.reshape(-1, *pixels.shape[2:]),
        syntax=syntax,
        SOPClassUID=PHILIPS_CLASS,
        **scale,
        **fields,
        private=private if slices else {0x30010010: ("LO", "Philips3D")},
        NumberOfFrames=len(pixels),
    )


@pytest.mark.parametrize("syntax", ["ImplicitVRLittleEndian", "ExplicitVRLittleEndian"])
def test_philips_cartesian_volumes(tmp_path, syntax):
    pixels = stack(2, 3)
    philips(tmp_path / "a.dcm", pixels, syntax=getattr(pydicom.uid, syntax), FrameTime="40")
    recording = read_recording(tmp_path / "a.dcm")
    np.testing.assert_array_equal(np.stack(list(recording.frames)), pixels)
    assert recording.image.spacing_mm == pytest.approx((0.5, 0.6, 0.7))
    assert recording.times.tolist() == [0, 0.04]


@pytest.mark.parametrize("slices", [0, 2**31])
def test_other_volumes_of_philips_are_named(tmp_path, slices):
    philips(tmp_path / "a.dcm", stack(2, 3), slices)
    with pytest.raises(
        UnsupportedError, match=r"a\.dcm: holds Philips' private 3D ultrasound \(1\.2\.840\.113543"
    ):
        read_recording(tmp_path / "a.dcm")


def test_more_slices_than_the_file_holds_are_refused(tmp_path):
    philips(tmp_path / "a.dcm", stack(2, 3), 4)
    with pytest.raises(FormatError, match="asks for 8 frames"):
        read_recording(tmp_path / "a.dcm")


GE_MOVIE = items({0x7FE10010: ("LO", "GEMS_Ultrasound_MovieGroup_001"), 0x7FE11002: ("LO", "Trace+3D")})
PHILIPS_STREAM = items({0x200D300D: ("LO", "UDM_USD_DATATYPE_DIN_3D_ECHO")})
PRIVATE = {
    "GE's private volumes (7FE1,1001)": (
        "GE Healthcare",
        {0x7FE10010: ("LO", "GEMS_Ultrasound_MovieGroup_001"), 0x7FE11001: ("SQ", GE_MOVIE)},
    ),
    "Philips' private volumes (200D,3016)": ("Philips Medical Systems", {0x200D3016: ("SQ", PHILIPS_STREAM)}),
}


@pytest.mark.parametrize("syntax", ["ImplicitVRLittleEndian", "ExplicitVRLittleEndian"])
@pytest.mark.parametrize("delimited", [False, True])
@pytest.mark.parametrize("whose", PRIVATE)
def test_private_volumes_beside_pictures_are_named(tmp_path, whose, delimited, syntax):
    maker, private = PRIVATE[whose]
    syntax = getattr(pydicom.uid, syntax)
    dicom_file(tmp_path / "a.dcm", images((2, 4, 6)), syntax=syntax, Manufacturer=maker, private=private)
    if delimited:
        written = pydicom.dcmread(tmp_path / "a.dcm")
        for tag, (kind, _) in private.items():
            written[tag].is_undefined_length = kind == "SQ"
        written.save_as(tmp_path / "a.dcm")
    recording = read_recording(tmp_path / "a.dcm")
    np.testing.assert_array_equal(np.stack(list(recording.frames)), images((2, 4, 6)))
    assert [(d.code, d.severity) for d in recording.diagnostics] == [("private-volumes", "warning")]
    assert recording.diagnostics[0].message == (
        f"the file holds {whose}, whose layout is not public; the pictures beside them were read"
    )
    assert "private-volumes" in [d.code for d in health(recording)]


@pytest.mark.parametrize("block", [0x10, 0x17])
def test_images_that_may_be_planes_of_a_volume_are_named(tmp_path, block):
    creator, spacing = 0x200D0000 | block, 0x200D0003 | block << 8
    private = {creator: ("LO", "Philips US Imaging DD 036"), spacing: ("LO", ["0.4", "0.4", "0.7"])}
    maker = {"Manufacturer": "Philips Medical Systems"}
    dicom_file(tmp_path / "a.dcm", images((2, 4, 6)), private=private, **maker)
    (said,) = read_recording(tmp_path / "a.dcm").diagnostics
    assert (said.code, said.severity) == ("private-volumes", "warning")
    assert said.message.startswith("the images may be the planes of a volume")
    others = {creator: ("LO", "Philips US Imaging DD 001"), spacing: ("LO", "another thing")}
    dicom_file(tmp_path / "b.dcm", images((2, 4, 6)), private=others, **maker)
    assert read_recording(tmp_path / "b.dcm").diagnostics == ()


@pytest.mark.parametrize("whose", PRIVATE)
def test_private_volumes_without_pictures_are_refused_by_name(tmp_path, whose):
    maker, private = PRIVATE[whose]
    dicom_file(tmp_path / "a.dcm", None, Manufacturer=maker, private=private)
    with pytest.raises(UnsupportedError) as caught:
        read_recording(tmp_path / "a.dcm")
    assert str(caught.value).startswith(f"a.dcm: holds {whose}, whose layout is not public; export")


def test_a_file_without_pixels_is_refused(tmp_path):
    dicom_file(tmp_path / "a.dcm", None)
    with pytest.raises(FormatError, match=r"a\.dcm: holds no pixels that can be read"):
        read_recording(tmp_path / "a.dcm")


@pytest.mark.parametrize("maker", ["GE Healthcare Austria GmbH & Co OG", "Kretztechnik"])
def test_a_kretz_volume_within_dicom_is_read_as_itself(tmp_path, maker):
    content = kretz_bytes(*some_toroid())
    (tmp_path / "a.vol").write_bytes(content)
    private = {0x7FE10011: ("LO", "KRETZ_US"), 0x7FE11101: ("OB", content + b"\0" * (len(content) % 2))}
    dicom_file(tmp_path / "a.dcm", images((4, 6)), Manufacturer=maker, private=private)
    alone, within = (read_recording(tmp_path / name) for name in ("a.vol", "a.dcm"))
    np.testing.assert_array_equal(alone.frames[0], within.frames[0])
    assert alone.image.spacing_mm == within.image.spacing_mm
