"""Laws of the sequence formats, run on every one of them."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import FormatError, InputError, UnsupportedError
from sonocal.recording import (
    ImageGeometry,
    Recording,
)
from sonocal.recording.formats import (
    read_recording,
    write_recording,
)
from tests.builders.recordings import (
    assert_same,
    random_recording,
    stored_file,
)

SUFFIXES = (".mha", ".mhd", ".nrrd")
TYPES = ("uint8", "int8", "uint16", "int16", "float32", "float64")
REAL = ("*.mha", "*.nrrd")


def real_recordings(data_folder):
    files = [p for pattern in REAL for p in sorted((data_folder / "recordings").glob(pattern))]
    assert files
    return files


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(
    seed=st.integers(0, 10**6),
    n=st.integers(1, 6),
    size=st.sampled_from([(7, 4), (1, 1), (5, 4, 3), None]),
    dtype=st.sampled_from(TYPES),
    channels=st.sampled_from([1, 3]),
    compress=st.booleans(),
)
def test_what_is_written_is_read_again(tmp_path_factory, suffix, seed, n, size, dtype, channels, compress):
    recording = random_recording(seed, n, size, dtype, 1 if size is None else channels)
    path = tmp_path_factory.mktemp("written") / f"sweep{suffix}"
    write_recording(recording, path, compress)
    again = read_recording(path)
    assert_same(recording, again)
    assert dict(recording.fields).items() <= dict(again.fields).items()
    if size is not None:
        assert again.image.size_px == size
        assert again.image.channels == channels
        assert again.image.orientation == "MFA"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_real_recordings_survive_writing(data_folder, tmp_path, suffix):
    for path in real_recordings(data_folder):
        recording = read_recording(path)
        write_recording(recording, tmp_path / f"again{suffix}")
        again = read_recording(tmp_path / f"again{suffix}")
        assert_same(recording, again)
        if path.suffix[-3:] == suffix[-3:]:
            assert dict(again.fields) == dict(recording.fields)
            assert again.image is None or again.image.spacing_mm == recording.image.spacing_mm


def test_writing_twice_gives_the_same_bytes(data_folder, tmp_path):
    recording = read_recording(data_folder / "recordings" / "fCal_Test_Validation_3NWires.igs.mha")
    for suffix in (".mha", ".nrrd"):
        first, second = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
        write_recording(recording, first)
        write_recording(read_recording(first), second)
        assert first.read_bytes() == second.read_bytes()


def test_poses_equal_the_header_to_the_last_digit(data_folder):
    for path in real_recordings(data_folder):
        header = path.read_bytes().partition(b"ElementDataFile")[0].decode("latin-1")
        separator = ":=" if path.suffix == ".nrrd" else "="
        recording = read_recording(path)
        stated = 0
        for line in header.splitlines():
            key, _, text = line.partition(separator)
            if not key.startswith("Seq_Frame") or not key.strip().endswith("Transform"):
                continue
            frame, _, name = key.strip().removeprefix("Seq_Frame").partition("_")
            source, target = name.removesuffix("Transform").split("To")
            matrix = recording.tool(source, target).matrices[int(frame)]
            assert [float(word) for word in text.split()] == matrix.ravel().tolist()
            stated += 1
        assert stated == sum(len(poses) for poses in recording.poses.values())


def test_frames_equal_those_of_simpleitk(data_folder):
    sitk = pytest.importorskip("SimpleITK", reason="SimpleITK, the oracle of MetaIO, is not installed")
    for path in sorted((data_folder / "recordings").glob("*.mha")):
        recording = read_recording(path)
        if recording.image is None:
            continue  # SimpleITK cannot read recordings of a tracker alone
        theirs = sitk.GetArrayFromImage(sitk.ReadImage(path))
        ours = np.stack(list(recording.frames))
        np.testing.assert_array_equal(ours.reshape(theirs.shape), theirs)


def test_frames_equal_those_of_pynrrd(data_folder):
    nrrd = pytest.importorskip("nrrd", reason="pynrrd, the oracle of NRRD, is not installed")
    for path in sorted((data_folder / "recordings").glob("*.nrrd")):
        theirs = nrrd.read(str(path))[0].T
        ours = np.stack(list(read_recording(path).frames))
        np.testing.assert_array_equal(ours.reshape(theirs.shape), theirs)


@pytest.mark.parametrize("channels", [1, 3])
def test_other_programs_read_what_is_written(tmp_path, channels):
    sitk = pytest.importorskip("SimpleITK", reason="SimpleITK, the oracle of MetaIO, is not installed")
    nrrd = pytest.importorskip("nrrd", reason="pynrrd, the oracle of NRRD, is not installed")
    recording = random_recording(3, n=4, size=(6, 5), dtype="uint16", channels=channels)
    pixels = np.stack(list(recording.frames))
    write_recording(recording, tmp_path / "a.mha")
    np.testing.assert_array_equal(sitk.GetArrayFromImage(sitk.ReadImage(tmp_path / "a.mha")), pixels)
    write_recording(recording, tmp_path / "a.nrrd")
    theirs = nrrd.read(str(tmp_path / "a.nrrd"))[0]  # (channel, u, v, frame)
    ours = pixels[..., None] if channels == 1 else pixels
    np.testing.assert_array_equal(theirs.T.reshape(ours.shape), ours)


def test_sequences_of_other_writers_are_read(tmp_path):
    sitk = pytest.importorskip("SimpleITK", reason="SimpleITK, the oracle of MetaIO, is not installed")
    volume = np.arange(24, dtype=np.int16).reshape(2, 3, 4)
    sitk.WriteImage(sitk.GetImageFromArray(volume), tmp_path / "v.mha", useCompression=True)
    recording = read_recording(tmp_path / "v.mha")
    assert recording.image.size_px == (4, 3, 2)
    np.testing.assert_array_equal(recording.frames[0], volume)


def test_tracker_alone(data_folder):
    recording = read_recording(
        data_folder / "recordings" / "EightLandmarkPointsTrackedForPhantomRegistration.igs.mha"
    )
    assert (len(recording), len(recording.frames), recording.image) == (1000, 0, None)
    assert recording.tools == ("Reference", "Stylus")
    assert recording.tool("stylus").valid.all()
    assert recording.times[0] == 280.4611428572264


def test_invalid_status_is_believed_over_the_matrix(data_folder):
    recording = read_recording(data_folder / "recordings" / "NwirePhantomFreehand.igs.mha")
    stylus = recording.poses["tracker_from_stylus"]
    assert np.isfinite(stylus.matrices).all()
    assert not stylus.valid.any()


def test_a_list_axis_without_fields_is_a_volume(data_folder):
    recording = read_recording(data_folder / "recordings" / "NwirePhantomFreehandReconstructed.mha")
    assert (len(recording), recording.image.size_px, recording.image.spacing_mm) == (
        1,
        (101, 104, 74),
        (0.5,) * 3,
    )


@pytest.mark.parametrize("suffix", (".mha", ".nrrd"))
def test_frames_come_in_any_order(tmp_path, suffix):
    recording = random_recording(1, n=60, size=(8, 6))
    write_recording(recording, tmp_path / f"a{suffix}")
    frames = read_recording(tmp_path / f"a{suffix}").frames
    for index in np.random.default_rng(0).integers(-60, 60, 100).tolist():
        np.testing.assert_array_equal(frames[index], recording.frames[index])
    np.testing.assert_array_equal(np.stack(list(frames[50:3:-7])), np.stack(list(recording.frames[50:3:-7])))
    with pytest.raises(IndexError, match="frame 60 of 60"):
        frames[60]


@pytest.mark.parametrize("suffix", (".mha", ".nrrd"))
@pytest.mark.parametrize("compress", [True, False])
def test_streaming_holds_one_frame(tmp_path, suffix, compress):
    """Beside the frame there is room for the decoder's window and a little of the file."""
    write_recording(random_recording(1, n=6, size=(1200, 1000)), tmp_path / f"a{suffix}", compress)
    recording = read_recording(tmp_path / f"a{suffix}")
    frame_bytes = recording.frames.frame_bytes
    tracemalloc.start()
    for frame in recording.frames:
        assert frame.nbytes == frame_bytes
        del frame  # what the caller keeps is the caller's
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < frame_bytes + 200_000


