"""Scenes of 3D Slicer."""

import gc
import struct
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sonocal import FormatError, InputError, SonocalError
from sonocal.recording.formats import read_recording
from tests.builders.recordings import random_pixels, random_poses
from tests.builders.scenes import image_sequence, scene_document, transform_sequence, write_scene

N = 7
TIMES = np.round(3 + 0.1 * np.arange(N), 3)
PROBE, NEEDLE = random_poses(np.random.default_rng(0), 2 * N).reshape(2, N, 4, 4)
PIXELS = random_pixels(np.random.default_rng(1), (N, 5, 6), "uint8")
VALID = np.arange(N) != 4
FILES = {
    "Image sequence.seq.nrrd": image_sequence(TIMES, PIXELS),
    "ProbeToTracker-Sequence.seq.mha": transform_sequence("ProbeToTracker", TIMES, PROBE, VALID),
    "NeedleToTracker.seq.mha": transform_sequence("NeedleToTracker", TIMES + 0.05, NEEDLE),
}


OUTSIDE = [
    "../secret.seq.mha",
    "/etc/passwd",
    "Data/../../secret.seq.mha",
    "%2e%2e/secret.seq.mha",
    "Data\\..\\..\\secret.seq.mha",
]


@pytest.fixture
def scratch(tmp_path, monkeypatch):
    """Where temporary files go."""
    home = tmp_path / "scratch"
    home.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(home))
    return home


@pytest.mark.parametrize("name", ["a.mrb", "a.mrml"])
def test_a_scene_is_a_recording(tmp_path, scratch, name):
    write_scene(tmp_path / name, FILES)
    recording = read_recording(tmp_path / name)
    np.testing.assert_array_equal(recording.times, TIMES)
    np.testing.assert_array_equal(list(recording.frames), PIXELS)
    assert recording.image.size_px == (6, 5)
    probe, needle = recording.poses["tracker_from_probe"], recording.poses["tracker_from_needle"]
    np.testing.assert_array_equal(probe.matrices, PROBE)
    np.testing.assert_array_equal(probe.valid, VALID)
    assert np.flatnonzero(~needle.valid).tolist() == [0]  # before its first pose
    np.testing.assert_allclose(needle.matrices[3, :3, 3], NEEDLE[2:4, :3, 3].mean(axis=0))


def test_what_a_mac_puts_beside_each_file_is_no_scene(tmp_path, scratch):
    write_scene(tmp_path / "a.mrb", FILES)
    with zipfile.ZipFile(tmp_path / "a.mrb", "a") as archive:
        for name in archive.namelist():
            archive.writestr(f"__MACOSX/{Path(name).parent}/._{Path(name).name}", b"\0\5\26\7")
    np.testing.assert_array_equal(list(read_recording(tmp_path / "a.mrb").frames), PIXELS)


@pytest.mark.parametrize("document", ["Data/", "Data\\"])
def test_backslashes_between_folders_are_slashes(tmp_path, scratch, document):
    """Old programs of Windows zip so; the document may say either."""
    write_scene(tmp_path / "plain.mrb", FILES, scene_document(FILES, document))
    with (
        zipfile.ZipFile(tmp_path / "plain.mrb") as plain,
        zipfile.ZipFile(tmp_path / "a.mrb", "w") as archive,
    ):
        for name in plain.namelist():
            archive.writestr(name.replace("/", "\\"), plain.read(name))
    np.testing.assert_array_equal(list(read_recording(tmp_path / "a.mrb").frames), PIXELS)
    write_scene(tmp_path / "a.mrml", FILES, scene_document(FILES, document))
    if (tmp_path / "Data").is_dir():
        np.testing.assert_array_equal(list(read_recording(tmp_path / "a.mrml").frames), PIXELS)


def test_temporary_files_go_with_the_frames(tmp_path, scratch):
    write_scene(tmp_path / "a.mrb", FILES)
    recording = read_recording(tmp_path / "a.mrb")
    part = recording.frames[2:5]
    del recording
    gc.collect()
    np.testing.assert_array_equal(list(part), PIXELS[2:5])
    assert list(scratch.iterdir())
    del part
    gc.collect()
    assert not list(scratch.iterdir())


