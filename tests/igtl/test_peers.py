"""Both directions with programs that others wrote: pyigtl, and the examples of the protocol's own library."""

import threading
import time

import numpy as np
import pytest

from sonocal import igtl
from tests.builders.igtl_programs import IMAGES, Examples, client_of, free_port, python, running
from tests.builders.messages import pixels, pose

LONG_S = 30.0
STAMP = igtl.stamp_of(1.7e9 + 0.5)


@pytest.fixture(autouse=True)
def _threads_are_joined():
    before = set(threading.enumerate())
    yield
    assert not [one for one in threading.enumerate() if one not in before and one.is_alive()]


@pytest.fixture(scope="module")
def examples(tmp_path_factory):
    return Examples(tmp_path_factory.mktemp("openigtlink"))


def taken(client, count):
    found, end = [], time.monotonic() + LONG_S
    while len(found) < count and time.monotonic() < end:
        found += client.take(0.1)
    assert client.damaged == 0
    return found


PYIGTL_SERVES = """
import sys, time, numpy as np, pyigtl
server = pyigtl.OpenIGTLinkServer(port=0, start_now=False)
print(server.server_address[1], flush=True)
server.start()
matrix = np.eye(4); matrix[:3, 3] = 1, 2, 3
image = np.arange(60, dtype=np.uint16).reshape(3, 4, 5)
sent = [
    pyigtl.TransformMessage(matrix, device_name="ProbeToTracker", timestamp=1.7e9 + 0.5),
    pyigtl.StringMessage("hello", device_name="Text"),
    pyigtl.ImageMessage(image, device_name="Image"),
    pyigtl.ImageMessage(image[..., None].repeat(3, 3), device_name="Colours"),
    pyigtl.TransformMessage(matrix, device_name="ProbeToTracker"),
]
sent[-1].header_version = 2
sent[-1].metadata = {"TransformStatus": "OK", "IGTL_DEVICE_NAME": "A name of more than twenty bytes"}
while not server.is_connected(): time.sleep(0.01)
for message in sent: server.send_message(message, wait=True)
heard = server.wait_for_message("Told", timeout=30)
print(heard.matrix[:3, 3].tolist() if heard else None, flush=True)
sys.stdin.read()
"""


def test_a_server_of_pyigtl_is_understood_and_understands():
    pytest.importorskip("pyigtl")
    with running(*python(PYIGTL_SERVES)) as process:
        port = int(process.stdout.readline())
        with client_of(port) as client:
            transform, text, image, colours, named = taken(client, 5)
            client.send(igtl.Message(igtl.Transform(pose()), "Told", STAMP))
            assert process.stdout.readline().strip() == str(pose()[:3, 3].tolist())
    assert transform.content.matrix[:3, 3].tolist() == [1, 2, 3]
    assert (transform.device, transform.stamp_s) == ("ProbeToTracker", pytest.approx(1.7e9 + 0.5))
    assert text.content.text == "hello"
    expected = np.arange(60).reshape(3, 4, 5)
    np.testing.assert_array_equal(image.content.pixels, expected)
    np.testing.assert_array_equal(colours.content.pixels[..., 2], expected)
    assert (named.version, named.valid, named.name) == (2, True, "A name of more than twenty bytes")


@pytest.mark.parametrize("version", [1, 2])
def test_a_client_of_pyigtl_understands_and_is_understood(version):
    pyigtl = pytest.importorskip("pyigtl")
    volume = pixels("u2", (3, 4, 5))
    with igtl.Server() as server:
        peer = pyigtl.OpenIGTLinkClient("127.0.0.1", server.port)
        try:
            assert server.wait_for_peer(LONG_S)
            said = pyigtl.StringMessage("hello", device_name="Text")
            said.header_version = version
            peer.send_message(said)
            (arrival,) = server.take(LONG_S)
            assert (arrival.message.content.text, arrival.message.version) == ("hello", version)
            meta = {"TransformStatus": "OK"}
            server.send(igtl.Message(igtl.Transform(pose()), "ProbeToTracker", STAMP, meta=meta))
            server.send(igtl.Message(igtl.Image.of(volume), "Image", STAMP))
            server.send(igtl.Message(igtl.Text("Gruss"), "Answer"))
            transform = peer.wait_for_message("ProbeToTracker", LONG_S)
            image, text = (peer.wait_for_message(name, LONG_S) for name in ("Image", "Answer"))
        finally:
            peer.stop()
    np.testing.assert_array_equal(transform.matrix, pose())
    assert transform.timestamp == pytest.approx(1.7e9 + 0.5)
    assert (transform.header_version, transform.metadata) == (version, meta if version == 2 else {})
    np.testing.assert_array_equal(image.image, volume)
    assert text.string == "Gruss"