def test_frames_cannot_be_written_to(tmp_path):
    write_recording(random_recording(1), tmp_path / "a.mha")
    with pytest.raises(ValueError, match="read-only"):
        read_recording(tmp_path / "a.mha").frames[0][0, 0] = 1


def test_big_endian_pixels_are_turned(tmp_path):
    pixels = np.arange(12, dtype=">u2").reshape(2, 2, 3)
    header = "ObjectType = Image\nNDims = 3\nBinaryDataByteOrderMSB = True\nDimSize = 3 2 2\nElementType = MET_USHORT\n"
    header += "Seq_Frame0000_Timestamp = 0\nSeq_Frame0001_Timestamp = 1\nElementDataFile = LOCAL\n"
    (tmp_path / "a.mha").write_bytes(header.encode() + pixels.tobytes())
    head = "NRRD0004\ntype: uint16\ndimension: 3\nsizes: 3 2 2\nkinds: domain domain list\n"
    head += "endian: big\nencoding: raw\n\n"
    (tmp_path / "a.nrrd").write_bytes(head.encode() + pixels.tobytes())
    for name in ("a.mha", "a.nrrd"):
        np.testing.assert_array_equal(np.stack(list(read_recording(tmp_path / name).frames)), pixels)


@pytest.mark.parametrize("list_first", [True, False])
def test_slicer_sequences_have_their_index_as_time(tmp_path, list_first):
    nrrd = pytest.importorskip("nrrd", reason="pynrrd, the oracle of NRRD, is not installed")
    frames = np.random.default_rng(0).integers(0, 255, (3, 5, 4), dtype=np.uint8)  # frame, v, u
    stored = frames.transpose(2, 1, 0)[:, :, None, :]  # u, v, one slice, frame
    axis, kinds = 3, ["domain", "domain", "domain", "list"]
    if list_first:
        stored, axis, kinds = np.moveaxis(stored, 3, 0), 0, ["list", "domain", "domain", "domain"]
    header = {"kinds": kinds, f"axis {axis} index type": "numeric", f"axis {axis} index values": "0.5 1.5 4"}
    nrrd.write(str(tmp_path / "a.seq.nrrd"), stored, header)
    recording = read_recording(tmp_path / "a.seq.nrrd")
    assert recording.times.tolist() == [0.5, 1.5, 4.0]
    assert recording.image.size_px == (4, 5)
    np.testing.assert_array_equal(np.stack(list(recording.frames)), frames)