def test_a_scene_of_transforms_alone_has_all_their_instants(tmp_path, scratch):
    write_scene(tmp_path / "a.mrb", {name: FILES[name] for name in list(FILES)[1:]})
    recording = read_recording(tmp_path / "a.mrb")
    assert (len(recording), recording.image) == (2 * N, None)
    np.testing.assert_array_equal(recording.poses["tracker_from_probe"].matrices[::2][VALID], PROBE[VALID])
    assert not list(scratch.iterdir())


def sentence(path, kind=InputError):
    with pytest.raises(kind) as caught:
        read_recording(path)
    return str(caught.value)


def test_what_cannot_be_chosen_or_is_not_there_is_named(tmp_path, scratch):
    write_scene(tmp_path / "a.mrb", {"A.seq.nrrd": FILES["Image sequence.seq.nrrd"]} | FILES)
    assert sentence(tmp_path / "a.mrb") == (
        "a.mrb: has 2 sequences of images, A.seq.nrrd, Image sequence.seq.nrrd; save it with the one to read"
    )
    write_scene(tmp_path / "b.mrb", {})
    assert sentence(tmp_path / "b.mrb") == (
        "b.mrb: has no sequences; record images and transforms with Slicer's Sequences"
    )
    write_scene(tmp_path / "c.mrb", {"L.seq.mha": transform_sequence("LinearTransform_3", TIMES, PROBE)})
    assert sentence(tmp_path / "c.mrb") == (
        "c.mrb: its transforms, L.seq.mha, do not say from where to where; call them such as ProbeToTracker"
    )
    write_scene(tmp_path / "d.mrml", {"L.vtk": b"hello"})
    assert "its sequence 'L.vtk' is no NRRD" in sentence(tmp_path / "d.mrml", SonocalError)
    with zipfile.ZipFile(tmp_path / "e.mrb", "w") as archive:
        archive.writestr("hello.txt", "hello")
    assert sentence(tmp_path / "e.mrb") == "e.mrb: has 0 files .mrml where a scene of 3D Slicer has one"
    assert not list(scratch.iterdir())


@pytest.mark.parametrize("suffix", [".mrb", ".mrml"])
@pytest.mark.parametrize(
    "name",
    [
        "../secret.seq.mha",
        "/etc/passwd",
        "Data/../../secret.seq.mha",
        "%2e%2e/secret.seq.mha",
        "Data\\..\\..\\secret.seq.mha",
    ],
)
def test_no_file_outside_of_a_scene_is_read(tmp_path, scratch, suffix, name):
    (tmp_path / "secret.seq.mha").write_bytes(FILES["NeedleToTracker.seq.mha"])
    home = tmp_path / "home"
    home.mkdir()
    document = f'<MRML><LinearTransformSequenceStorage fileName="{name}" /></MRML>'
    write_scene(home / f"a{suffix}", {}, document)
    assert "lies outside the header's folder" in sentence(home / f"a{suffix}", FormatError)


def test_archives_that_would_fill_the_disk_are_refused(tmp_path, scratch):
    write_scene(tmp_path / "a.mrb", {"Image.seq.nrrd": bytes(80 << 20)})
    assert "Image.seq.nrrd states 83886080 bytes in " in sentence(tmp_path / "a.mrb", FormatError)
    write_scene(tmp_path / "b.mrb", FILES)
    content = (tmp_path / "b.mrb").read_bytes()
    place = content.index(b"PK\1\2", content.index(b"PK\1\2") + 1)  # of the first sequence in the directory
    (tmp_path / "b.mrb").write_bytes(
        content[: place + 24] + struct.pack("<I", 1 << 31) + content[place + 28 :]
    )
    assert "Image sequence.seq.nrrd states 2147483648 bytes in " in sentence(tmp_path / "b.mrb", FormatError)
    assert not list(scratch.iterdir())


