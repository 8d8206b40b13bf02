"""ROS bags, written by rosbags and read equal."""

import io
import re
import shutil
import sqlite3
import struct
import tracemalloc
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from sonocal import FormatError, InputError, UnsupportedError
from sonocal.recording import health
from sonocal.recording.formats import read_recording, write_recording
from sonocal.recording.formats.parts.mcap import check_mcap_summary
from tests.builders.bags import (
    COMPRESSED,
    FORMS,
    IMAGE,
    POSE,
    STAMPED,
    TF,
    messages_for,
    small_sweep,
    write_bag,
)
from tests.builders.recordings import assert_same, random_pixels, random_poses, random_recording

N = 9
START = 1_700_000_000.25
TIMES = START + 0.1 * np.arange(N)
POSES = random_poses(np.random.default_rng(1), 2 * N + 1)
BASE = random_poses(np.random.default_rng(2), 1)[0]
PIXELS = random_pixels(np.random.default_rng(3), (N, 5, 7), "uint8")


def tracked(messages, images=True):
    """A probe that is tracked at the images' instants and between them, and a camera on a fixed base."""
    stamps = START + 0.05 * np.arange(2 * N + 1)
    entries = [("/tf_static", TF, START - 9, messages.tf(messages.stamped("base", "tracker", 3.0, BASE)))]
    for time, pose in zip(stamps, POSES, strict=True):
        entries.append(
            ("/tf", TF, time + 0.01, messages.tf(messages.stamped("tracker", "us/probe", time, pose)))
        )
    for time, pixels in zip(TIMES if images else [], PIXELS, strict=False):
        entries.append(
            ("/us/image_raw", IMAGE, time + 0.02, messages.image(time, pixels, "mono8", padding=3))
        )
    return sorted(entries, key=lambda one: one[2])


@pytest.mark.parametrize("form", FORMS)
def test_a_bag_of_every_kind_is_read_as_it_was_written(tmp_path, form):
    messages = messages_for(form)
    path = write_bag(tmp_path / "sweep.bag", form, messages, tracked(messages))
    recording = read_recording(path)
    np.testing.assert_allclose(recording.times, TIMES, atol=1e-6)
    probe = recording.poses["tracker_from_us_probe"]
    assert (probe.plus_name, probe.valid.all()) == ("Us_probeToTracker", True)
    np.testing.assert_allclose(probe.matrices, POSES[: 2 * N : 2], atol=1e-6)
    between = recording.between("base", "us_probe")
    np.testing.assert_allclose(between.matrices, BASE @ POSES[: 2 * N : 2], atol=1e-6)
    assert recording.image.size_px == (7, 5)
    np.testing.assert_array_equal(list(recording.frames), PIXELS)
    for index in (7, 8, 2, 3, 0):
        np.testing.assert_array_equal(recording.frames[index], PIXELS[index])


def test_a_bag_without_images_has_an_item_an_instant(tmp_path):
    messages = messages_for("mcap")
    recording = read_recording(write_bag(tmp_path / "a", "mcap", messages, tracked(messages, images=False)))
    assert (len(recording), recording.image) == (2 * N + 1, None)
    np.testing.assert_allclose(recording.poses["tracker_from_us_probe"].matrices, POSES, atol=1e-6)
    assert recording.poses["base_from_tracker"].valid.all()


@pytest.mark.parametrize("form", ["1", "mcap"])
def test_stamped_transforms_and_poses_are_edges_like_those_of_tf(tmp_path, form):
    """Repeated stamps are copies; a pose is of what its topic says, in Tracker where its header names no frame."""
    messages = messages_for(form)
    entries = []
    for time, pose in zip(TIMES, POSES[:N], strict=True):
        entries += [
            ("/ndi/needle", STAMPED, time, messages.stamped("ndi", "needle", time, pose)),
            ("/ndi/needle/again", STAMPED, time, messages.stamped("ndi", "needle", time, pose)),
            ("/ndi/stylus/pose", POSE, time, messages.pose("", time, pose)),
        ]
    recording = read_recording(write_bag(tmp_path / "a.bag", form, messages, entries))
    assert set(recording.poses) == {"ndi_from_needle", "tracker_from_stylus"}
    for poses in recording.poses.values():
        np.testing.assert_allclose(poses.matrices, POSES[:N], atol=1e-6)


