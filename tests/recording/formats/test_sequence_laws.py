"""Whatever a recording holds, a sequence file gives it back to the last bit, or is refused before it is written."""

import numpy as np
import pytest
from hypothesis import given, settings

from sonocal import InputError
from sonocal.recording.formats import read_recording, write_recording
from tests.builders.strategies import HOSTILE, recordings

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
@settings(max_examples=80)
@given(recording=recordings())
def test_any_recording_is_read_as_it_was_written(tmp_path_factory, suffix, recording):
    path = tmp_path_factory.mktemp("written") / f"sweep{suffix}"
    write_recording(recording, path)
    assert_read_as_written(recording, read_recording(path))


@pytest.mark.parametrize("suffix", SUFFIXES)
@settings(max_examples=150)
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
