"""Trackers and videos without a server: what they say, and what they are served as."""

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from sonocal import InputError, SonocalError, devices, igtl
from sonocal.devices import Ndi, OptiTrack, Reading, Video, opened, relay
from sonocal.devices.ndi import tools_of
from sonocal.devices.tracker import pose_of
from tests.builders.tracker_devices import FakeMotive, FakeNdi, frame
from tests.builders.videos import video_with_texts

LONG_S = 30.0
HALF = np.sqrt(0.5)


@pytest.fixture(autouse=True)
def _threads_are_joined():
    before = set(threading.enumerate())
    yield
    assert not [one for one in threading.enumerate() if one not in before and one.is_alive()]


@given(st.integers(0, 10**6))
def test_a_pose_is_that_of_its_quaternion(seed):
    rotation = Rotation.random(random_state=seed)
    x, y, z, w = rotation.as_quat()
    pose = pose_of((w, x, y, z), (1, 2, 3))
    np.testing.assert_allclose(pose[:3, :3], rotation.as_matrix(), atol=1e-12)
    assert pose[:3, 3].tolist() == [1, 2, 3]


@pytest.mark.parametrize("turn, place", [((0, 0, 0, 0), (1, 2, 3)), ((1, 0, 0, 0), (1, np.nan, 3))])
def test_what_is_no_pose_is_lost(turn, place):
    assert pose_of(turn, place) is None


