# ruff: noqa: E501 - sentences are compared whole
from pathlib import Path

import numpy as np
import pytest

from sonocal import FormatError, InputError, UnsupportedError
from sonocal.recording import health
from sonocal.recording.formats import read_recording
from sonocal.targets import read_device_set
from tests.builders.damaged import FILES

HERE = Path(__file__).parent

# What follows the file's name.
SENTENCES = {
    "cut_file.igs.mha": (
        FormatError,
        ": states 32 compressed bytes but holds 23; it was cut short, copy or record it again",
    ),
    "cut_stream.igs.mha": (FormatError, ": its compressed pixels lack their end; copy or record it again"),
    "wrong_checksum.igs.mha": (
        FormatError,
        ", frame 1: its compressed pixels are damaged (incorrect data check); copy or record it again",
    ),
    "more_pixels.igs.mha": (
        FormatError,
        ": holds more pixels than the 2 frames its header states; correct the header's size",
    ),
    "fewer_pixels.igs.mha": (
        FormatError,
        ": holds 23 bytes of pixels where its header asks for 24 (2 frames of 3x4 uint8); record or copy it again",
    ),
    "overflowing_size.igs.mha": (
        UnsupportedError,
        ": one frame of 4294967296x4294967296 uint8 takes 18446744073709551616 bytes, more than the 4294967296 that sonocal reads; is the header damaged?",
    ),
    "overflowing_count.igs.mha": (
        FormatError,
        ": DimSize = '4 3 18446744073709551616' is not of whole numbers",
    ),
    "absurd_size.igs.mha": (
        FormatError,
        ": 32 compressed bytes cannot hold the 2 frames of 40000x40000 that its header states; is the size right?",
    ),
    "absurd_count.igs.mha": (
        FormatError,
        ": states 999999999 frames, more than any recording; is it damaged?",
    ),
    "undescribed_count.igs.mha": (
        FormatError,
        ": states 1000 frames but describes 2; it was cut short, copy it again",
    ),
    "negative_size.igs.mha": (FormatError, ": its size -4 3 2 has a negative number; is it damaged?"),
    "zero_frames.igs.mha": (InputError, ": has zero frames; record it again"),
    "no_end.igs.mha": (
        FormatError,
        ": its header ends without ElementDataFile; it was cut short, copy it again",
    ),
    "latin_1.igs.mha": (FormatError, ", line 6: is not UTF-8 text; a MetaIO header is"),
    "pixels_for_header.igs.mha": (
        FormatError,
        ", line 1: is not text; a MetaIO header ends with ElementDataFile",
    ),
    "duplicate_frame.igs.mha": (FormatError, ", frame 1: Timestamp stands twice in the header; delete one"),
    "missing_frame.igs.mha": (
        InputError,
        ", frame 1: has no Timestamp where 1 of 2 frames have; the header lacks it, record or export again",
    ),
    "frame_beyond_size.igs.mha": (
        FormatError,
        ": the header describes frame 2 but states 2 frames; correct the size or the field numbers",
    ),
    "short_pose.igs.mha": (
        FormatError,
        ", frame 0: ProbeToTrackerTransform has 15 numbers where a pose has 16",
    ),
    "word_in_pose.igs.mha": (
        FormatError,
        ", frame 0: ProbeToTrackerTransform is not of numbers (could not convert string to float: 'one')",
    ),
    "infinite_time.igs.mha": (FormatError, ", frame 1: Timestamp 'inf' is not a finite number of seconds"),
    "text_pixels.mha": (
        UnsupportedError,
        ": ElementType 'MET_STRING' is not one of MET_UCHAR, MET_CHAR, MET_USHORT, MET_SHORT, MET_UINT, MET_INT, MET_ULONG_LONG, MET_LONG_LONG, MET_FLOAT, MET_DOUBLE",
    ),
    "outside.mhd": (
        FormatError,
        ": its data file '../../../etc/passwd' lies outside the header's folder; move it beside the header and name it there",
    ),
    "absolute.mhd": (
        FormatError,
        ": its data file '/etc/passwd' lies outside the header's folder; move it beside the header and name it there",
    ),
    "missing_raw.mhd": (
        FormatError,
        ": its data file missing_raw.raw is not beside it; copy both files together",
    ),
    "long_header.mhd": (FormatError, ": HeaderSize 99999 does not fit the 24 bytes of long_header.raw"),
    "cut_gzip.igs.nrrd": (FormatError, ": its compressed pixels lack their end; copy or record it again"),
    "wrong_size.igs.nrrd": (
        FormatError,
        ": holds 24 bytes of pixels where its header asks for 32 (2 frames of 4x4 uint8); record or copy it again",
    ),
    "no_end.igs.nrrd": (
        FormatError,
        ", frame 0: its compressed pixels end early, 0 of 12 bytes; copy or record it again",
    ),
    "unknown_encoding.igs.nrrd": (UnsupportedError, ": encoding 'bzip2' cannot be read; use raw or gzip"),
    "outside.nhdr": (
        FormatError,
        ": its data file '../../../etc/passwd' lies outside the header's folder; move it beside the header and name it there",
    ),
    "no_dimension.nrrd": (FormatError, ": the header lacks 'dimension', which every NRRD file has"),
    "bomb.xml": (
        FormatError,
        ": declares a document type or entities, which a device set never needs; delete them",
    ),
    "external_entity.xml": (
        FormatError,
        ": declares a document type or entities, which a device set never needs; delete them",
    ),
}
READ_WITH_A_FINDING = {"nan_pose.igs.mha": "invalid-poses", "non_rigid_pose.igs.mha": "non-rigid-poses"}


def read_whole(path):
    if path.suffix == ".xml":
        return read_device_set(path)
    recording = read_recording(path)
    assert sum(1 for _ in recording.frames) == len(recording.frames)
    return recording


def test_the_files_are_what_the_script_makes():
    assert {p.name: p.read_bytes() for p in HERE.iterdir() if p.suffix not in (".py", ".md", "")} == FILES


@pytest.mark.parametrize("name", SENTENCES)
def test_refused_with_one_sentence(name):
    kind, sentence = SENTENCES[name]
    with pytest.raises(InputError if issubclass(kind, InputError) else UnsupportedError) as caught:
        read_whole(HERE / name)
    assert str(caught.value) == name + sentence
    assert type(caught.value) is kind


@pytest.mark.parametrize("name", READ_WITH_A_FINDING)
def test_damage_of_single_poses_is_a_finding(name):
    recording = read_whole(HERE / name)
    assert READ_WITH_A_FINDING[name] in [d.code for d in health(recording)]
    usable = recording.between("Tracker", "Probe", on_invalid="skip")
    assert usable.valid.tolist() == [False, True]
    assert np.isnan(usable.matrices[0]).all()


def test_every_file_is_tested():
    assert {*SENTENCES, *READ_WITH_A_FINDING, "long_header.raw"} == set(FILES)
