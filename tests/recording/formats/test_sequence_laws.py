"""Whatever a recording holds, a sequence file gives it back to the last bit, or is refused before it is written."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

from sonocal import InputError
from sonocal.recording import Poses, Recording
from sonocal.recording.formats import read_recording, write_recording
from tests.builders.recordings import random_recording
from tests.builders.strategies import HOSTILE, SPECIAL, recordings

SUFFIXES = (".mha", ".mhd", ".nrrd")
STATUS = ("ImageStatus", "Status")


def expected_status(poses):
    """As it is read: said where the recording does not say."""
    if poses.status is not None:
        return poses.status
    return tuple("OK" if ok else "INVALID" for ok in poses.valid)


def stripped(columns):
    """Texts lose the blanks around them; a column without any is none."""
    kept = {name: tuple(text and text.strip() for text in column) for name, column in columns.items()}
    return {name: column for name, column in kept.items() if any(text is not None for text in column)}


def assert_read_as_written(recording, again):
    assert again.times.tobytes() == recording.times.tobytes()
    assert again.poses.keys() == recording.poses.keys()
    for name, one in recording.poses.items():
        other = again.poses[name]
        assert (other.source, other.target) == (one.source, one.target)
        np.testing.assert_array_equal(other.valid, one.valid)
        assert other.matrices.tobytes() == np.where(np.isnan(one.matrices), np.nan, one.matrices).tobytes()
        assert other.status == expected_status(one)
    np.testing.assert_array_equal(again.image_valid, recording.image_valid)
    assert len(again.frames) == len(recording.frames)
    for mine, theirs in zip(recording.frames, again.frames, strict=True):
        assert (theirs.dtype, theirs.shape, theirs.tobytes()) == (mine.dtype, mine.shape, mine.tobytes())
    assert (
        stripped({k: (v,) for k, v in recording.fields.items()}).items()
        <= {k: (v,) for k, v in again.fields.items()}.items()
    )
    wanted = stripped(recording.item_fields)
    assert {k: again.item_fields[k] for k in wanted if k not in STATUS} == {
        k: v for k, v in wanted.items() if k not in STATUS
    }
    if recording.image is not None:
        assert again.image.spacing_mm == recording.image.spacing_mm
        assert again.image.orientation == recording.image.orientation


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=30)
@given(recording=recordings())
def test_any_recording_is_read_as_it_was_written(tmp_path_factory, suffix, recording):
    path = tmp_path_factory.mktemp("written") / f"sweep{suffix}"
    write_recording(recording, path)
    assert_read_as_written(recording, read_recording(path))


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=60)
@given(recording=recordings(names=HOSTILE, frames=HOSTILE, text=HOSTILE))
def test_hostile_names_are_kept_or_refused(tmp_path_factory, suffix, recording):
    folder = tmp_path_factory.mktemp("hostile")
    try:
        write_recording(recording, folder / f"sweep{suffix}")
    except InputError as error:
        assert "\n" not in str(error)
        assert list(folder.iterdir()) == []
        return
    assert_read_as_written(recording, read_recording(folder / f"sweep{suffix}"))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("word", [word for word in SPECIAL if word])
@pytest.mark.parametrize(
    "place", ["name of a field", "field", "name of an item's field", "item's field", "frame"]
)
def test_every_special_word_is_kept_or_refused_in_every_place(tmp_path, suffix, word, place):
    recording = random_recording(0, n=2, tools=())
    probe = Poses.of(word, "Tracker", np.tile(np.eye(4), (2, 1, 1)))
    change = {
        "name of a field": {"fields": {word: "x"}},
        "field": {"fields": {"Note": word}},
        "name of an item's field": {"item_fields": {word: ("x", "y")}},
        "item's field": {"item_fields": {"Note": (word, None)}},
        "frame": {"poses": {probe.name: probe}},
    }[place]
    recording = replace(recording, **change)
    try:
        write_recording(recording, tmp_path / f"a{suffix}")
    except InputError as error:
        assert "\n" not in str(error)
        assert list(tmp_path.iterdir()) == []
    else:
        assert_read_as_written(recording, read_recording(tmp_path / f"a{suffix}"))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_ordinary_words_are_never_refused(tmp_path, suffix):
    """Blanks, brackets, other scripts and numbers are ordinary inside of a name and anywhere in a text."""
    fields = {"Note of Ann": "a: b = c, (d) [e] \u00e4\u00df\u4e2d # 100 %", "type": "3", "kinds": "many"}
    recording = replace(random_recording(0), fields=fields, item_fields={"Force (N)": ("1.5",) * 5})
    write_recording(recording, tmp_path / f"a{suffix}")
    assert_read_as_written(recording, read_recording(tmp_path / f"a{suffix}"))


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("spacing", [None, (0.25, 0.5), (1.0, 1.0)])
@pytest.mark.parametrize("described", [False, True])
def test_a_spacing_is_kept_and_none_is_made_up(tmp_path, suffix, spacing, described):
    """A tracked sequence says 1 for "not known", as PLUS does; a plain image's 1 is one."""
    recording = random_recording(0, n=1)
    recording = replace(recording, image=replace(recording.image, spacing_mm=spacing))
    if not described:
        recording = Recording(times=np.full(1, np.nan), frames=recording.frames, image=recording.image)
    write_recording(recording, tmp_path / f"a{suffix}")
    again = read_recording(tmp_path / f"a{suffix}").image.spacing_mm
    assert again == (None if described and spacing == (1.0, 1.0) else spacing)
    if suffix == ".mha" and spacing is not None:
        header = (tmp_path / "a.mha").read_bytes().partition(b"ElementDataFile")[0].decode()
        lines = dict(line.split(" = ") for line in header.splitlines())
        assert len(lines["ElementSpacing"].split()) == int(lines["NDims"])


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("times", [[0.0, np.nan], [np.inf, 0.0], [0.0, -np.inf]])
def test_times_that_could_not_be_read_are_refused(tmp_path, suffix, times):
    recording = replace(random_recording(0, n=2), times=np.array(times))
    with pytest.raises(InputError, match=r"frame \d: its time is -?(nan|inf) where others have one"):
        write_recording(recording, tmp_path / f"a{suffix}")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("said", [None, "OK", "INVALID", "MISSING"])
@pytest.mark.parametrize("valid", [True, False])
def test_what_is_held_valid_stays_so_whatever_was_said(tmp_path, suffix, said, valid):
    """A pose left out, or an image taken back in, is read as that."""
    recording = random_recording(0, n=2)
    probe = Poses("Probe", "Tracker", np.tile(np.eye(4), (2, 1, 1)), np.full(2, valid), (said,) * 2)
    recording = replace(
        recording,
        poses={probe.name: probe},
        image_valid=np.full(2, valid),
        item_fields={"ImageStatus": (said,) * 2},
    )
    write_recording(recording, tmp_path / f"a{suffix}")
    again = read_recording(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(again.poses[probe.name].valid, probe.valid)
    np.testing.assert_array_equal(again.image_valid, recording.image_valid)