def test_detached_nrrd(tmp_path):
    nrrd = pytest.importorskip("nrrd", reason="pynrrd, the oracle of NRRD, is not installed")
    volume = np.arange(24, dtype=np.uint8).reshape(2, 3, 4)
    nrrd.write(str(tmp_path / "a.nhdr"), volume, {"encoding": "raw"})
    recording = read_recording(tmp_path / "a.nhdr")
    np.testing.assert_array_equal(recording.frames[0].T, volume)
    assert len(recording.provenance.paths) == 2


def test_nothing_is_left_of_a_failed_writing(tmp_path):
    recording = random_recording(1)
    with pytest.raises(InputError, match="holds a line break"):
        write_recording(replace(recording, fields={"Note": "two\nlines"}), tmp_path / "a.mha")
    with pytest.raises(UnsupportedError, match=r"recordings are written as \.mha, .*\.csv or \.mkv"):
        write_recording(recording, tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_images_of_which_nothing_is_known_stay_a_sequence(tmp_path, suffix):
    frames = random_recording(0, n=3).frames
    recording = Recording(times=np.full(3, np.nan), frames=frames, image=ImageGeometry.of(frames))
    write_recording(recording, tmp_path / f"a{suffix}")
    again = read_recording(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(np.stack(list(again.frames)), np.stack(list(frames)))
    assert np.isnan(again.times).all()


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("code", ["UF", "UN", "FM", "XX"])
def test_what_was_turned_to_mf_is_written_as_mf(tmp_path, suffix, code):
    """Flips are applied once: the file written says how its images lie now."""
    path, _ = stored_file(tmp_path, code, (4, 3))
    recording = read_recording(path)
    write_recording(recording, tmp_path / f"b{suffix}")
    again = read_recording(tmp_path / f"b{suffix}")
    assert_same(recording, again)
    assert again.image.orientation == ("XX" if code == "XX" else "MF")
    assert again.image.spacing_mm == recording.image.spacing_mm
    np.testing.assert_array_equal(again.image.image_from_file, np.eye(4))


def plain_mha(path, sizes, lines, pixels=None):
    """A MetaIO file as other programs write it: these sizes, these lines before the data."""
    pixels = np.arange(np.prod(sizes), dtype=np.uint8) if pixels is None else pixels
    head = f"ObjectType = Image\nNDims = {len(sizes)}\nDimSize = {' '.join(map(str, sizes))}\nElementType = MET_UCHAR\n"
    path.write_bytes((head + "".join(f"{line}\n" for line in lines) + "ElementDataFile = LOCAL\n").encode())
    with path.open("ab") as file:
        file.write(pixels.tobytes())
    return pixels


@pytest.mark.parametrize("digits", [1, 4, 10, 18])
def test_frame_numbers_may_have_any_number_of_digits(tmp_path, digits):
    lines = [f"Seq_Frame{i:0{digits}d}_Timestamp = {i}.5" for i in range(3)]
    plain_mha(tmp_path / "a.igs.mha", (2, 2, 3), ["Kinds = domain domain list", *lines])
    recording = read_recording(tmp_path / "a.igs.mha")
    assert recording.times.tolist() == [0.5, 1.5, 2.5]


@pytest.mark.parametrize("number", ["9" * 10, "9" * 18, "9" * 19, "0x1"])
def test_a_frame_number_that_no_frame_has_is_refused(tmp_path, number):
    plain_mha(tmp_path / "a.igs.mha", (2, 2, 3), [f"Seq_Frame{number}_Timestamp = 1"])
    with pytest.raises(FormatError, match=r"header (describes frame|field)"):
        read_recording(tmp_path / "a.igs.mha")


def test_three_domains_with_fields_of_one_item_are_a_volume(tmp_path):
    lines = [
        "Kinds = domain domain domain",
        "UltrasoundImageOrientation = MFA",
        "Seq_Frame0000_ImageStatus = OK",
    ]
    pixels = plain_mha(tmp_path / "a.mha", (4, 3, 5), lines)
    recording = read_recording(tmp_path / "a.mha")
    assert (len(recording), recording.image.size_px) == (1, (4, 3, 5))
    np.testing.assert_array_equal(recording.frames[0].ravel(), pixels)
    write_recording(recording, tmp_path / "b.mha")
    assert_same(recording, read_recording(tmp_path / "b.mha"))


def test_fields_of_as_many_items_as_the_third_domain_is_long_are_of_a_sequence(tmp_path):
    lines = ["Kinds = domain domain domain", *(f"Seq_Frame{i:04d}_Timestamp = {i}" for i in range(5))]
    plain_mha(tmp_path / "a.mha", (4, 3, 5), lines)
    recording = read_recording(tmp_path / "a.mha")
    assert (len(recording), recording.image.size_px) == (5, (4, 3))


@given(
    n=st.integers(1, 4),
    size=st.tuples(st.integers(1, 5), st.integers(1, 5)),
    orientation=st.sampled_from(["MF", "UNA"]),
)
def test_four_axes_of_which_the_third_is_a_single_slice_are_images(tmp_path_factory, n, size, orientation):
    """SimpleITK says the same pixels; the geometry of four axes goes, since images are written with three."""
    sitk = pytest.importorskip("SimpleITK", reason="SimpleITK, the oracle of MetaIO, is not installed")
    folder = tmp_path_factory.mktemp("slices")
    lines = [
        "Kinds = domain domain domain list",
        "Offset = 0 0 0 7",
        f"UltrasoundImageOrientation = {orientation}",
    ]
    lines += [f"Seq_Frame{i:04d}_Timestamp = {i}" for i in range(n)]
    plain_mha(folder / "a.seq.mha", (*size, 1, n), lines)
    recording = read_recording(folder / "a.seq.mha")
    assert (len(recording), recording.image.size_px, recording.image.dimension) == (n, size, 2)
    theirs = sitk.GetArrayFromImage(sitk.ReadImage(folder / "a.seq.mha"))[:, 0]
    turned = theirs if orientation == "MF" else theirs[:, ::-1, ::-1]
    np.testing.assert_array_equal(np.stack(list(recording.frames)), turned)
    write_recording(recording, folder / "b.mha")
    assert_same(recording, read_recording(folder / "b.mha"))
    assert sitk.ReadImage(folder / "b.mha").GetSize() == (*size, n)


NO_NUMBERS = [
    "1.#QNAN",
    "-1.#IND",
    "1.#QNAN0",
    "-1.#IND00",
    "1.#SNAN",
    "1.#INF",
    "-1.#J",
    "nan(ind)",
    "-nan(IND)",
    "nan",
]


@pytest.mark.parametrize("suffix", [".mha", ".nrrd"])
@given(
    words=st.lists(st.sampled_from(NO_NUMBERS), min_size=1, max_size=16),
    statuses=st.tuples(*[st.sampled_from(["OK", "INVALID"])] * 3),
    which=st.integers(0, 2),
)
def test_what_is_no_number_is_an_invalid_pose_however_it_is_spelt(
    tmp_path_factory, suffix, words, statuses, which
):
    folder = tmp_path_factory.mktemp("msvc")
    write_recording(random_recording(0, n=3, size=None, tools=("Probe",)), folder / "sound.mha")
    sound = read_recording(folder / "sound.mha").poses["tracker_from_probe"]
    texts = [" ".join(map(repr, m.ravel().tolist())) for m in sound.matrices]
    texts[which] = " ".join([*words, *texts[which].split()[len(words) :]])
    fields = {f"{i:04d}_ProbeToTrackerTransform": texts[i] for i in range(3)}
    fields |= {f"{i:04d}_ProbeToTrackerTransformStatus": statuses[i] for i in range(3)}
    path = folder / f"a{suffix}"
    if suffix == ".mha":
        lines = [f"Seq_Frame{key} = {text}" for key, text in fields.items()]
        plain_mha(path, (0, 0, 3), lines)
    else:
        head = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 0 0 3\nkinds: domain domain list\nencoding: raw\n"
        path.write_text(head + "".join(f"Seq_Frame{key}:={text}\n" for key, text in fields.items()) + "\n")
    poses = read_recording(path).poses["tracker_from_probe"]
    wanted = [statuses[i] == "OK" and i != which for i in range(3)]
    assert poses.valid.tolist() == wanted
    for i in {0, 1, 2} - {which}:
        np.testing.assert_array_equal(poses.matrices[i], sound.matrices[i])
    assert not np.isfinite(poses.matrices[which]).all()