def test_the_librarys_tracker_is_followed(examples):
    port = free_port()
    with (
        running(examples.program("Tracker/TrackerServer"), str(port), "200"),
        client_of(port) as client,
    ):
        first, second = (one.content.matrix for one in taken(client, 20)[:2])
    assert first[:3, 3].tolist() == [50, 0, 50]
    assert second[:3, 3] == pytest.approx([50 * np.cos(0.2), 50 * np.sin(0.2), 50 * np.cos(0.2)], abs=1e-4)


def test_the_librarys_texts_are_read(examples):
    port = free_port()
    with (
        running(examples.program("String/StringServer"), str(port), "200"),
        client_of(port) as client,
    ):
        texts = [one.content.text for one in taken(client, 5)[:5]]
    assert texts == ["OpenIGTLink", "Network", "Communication", "Protocol", "Image Guided Therapy"]


def test_the_librarys_images_are_read(examples):
    port = free_port()
    with (
        running(examples.program("Imager/ImagerServer"), str(port), "100", IMAGES),
        client_of(port) as client,
    ):
        images = [one.content for one in taken(client, 5)[:5]]
    for number, image in enumerate(images, 1):
        raw = np.fromfile(IMAGES / f"igtlTestImage{number}.raw", np.uint8)
        np.testing.assert_array_equal(image.pixels, raw.reshape(1, 256, 256))


def test_the_librarys_tracker_of_many_tools_sends_them_when_it_is_asked(examples):
    port = free_port()
    with (
        running(examples.program("TrackingData/TrackingDataServer"), str(port)),
        client_of(port) as client,
    ):
        client.send(igtl.Message(igtl.Start("STT_TDATA", 10, "Patient"), "TDataClient", STAMP))
        tools = taken(client, 5)[0].content.tools
        client.send(igtl.Message(igtl.Query("STP_TDATA"), "TDataClient", STAMP))
    assert [(one.name, one.freedom) for one in tools] == [
        ("Channel 0", 1),
        ("Channel 1", 2),
        ("Channel 2", 4),
    ]
    assert all(one.matrix[:3, 3].tolist() == [50, 0, 50] for one in tools)


def test_the_librarys_client_understands_everything_that_it_knows(examples, tmp_path):
    place, turn = np.array([1.5, 2.5, -3.5]), np.array([0.5, 0.5, -0.5, 0.5])
    sent = [
        igtl.Transform(pose()),
        igtl.Position(place, turn),
        igtl.Image.of(pixels("u1", (616, 820))),
        igtl.Status(1, 7, "OK", "All is well."),
        igtl.Text("hello"),
        igtl.Tools((igtl.Tool("Probe", pose(1)), igtl.Tool("Needle", pose(2), 4))),
        igtl.QuaternionTools((igtl.QuaternionTool("Stylus", place, turn, 3),)),
        igtl.Capability(("IMAGE", "TRANSFORM")),
        igtl.Text("last"),
    ]
    log = tmp_path / "said.txt"
    client = examples.program("Receiver/ReceiveClient")
    with igtl.Server() as server, running(client, "127.0.0.1", str(server.port), says=log) as process:
        assert server.wait_for_peer(LONG_S)
        for content in sent:
            server.send(igtl.Message(content, "Sonocal", STAMP))
        assert server.flush(LONG_S)
        server.close()
        process.wait(LONG_S)
    said = log.read_text()
    for words in (
        "Time stamp: 1700000000.500000000",
        "position   = (1.5, 2.5, -3.5)",
        "quaternion = (0.5, -0.5, 0.5, 0.5)",
        "Dimensions            : (820, 616, 1)",
        "Error Name: OK",
        "Status    : All is well.",
        "hello",
        "Name       : Probe",
        "Name       : Needle",
        "Name       : Stylus",
        "last",
    ):
        assert words in said, f"{words}\nis not in\n{said}"