def test_the_message_of_the_older_tf_is_read(tmp_path):
    messages = messages_for("1")
    kind = "tf/msg/tfMessage"
    entries = [
        ("/tf", kind, t, messages.tf(messages.stamped("a", "b", t, p), kind=kind))
        for t, p in zip(TIMES, POSES, strict=False)
    ]
    recording = read_recording(write_bag(tmp_path / "a.bag", "1", messages, entries))
    np.testing.assert_allclose(recording.poses["a_from_b"].matrices, POSES[:N], atol=1e-6)


def test_an_empty_quaternion_is_a_pose_that_was_not_seen(tmp_path):
    messages = messages_for("mcap")
    entries = tracked(messages, images=False)
    entries[3][3].transforms[0].transform.rotation.w = 0.0
    for axis in "xyz":
        setattr(entries[3][3].transforms[0].transform.rotation, axis, 0.0)
    recording = read_recording(write_bag(tmp_path / "a", "mcap", messages, entries))
    assert np.flatnonzero(~recording.poses["tracker_from_us_probe"].valid).tolist() == [2]


ENCODINGS = {
    "mono8": ("uint8", 1, None),
    "mono16": ("uint16", 1, None),
    "32FC1": ("float32", 1, None),
    "rgb8": ("uint8", 3, [0, 1, 2]),
    "bgr8": ("uint8", 3, [2, 1, 0]),
    "rgba8": ("uint8", 4, [0, 1, 2]),
    "bgra8": ("uint8", 4, [2, 1, 0]),
    "bgr16": ("uint16", 3, [2, 1, 0]),
}


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("encoding", ENCODINGS)
def test_encodings_become_grey_or_red_green_blue(tmp_path, encoding, big):
    messages = messages_for("mcap")
    kind, values, colours = ENCODINGS[encoding]
    pixels = random_pixels(np.random.default_rng(0), (2, 3, 4, values), kind)
    entries = [
        ("/us", IMAGE, t, messages.image(t, one, encoding, padding=5, big=big))
        for t, one in zip(TIMES, pixels, strict=False)
    ]
    recording = read_recording(write_bag(tmp_path / "a", "mcap", messages, entries))
    right = pixels[..., 0] if colours is None else pixels[..., colours]
    assert recording.image.channels == (1 if colours is None else 3)
    for frame, expected in zip(recording.frames, right, strict=True):
        assert frame.dtype == kind
        np.testing.assert_array_equal(frame, expected)


def test_compressed_images_are_read_where_there_are_no_others(tmp_path):
    pillow = pytest.importorskip("PIL.Image", reason="Pillow is not installed")
    messages = messages_for("mcap")
    entries = []
    for time, pixels in zip(TIMES, PIXELS, strict=True):
        content = io.BytesIO()
        pillow.fromarray(pixels).save(content, format="png")
        entries.append(
            ("/us/compressed", COMPRESSED, time, messages.compressed(time, content.getvalue(), "png"))
        )
    recording = read_recording(write_bag(tmp_path / "a", "mcap", messages, entries))
    np.testing.assert_array_equal(list(recording.frames), PIXELS)
    entries += tracked(messages)
    entries = [("/us", *rest) if topic == "/us/image_raw" else (topic, *rest) for topic, *rest in entries]
    read_recording(write_bag(tmp_path / "b", "mcap", messages, sorted(entries, key=lambda one: one[2])))


