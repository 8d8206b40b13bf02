"""Frames are a sequence like a list, and are read only when asked for."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import InputError
from sonocal.recording import ArrayFrames, Frames, ImageGeometry, Poses, Recording
from sonocal.recording.frames import MappedFrames, SelectedFrames
from tests.builders.recordings import random_recording

COUNT = 9
slices = st.builds(
    slice,
    st.none() | st.integers(-12, 12),
    st.none() | st.integers(-12, 12),
    st.none() | st.sampled_from([-3, -2, -1, 1, 2, 4]),
)


class Watched(Frames):
    """Frames that say which of them were read."""

    def __init__(self, count=COUNT):
        self.shape, self.dtype, self.count, self.read_ones = (3, 4), np.dtype(np.uint8), count, []

    def __len__(self):
        return self.count

    def read(self, index):
        assert 0 <= index < self.count
        self.read_ones.append(index)
        return np.full(self.shape, index, np.uint8)


def numbers(frames):
    return [int(frame[0, 0]) for frame in frames]


@given(slices, slices)
def test_slices_of_slices_choose_as_those_of_a_list(first, second):
    assert numbers(Watched()[first][second]) == list(range(COUNT))[first][second]


@given(st.integers(-COUNT, COUNT - 1))
def test_one_frame_is_one_read(index):
    frames = Watched()
    assert int(frames[index][0, 0]) == range(COUNT)[index]
    assert frames.read_ones == [index % COUNT]


@pytest.mark.parametrize("index", [COUNT, -COUNT - 1, 10**9])
def test_beyond_the_ends_there_is_no_frame_and_none_is_read(index):
    frames = Watched()
    with pytest.raises(IndexError, match=f"frame {index} of {COUNT}"):
        frames[index]
    assert frames.read_ones == []


@given(slices)
def test_choosing_reads_nothing_and_walking_reads_each_once_in_order(chosen):
    frames = Watched()
    part = frames[chosen]
    assert frames.read_ones == []
    assert len(part) == len(range(COUNT)[chosen])
    list(part)
    assert frames.read_ones == list(range(COUNT)[chosen])


@given(st.lists(st.integers(0, COUNT - 1)))
def test_a_change_is_made_to_the_frame_asked_for(chosen):
    frames = Watched()
    changed = MappedFrames(SelectedFrames(frames, chosen), lambda frame: frame.T + 100, (4, 3))
    assert frames.read_ones == []
    for position, index in enumerate(chosen):
        np.testing.assert_array_equal(changed[position], np.full((4, 3), index + 100))
    assert [f.tolist() for f in changed] == [changed[i].tolist() for i in range(len(changed))]


def test_frames_in_memory_cannot_be_written_into_and_their_array_can():
    array = np.zeros((3, 2, 2), np.uint8)
    frames = ArrayFrames(array)
    with pytest.raises(ValueError, match="read-only"):
        frames[0][0, 0] = 1
    array[1, 0, 0] = 7
    assert frames[1][0, 0] == 7


@given(st.integers(0, 1000), st.data())
def test_items_of_a_recording_keep_images_poses_stamps_and_fields_together(seed, data):
    recording = random_recording(seed, n=6)
    rows = data.draw(st.lists(st.integers(0, 5), max_size=6))
    part = recording.select(rows)
    assert len(part) == len(rows)
    for item, row in enumerate(rows):
        assert part.times[item] == recording.times[row]
        np.testing.assert_array_equal(part.frames[item], recording.frames[row])
        assert part.image_valid[item] == recording.image_valid[row]
        for name, poses in recording.poses.items():
            np.testing.assert_array_equal(part.poses[name].matrices[item], poses.matrices[row])
            assert part.poses[name].status[item] == poses.status[row]
            assert part.poses[name].valid[item] == poses.valid[row]
        for name, column in recording.item_fields.items():
            assert part.item_fields[name][item] == column[row]
    assert part.fields == recording.fields


@given(st.integers(0, 1000), st.lists(st.booleans(), min_size=6, max_size=6))
def test_a_mask_chooses_as_its_indices_do(seed, mask):
    recording = random_recording(seed, n=6)
    one, other = recording.select(mask), recording.select(np.flatnonzero(mask))
    np.testing.assert_array_equal(one.times, other.times)
    assert [f.tolist() for f in one.frames] == [f.tolist() for f in other.frames]


@pytest.mark.parametrize("column", ["frames", "image_valid", "poses", "item_fields"])
@pytest.mark.parametrize("count", [3, 5])
def test_a_column_of_another_length_than_the_time_line_is_refused_by_name(column, count):
    frames = ArrayFrames(np.zeros((count, 4, 4), np.uint8))
    made = {
        "frames": {"frames": frames, "image": ImageGeometry.of(frames)},
        "image_valid": {"image_valid": np.ones(count, bool)},
        "poses": {"poses": {"a_from_b": Poses.of("B", "A", np.tile(np.eye(4), (count, 1, 1)))}},
        "item_fields": {"item_fields": {"Depth": ("7",) * count}},
    }
    name = {"poses": "a_from_b", "item_fields": "Depth"}.get(column, column)
    with pytest.raises(InputError, match=f"recording: {name} has {count} entries, the time line 4"):
        Recording(times=np.arange(4.0), **made[column])