def test_a_document_with_entities_is_refused(tmp_path):
    document = '<!DOCTYPE a [<!ENTITY a "ha">]>' + scene_document([])
    write_scene(tmp_path / "a.mrb", {}, document)
    assert sentence(tmp_path / "a.mrb", FormatError) == (
        "a.mrb: declares a document type or entities, which a scene of 3D Slicer never needs; delete them"
    )


def test_an_archive_that_was_cut_anywhere_ends_in_a_sentence(tmp_path, scratch):
    write_scene(tmp_path / "a.mrb", FILES)
    content = Path(tmp_path / "a.mrb").read_bytes()
    for length in np.linspace(1, len(content) - 1, 50).astype(int):
        (tmp_path / "cut.mrb").write_bytes(content[:length])
        text = sentence(tmp_path / "cut.mrb", SonocalError)
        assert text.startswith("cut.mrb")
        assert "\n" not in text
    assert not list(scratch.iterdir())


def test_sequences_without_times_are_matched_by_their_order_alone(tmp_path, scratch):
    pixels = image_sequence(TIMES, PIXELS).replace(b"axis 3 index type:=numeric", b"axis 3 index type:=text")
    whole = transform_sequence("ProbeToTracker", TIMES, PROBE)
    write_scene(tmp_path / "a.mrb", {"I.seq.nrrd": pixels, "P.seq.mha": whole})
    np.testing.assert_array_equal(
        read_recording(tmp_path / "a.mrb").poses["tracker_from_probe"].matrices, PROBE
    )
    part = transform_sequence("ProbeToTracker", TIMES[:3], PROBE[:3])
    write_scene(tmp_path / "b.mrb", {"I.seq.nrrd": pixels, "P.seq.mha": part})
    assert sentence(tmp_path / "b.mrb") == (
        "b.mrb: P.seq.mha has 3 items where 7 are due, and no times to match them by"
    )


CONSTANT = [
    ("StylusTipToProbe", PROBE[0]),
    ("TrackerToRasTransform", NEEDLE[0]),
    ("LinearTransform_4", PROBE[1]),
]
LAST_POSES = [("ProbeToTracker", PROBE[-1]), ("OtherToTracker", NEEDLE[-1])]


@pytest.mark.parametrize("name", ["a.mrb", "a.mrml"])
def test_transforms_that_stand_once_hold_for_all_items(tmp_path, scratch, name):
    folder = "Data/" if name == "a.mrb" else ""
    write_scene(tmp_path / name, FILES, scene_document(FILES, folder, [*CONSTANT, *LAST_POSES]))
    recording = read_recording(tmp_path / name)
    assert {*recording.poses} == {
        "tracker_from_probe",
        "tracker_from_needle",
        "probe_from_stylus_tip",
        "ras_from_tracker",
    }
    np.testing.assert_allclose(recording.tool("StylusTip", "Probe").matrices, [PROBE[0]] * N, rtol=2e-5)
    tip = recording.between("Tracker", "StylusTip")
    np.testing.assert_allclose(tip.matrices[VALID], (PROBE @ PROBE[0])[VALID], atol=1e-2)
    note = next(one for one in recording.diagnostics if one.code == "constant-transforms")
    assert note.message.startswith("StylusTipToProbe, TrackerToRas: one matrix")


def test_transforms_of_a_scene_that_are_none_are_named(tmp_path, scratch):
    def refused(*constant):
        write_scene(tmp_path / "a.mrml", FILES, scene_document(FILES, "", constant))
        return sentence(tmp_path / "a.mrml")

    assert refused(("AToProbe", np.eye(3))).startswith(
        "a.mrml: the matrix of AToProbe is not 16 numbers ('1 0 0"
    )
    assert "is not 16 numbers" in refused(("AToProbe", np.full((4, 4), 1e300)))
    assert refused(("AToProbe", PROBE[0]), ("AToProbe", PROBE[1])) == (
        "a.mrml: has two transforms AToProbe that differ; delete one in Slicer"
    )
    assert "more than 100 transforms" in refused(*((f"A{i}ToProbe", PROBE[0]) for i in range(101)))