@pytest.mark.parametrize("form", ["1", "sqlite3", "mcap", "mcap file"])
def test_images_that_were_received_at_one_instant_keep_their_order(tmp_path, form):
    messages = messages_for(form)
    entries = [
        ("/us", IMAGE, START + i // 3, messages.image(t, one, "mono8"))
        for i, (t, one) in enumerate(zip(TIMES, PIXELS, strict=True))
    ]
    recording = read_recording(write_bag(tmp_path / "a.bag", form, messages, entries))
    everything = list(recording.frames)
    np.testing.assert_array_equal(everything, PIXELS)
    for index in (4, 8, 1):
        np.testing.assert_array_equal(recording.frames[index], everything[index])


def sentence(path, kind=InputError):
    with pytest.raises(kind) as caught:
        read_recording(path)
    return str(caught.value)


def test_what_cannot_be_chosen_or_is_not_there_is_named(tmp_path):
    messages = messages_for("mcap")
    image = messages.image(1.0, PIXELS[0], "mono8")
    two = write_bag(tmp_path / "two", "mcap", messages, [("/a", IMAGE, 1, image), ("/b", IMAGE, 1, image)])
    assert sentence(two) == (
        "two: holds images of 2 topics, /a (sensor_msgs/msg/Image), /b (sensor_msgs/msg/Image); write one with the "
        "transforms into a bag of its own: rosbags-convert --include-topic"
    )
    text = messages.make("std_msgs/msg/String", data="hello")
    none = write_bag(tmp_path / "none", "mcap", messages, [("/talk", "std_msgs/msg/String", 1, text)])
    assert sentence(none) == (
        "none: holds neither images nor transforms; its topics are /talk (std_msgs/msg/String)"
    )
    still = messages.tf(messages.stamped("a", "b", 0.0, BASE))
    static = write_bag(tmp_path / "static", "mcap", messages, [("/robot/tf_static", TF, 1, still)])
    assert sentence(static) == (
        "static: holds transforms that never move; its topics are /robot/tf_static (tf2_msgs/msg/TFMessage)"
    )


@pytest.mark.parametrize(
    ("make", "end"),
    [
        (
            lambda m: (IMAGE, m.image(1.0, PIXELS[0], "yuv422")),
            "frame 0: /us has images of encoding 'yuv422'; mono8, 8UC1, mono16, 16UC1, 32FC1, rgb8, bgr8, rgba8, "
            "bgra8, rgb16, bgr16, rgba16, bgra16 are read",
        ),
        (
            lambda m: (COMPRESSED, m.compressed(1.0, b"\0\0\0\1", "h264")),
            "frame 0: /us has images compressed as 'h264'; jpeg and png are read",
        ),
    ],
)
def test_encodings_that_are_not_read_are_named(tmp_path, make, end):
    messages = messages_for("mcap")
    kind, message = make(messages)
    path = write_bag(tmp_path / "a", "mcap", messages, [("/us", kind, 1, message)])
    assert sentence(path, UnsupportedError) == f"a, {end}"


def test_images_that_differ_or_lie_are_refused_with_their_frame(tmp_path):
    messages = messages_for("mcap")
    first, other = messages.image(1.0, PIXELS[0], "mono8"), messages.image(2.0, PIXELS[0].T, "mono8")
    path = write_bag(tmp_path / "a", "mcap", messages, [("/us", IMAGE, 1, first), ("/us", IMAGE, 2, other)])
    with pytest.raises(
        InputError, match=r"a, frame 1: is \(7, 5\) uint8 where the first of /us is \(5, 7\) uint8"
    ):
        list(read_recording(path).frames)
    first.height += 1
    path = write_bag(tmp_path / "b", "mcap", messages, [("/us", IMAGE, 1, first)])
    assert sentence(path) == (
        "b, frame 0: states 7 x 6 px of mono8 in rows of 7 bytes, and has 35 bytes; record it again"
    )


def test_clocks_that_do_not_meet_are_refused(tmp_path):
    messages = messages_for("mcap")
    entries = tracked(messages)
    late = [
        (t, k, r, messages.image(60 + r, PIXELS[0], "mono8") if k == IMAGE else m) for t, k, r, m in entries
    ]
    assert "they do not overlap; bring both to one clock" in sentence(
        write_bag(tmp_path / "a", "mcap", messages, late)
    )
    none = [(t, k, r, messages.image(0.0, PIXELS[0], "mono8") if k == IMAGE else m) for t, k, r, m in entries]
    assert sentence(write_bag(tmp_path / "b", "mcap", messages, none)) == (
        "b: the headers of its images have no stamps, so poses cannot be joined to them; record with a driver that "
        "stamps images"
    )


def test_files_that_are_compressed_whole_are_refused_before_they_are_unpacked(tmp_path):
    messages = messages_for("sqlite3")
    path = write_bag(tmp_path / "a", "sqlite3", messages, tracked(messages))
    about = path / "metadata.yaml"
    text = about.read_text()
    assert "compression_mode: ''" in text
    about.write_text(
        text.replace("compression_mode: ''", "compression_mode: FILE").replace(
            "compression_format: ''", "compression_format: zstd"
        )
    )
    assert sentence(path, UnsupportedError) == (
        "a: its files are compressed whole; write it plain with ros2 bag convert"
    )


@pytest.mark.parametrize("form", ["1", "1 lz4", "1 bz2", "sqlite3 file", "mcap file", "mcap zstd"])
def test_a_bag_that_was_cut_anywhere_ends_in_a_sentence(tmp_path, form):
    messages = messages_for(form)
    path = write_bag(tmp_path / "a.bag", form, messages, tracked(messages))
    path = next(path.glob("*.mcap")) if path.is_dir() else path
    content = path.read_bytes()
    cut = tmp_path / f"cut{path.suffix}"
    for length in np.unique(np.linspace(1, len(content) - 1, 60).astype(int)):
        cut.write_bytes(content[:length])
        with pytest.raises((InputError, UnsupportedError)) as caught:
            list(read_recording(cut).frames)
        assert str(caught.value).startswith("cut")
        assert "\n" not in str(caught.value)


def test_a_folder_with_parts_missing_ends_in_a_sentence(tmp_path):
    messages = messages_for("mcap")
    path = write_bag(tmp_path / "a", "mcap", messages, tracked(messages))
    shutil.copytree(path, tmp_path / "b")
    next((tmp_path / "b").glob("*.mcap")).unlink()
    assert sentence(tmp_path / "b").startswith(
        "b: cannot be read as a ROS bag (Some database files are missing"
    )
    (path / "metadata.yaml").write_text("- [1, 2")
    assert sentence(path).startswith("a: cannot be read as a ROS bag (")


def test_a_bag_is_written_as_a_sequence_and_read_again(tmp_path):
    messages = messages_for("mcap")
    recording = read_recording(write_bag(tmp_path / "a", "mcap", messages, tracked(messages)))
    write_recording(recording, tmp_path / "a.mha")
    again = read_recording(tmp_path / "a.mha")
    assert again.poses.keys() == recording.poses.keys()
    for name, poses in recording.poses.items():
        np.testing.assert_array_equal(again.poses[name].matrices, poses.matrices)
    write_recording(again, tmp_path / "b.mha")
    assert_same(again, read_recording(tmp_path / "b.mha"))


def test_a_bag_of_a_tracker_gives_the_poses_of_other_images(tmp_path):
    messages = messages_for("mcap")
    path = write_bag(tmp_path / "a", "mcap", messages, tracked(messages, images=False))
    images = random_recording(0, n=N, tools=())
    object.__setattr__(images, "times", TIMES)
    write_recording(images, tmp_path / "images.mha")
    probe = read_recording(tmp_path / "images.mha", poses=path).poses["tracker_from_us_probe"]
    np.testing.assert_allclose(probe.matrices, POSES[: 2 * N : 2], atol=1e-5)


def test_a_database_of_an_older_ros_2_has_no_definitions_and_is_read(tmp_path):
    """As Foxy and Humble write them: two tables, and nothing on what the messages are."""
    messages = messages_for("sqlite3")
    entries = small_sweep(messages)
    topics = dict.fromkeys((topic, kind) for topic, kind, _, _ in entries)
    numbers = {topic: i + 1 for i, (topic, _) in enumerate(topics)}
    with closing(sqlite3.connect(tmp_path / "a.db3")) as database, database:
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
            "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)"
        )
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
            "data BLOB NOT NULL)"
        )
        for topic, kind in topics:
            database.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '')", (numbers[topic], topic, kind))
        for topic, kind, received, message in entries:
            row = (numbers[topic], round(received * 1e9), bytes(messages.encode(message, kind)))
            database.execute("INSERT INTO messages(topic_id, timestamp, data) VALUES (?, ?, ?)", row)
    recording = read_recording(tmp_path / "a.db3")
    assert [frame[0, 0] for frame in recording.frames] == [1, 2, 3]
    np.testing.assert_array_equal(recording.poses["tracker_from_probe"].matrices[:, 0, 3], [1, 2, 3])