def test_bodies_of_motive_have_their_names_and_are_in_mm():
    pytest.importorskip("natnet")
    bodies = [(5, (0.1, 0.2, -0.3), (0, HALF, 0, HALF), True), (9, (0, 0, 0), (0, 0, 0, 1), False)]
    with (
        FakeMotive({5: "Probe", 9: "Needle"}, [frame(1, bodies)]) as motive,
        OptiTrack(multicast=False, command_port=motive.port) as tracker,
    ):
        reading = None
        while reading is None:
            reading = tracker.read(LONG_S)
    assert reading.poses["Needle"] is None
    np.testing.assert_allclose(reading.poses["Probe"][:3, 3], [100, 200, -300], atol=1e-4)
    np.testing.assert_allclose(reading.poses["Probe"][:3, :3], [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-6)


def test_packets_that_are_none_are_counted_and_passed_over():
    pytest.importorskip("natnet")
    sound = frame(1, [(5, (0, 0, 0), (0, 0, 0, 1), True)])
    with (
        FakeMotive({5: "Probe"}, [sound[:30], sound]) as motive,
        OptiTrack(multicast=False, command_port=motive.port) as tracker,
    ):
        readings = [tracker.read(LONG_S) for _ in range(3)]
        assert tracker.damaged
    assert all(one.poses.keys() == {"Probe"} for one in readings)


def test_a_tracker_is_opened_by_what_one_types():
    pytest.importorskip("natnet")
    bodies = [(5, (0.1, 0.2, -0.3), (0, HALF, 0, HALF), True)]
    with (
        FakeMotive({5: "Probe"}, [frame(1, bodies)]) as motive,
        devices.open_tracker(f"optitrack:127.0.0.1:{motive.port}") as tracker,
    ):
        reading = None
        while reading is None:
            reading = tracker.read(LONG_S)
    assert reading.poses.keys() == {"Probe"}


@pytest.mark.parametrize(
    ("source", "form"),
    [("/dev/video0", "v4l2"), ("video=USB Capture", "dshow"), ("sweep.avi", None), ("a/video=1.avi", None)],
)
def test_the_form_of_a_video_is_that_of_its_name(source, form, monkeypatch):
    monkeypatch.setattr(opened, "Video", lambda *given: given)
    assert devices.open_video(source) == (source, form)


def test_no_motive_is_said(monkeypatch):
    pytest.importorskip("natnet")
    monkeypatch.setattr("sonocal.devices.optitrack.CONNECT_S", 0.2)
    with pytest.raises(InputError, match=r"127.0.0.1:9: no Motive answers there .* streaming pane"):
        OptiTrack(multicast=False, command_port=9)


SEEN = "01+10000+00000+00000+00000+012345-000200+100000+000120000003100000A2F"
LOST = "02MISSING0000000100000A2F"
TX = f"02{SEEN}\n{LOST}\n0000"


def test_a_reply_of_a_polaris_is_read():
    found = tools_of(TX)
    assert found[2] is None
    np.testing.assert_allclose(found[1][:3, 3], [123.45, -2.0, 1000.0])
    np.testing.assert_array_equal(found[1][:3, :3], np.eye(3))


@given(st.text("0123456789ABCDEF+-MISNG\n", max_size=90))
def test_what_is_no_reply_is_refused_in_a_sentence(reply):
    for text in (reply, TX[: len(reply)], TX[: len(reply)] + reply):
        try:
            tools_of(text)
        except SonocalError as error:
            assert "\n" not in str(error)


def test_tools_of_a_vega_are_loaded_and_named(tmp_path):
    rom = tmp_path / "probe.rom"
    rom.write_bytes(b"NDI")
    api = FakeNdi({"PHSR": "00", "PHRQ": "01", "TX": TX})
    with Ndi({"Probe": rom}, "192.168.0.10", api=api) as tracker:
        reading = tracker.read(LONG_S)
    assert reading.poses["Probe"][:3, 3].tolist() == pytest.approx([123.45, -2.0, 1000.0])
    assert api.said[0] == "open 192.168.0.10:8765"
    for words in ("load 1", "PINIT:01", "PENA:01D", "TSTART:", "TSTOP:"):
        assert words in api.said
    assert not api.open


def test_wired_tools_of_an_aurora_go_by_their_number():
    api = FakeNdi(
        {"PHSR": "020A0010B001", "TX": TX.replace("02MISSING", "0BMISSING").replace("0201+", "020A+")}
    )
    with Ndi({"Probe": 0, "Needle": 1}, "/dev/ttyUSB0", api=api) as tracker:
        reading = tracker.read(LONG_S)
    assert reading.poses["Probe"] is not None
    assert reading.poses["Needle"] is None


@pytest.mark.parametrize(
    "api, tools, address, sentence",
    [
        (FakeNdi({}), {}, "nobody", "nobody: no NDI tracker answers there"),
        (FakeNdi({"PHSR": "00"}), {"Probe": 3}, "vega", "has 0 wired tools, and none of number 3 for Probe"),
        (FakeNdi({"PHSR": "00"}), {"Probe": "no.rom"}, "vega", "no.rom: is no file; give the .rom of Probe"),
        (FakeNdi({}, "TSTART"), {}, "vega", r"refuses TSTART: \('Invalid port handle 7'\)"),
        (FakeNdi({}), {}, "vega:x", "an address must be HOST:PORT"),
    ],
)
def test_what_is_wrong_is_said_and_the_tracker_let_go(api, tools, address, sentence):
    with pytest.raises(InputError, match=sentence):
        Ndi(tools, address, api=api)
    assert not api.open


class Still:
    """A tracker whose probe rests, and whose needle is lost."""

    def __init__(self):
        self.count = 0

    def read(self, timeout_s):
        self.count += 1
        return Reading(1.7e9 + 0.01 * self.count, {"Probe": np.eye(4), "Needle": None})

    def close(self):
        pass


class Gone(Still):
    """A tracker that fails."""

    def read(self, timeout_s):
        raise InputError("the tracker is gone")


def test_a_file_is_a_device_and_is_served_with_a_tracker(tmp_path):
    pixels = np.random.default_rng(0).integers(0, 255, (6, 40, 60), np.uint8)
    path = tmp_path / "grabber.mkv"
    video_with_texts(path, pixels, {}, rate=100)
    with igtl.Server() as server, igtl.Client("127.0.0.1", server.port) as client, Video(path) as video:
        assert server.wait_for_peer(LONG_S)
        relay(server, Still(), video, threading.Event())
        assert server.flush(LONG_S)
        found = []
        while sum(one.kind == "IMAGE" for one in found) < 6:
            found += client.take(LONG_S)
    images = [one for one in found if one.kind == "IMAGE"]
    np.testing.assert_array_equal([one.content.pixels[0] for one in images], pixels)
    stamps = [one.stamp_s for one in images]
    assert stamps == sorted(stamps)
    assert {one.name for one in found} == {"Image", "ProbeToTracker"}


def test_a_tracker_that_fails_ends_it(tmp_path):
    stop = threading.Event()

    def images():
        while True:
            stop.wait(0.01)
            yield 1.7e9, np.zeros((4, 5), np.uint8)

    with igtl.Server() as server, pytest.raises(InputError, match="the tracker is gone"):
        relay(server, Gone(), images(), stop)


def test_no_video_is_said(tmp_path):
    pytest.importorskip("av")
    with pytest.raises(InputError, match="cannot be opened as a video"):
        Video(tmp_path / "none.mkv")
    (tmp_path / "text.mkv").write_text("no video")
    with pytest.raises(InputError, match="cannot be opened as a video"):
        Video(tmp_path / "text.mkv")