def test_mcap_of_another_profile_is_named(tmp_path):
    messages = messages_for("mcap file")
    path = write_bag(tmp_path / "a", "mcap file", messages, small_sweep(messages))
    path.write_bytes(path.read_bytes().replace(b"ros2", b"ros1", 1))
    assert sentence(path, UnsupportedError) == (
        "a.mcap: is MCAP of the profile 'ros1'; 'ros2' is read, such as rosbags-convert writes it"
    )


@pytest.mark.parametrize("number", [1e200, -1e308, float("inf"), float("nan")])
def test_transforms_with_numbers_of_any_size_end_in_an_invalid_pose_or_a_sentence(tmp_path, number):
    messages = messages_for("1")
    for part in ("translation", "rotation"):
        entries = small_sweep(messages)
        stamped = entries[3][3].transforms[0]
        getattr(stamped.transform, part).x = number
        path = write_bag(tmp_path / f"{part}.bag", "1", messages, entries)
        try:
            probe = read_recording(path).poses["tracker_from_probe"]
            health(read_recording(path))
            assert probe.valid[[0, 2]].all()
            assert np.isfinite(probe.matrices[probe.valid]).all()
        except InputError as error:
            assert "the quaternion of Probe has length" in str(error)


@pytest.mark.parametrize("times", [1, 2, 3000])
def test_chunks_that_would_all_be_held_at_once_are_refused(times):
    class Chunk:
        def __init__(self, place, start):
            self.chunk_start_offset, self.uncompressed_size = place, 1 << 20
            self.message_start_time, self.message_end_time = start, start + 10

    class Storage:
        path, chunks = Path("a.mcap"), [Chunk(i, 11 * (i // times)) for i in range(3000)]

    if times < 256:
        check_mcap_summary(Storage, set(range(3000)))
    else:
        with pytest.raises(FormatError, match="its chunks overlap in time by more than 268435456 bytes"):
            check_mcap_summary(Storage, set(range(3000)))
    Storage.chunks.append(Storage.chunks[0])
    with pytest.raises(FormatError, match="its summary names chunks that are not there"):
        check_mcap_summary(Storage, set(range(3000)))


def test_an_index_that_names_one_chunk_again_and_again_is_refused_in_little_memory(tmp_path):
    """Each naming would keep its thousands of entries once more."""
    messages = messages_for("1")
    text = messages.make("std_msgs/msg/String", data="")
    entries = [("/talk", "std_msgs/msg/String", i / 1000, text) for i in range(5000)]
    content = write_bag(tmp_path / "a.bag", "1", messages, entries).read_bytes()
    again = content[_record_start(content) :]
    count = content.index(b"chunk_count=") + len(b"chunk_count=")
    lying = content[:count] + struct.pack("<I", 3000) + content[count + 4 :] + 2999 * again
    (tmp_path / "b.bag").write_bytes(lying)
    tracemalloc.start()
    found = sentence(tmp_path / "b.bag")
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found == "b.bag: its index names the same places again and again"
    assert peak < 32 << 20


def _record_start(content):
    """Where the last record, the one of the chunk, begins: after those of the connections."""
    position = int.from_bytes(content[content.index(b"index_pos=") + 10 :][:8], "little")
    while True:
        header = int.from_bytes(content[position : position + 4], "little")
        data = int.from_bytes(content[position + 4 + header :][:4], "little")
        following = position + 4 + header + 4 + data
        if following == len(content):
            return position
        position = following


# Of the bag of `small_sweep`: the numbers that rosbags gives its topics.
STILL, MOVING, IMAGES = 0, 1, 2


@pytest.mark.parametrize(("listed", "under"), [(IMAGES, STILL), (IMAGES, MOVING), (STILL, IMAGES)])
def test_an_index_that_lists_messages_under_another_topic_ends_in_a_sentence(tmp_path, listed, under):
    messages = messages_for("1")
    content = write_bag(tmp_path / "a.bag", "1", messages, small_sweep(messages)).read_bytes()
    head = rb"(op=\x04\x08\0\0\0ver=\x01\0\0\0\x09\0\0\0conn=)"
    (tmp_path / "b.bag").write_bytes(re.sub(head + bytes([listed]), rb"\g<1>" + bytes([under]), content))
    found = sentence(tmp_path / "b.bag", FormatError)
    assert found.startswith("b.bag")
    assert re.search(r": /(us|tf_static) holds messages of two types; it is damaged, copy it again$", found)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("image", [IMAGE, COMPRESSED, TF, STAMPED])
def test_a_topic_of_two_types_ends_in_a_sentence(tmp_path, form, image):
    """As damage writes it: the name of one topic has become that of another."""
    messages = messages_for(form)
    pixels = np.zeros((4, 6), np.uint8)
    make = {
        IMAGE: lambda time: messages.image(time, pixels, "mono8"),
        COMPRESSED: lambda time: messages.compressed(time, b"\xff\xd8"),
        TF: lambda time: messages.tf(messages.stamped("probe", "tracker", time, BASE)),
        STAMPED: lambda time: messages.stamped("probe", "tracker", time, BASE),
    }
    other = POSE, messages.pose("tracker", START, BASE)
    entries = [("/us", image, START, make[image](START)), ("/tx", other[0], START + 0.1, other[1])]
    path = write_bag(tmp_path / "a", form, messages, entries)
    for file in [path] if path.is_file() else list(path.iterdir()):
        file.write_bytes(file.read_bytes().replace(b"/tx", b"/us"))
    assert "/us holds messages of two types" in sentence(path, FormatError)


def test_images_that_are_not_where_the_summary_says_end_in_a_sentence(tmp_path):
    """The statistics count them, and the index of the chunk, by which they are sought, names another channel."""
    messages = messages_for("mcap")
    content = write_bag(tmp_path / "a", "mcap file", messages, small_sweep(messages)).read_bytes()
    offsets = rb"(\x1e\0\0\0\x01\0.{8}\x02\0.{8})\x03\0"
    # The statistics, which are laid out alike, come after it.
    damaged = re.sub(offsets, rb"\g<1>" + b"\x02\0", content, count=1, flags=re.DOTALL)
    (tmp_path / "b.mcap").write_bytes(damaged)
    assert sentence(tmp_path / "b.mcap", FormatError) == (
        "b.mcap: the images of /us are not where it says; copy it again"
    )
