"""Connections: nothing is lost or out of order, whatever the network does; every failure is a sentence."""

import socket
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from sonocal import InputError, igtl
from sonocal.igtl.mailbox import Mailbox
from tests.builders.messages import as_sent, pixels, pose

LONG_S = 10.0


@pytest.fixture(autouse=True)
def _threads_are_joined():
    before = set(threading.enumerate())
    yield
    left = [thread for thread in threading.enumerate() if thread not in before and thread.is_alive()]
    assert not left


@contextmanager
def plain_server():
    """A socket that listens, for what no sound server does."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(LONG_S)
        yield listening, listening.getsockname()[1]


@contextmanager
def connected():
    with igtl.Server() as server, igtl.Client("127.0.0.1", server.port) as client:
        assert server.wait_for_peer(LONG_S)
        yield server, client


def text(number, version=1):
    return igtl.Message(igtl.Text(str(number)), version=version)


def until(condition):
    end = time.monotonic() + LONG_S
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.002)


def taken(client, count):
    found, end = [], time.monotonic() + LONG_S
    while len(found) < count and time.monotonic() < end:
        found += client.take(0.1)
    return found


def said(client):
    found = []
    until(lambda: found.extend(client.said()) or found)
    return found


def test_images_and_poses_arrive_in_order():
    image = igtl.Message(igtl.Image.of(pixels(shape=(300, 400))), "Image", 1 << 32)
    with connected() as (server, client):
        for number in range(50):
            server.send(image)
            server.send(text(number))
        found = taken(client, 100)
        assert server.flush(LONG_S)
    assert [one.content.text for one in found[1::2]] == [str(number) for number in range(50)]
    np.testing.assert_array_equal(found[0].content.pixels[0], pixels(shape=(300, 400)))
    assert (client.received, client.dropped, client.damaged) == (100, 0, 0)


def test_a_peer_is_spoken_to_in_the_version_that_it_speaks():
    with connected() as (server, client):
        server.send(text(0, version=2))
        assert [one.version for one in taken(client, 1)] == [1]
        client.send(text("hello", version=2))
        assert [one.message.content.text for one in server.take(LONG_S)] == ["hello"]
        server.send(text(1))
        assert [one.version for one in taken(client, 1)] == [2]


def test_several_clients_get_everything_and_one_that_reads_nothing_holds_up_none():
    big = igtl.Message(igtl.Image.of(pixels(shape=(1000, 1000))))
    with connected() as (server, client), socket.create_connection(("127.0.0.1", server.port)):
        until(lambda: len(server.peers) == 2)
        for number in range(40):
            server.send(big)
            server.send(text(number))
        assert len(taken(client, 80)) == 80
        idle = max(server.peers, key=lambda peer: peer.waiting)
        assert idle.waiting > 0


def test_a_header_may_come_byte_by_byte():
    data = as_sent(igtl.Message(igtl.Transform(pose()), "ProbeToTracker"))
    with plain_server() as (listening, port), igtl.Client("127.0.0.1", port) as client:
        connection, _ = listening.accept()
        with connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for byte in data:
                connection.sendall(bytes([byte]))
            (message,) = taken(client, 1)
    np.testing.assert_array_equal(message.content.matrix, pose())


def test_a_damaged_message_is_said_and_the_next_one_is_read():
    data = bytearray(as_sent(text(1)))
    data[-1] ^= 1
    with plain_server() as (listening, port), igtl.Client("127.0.0.1", port) as client:
        connection, _ = listening.accept()
        with connection:
            connection.sendall(bytes(data) + as_sent(text(2)))
            assert [one.content.text for one in taken(client, 1)] == ["2"]
            assert client.damaged == 1
            (sentence,) = said(client)
    assert sentence.startswith(f"127.0.0.1:{port}, message 1, STRING '': its checksum is ")


@pytest.mark.parametrize(
    "sent, sentence",
    [
        (as_sent(text("cut"))[:-2], "the connection ended inside message 1, a STRING, after 5 of 7 bytes"),
        (as_sent(text("cut"))[:20], "the connection ended between messages, after 20 of 58 bytes"),
        (b"", "the connection ended between messages"),
        (
            as_sent(text(1))[:42] + (1 << 60).to_bytes(8, "big") + bytes(8),
            "message 1: a STRING of 1152921504606846976 bytes is announced",
        ),
        (b"GET / HTTP/1.1\r\n".ljust(58), "message 1: no header of OpenIGTLink 1 or 2"),
    ],
)
def test_what_ends_a_connection_is_said_once_and_the_client_connects_again(sent, sentence):
    with plain_server() as (listening, port), igtl.Client("127.0.0.1", port) as client:
        connection, _ = listening.accept()
        connection.sendall(sent)
        connection.shutdown(socket.SHUT_WR)
        again, _ = listening.accept()
        connection.close()
        with again:
            again.sendall(as_sent(text("after")))
            assert [one.content.text for one in taken(client, 1)] == ["after"]
        first = said(client)[0]
    assert first.startswith(f"127.0.0.1:{port}")
    assert sentence in first
    assert first.endswith("; connecting again")


def test_a_server_that_comes_back_is_found():
    with igtl.Server() as server:
        client = igtl.Client("127.0.0.1", server.port)
        assert server.wait_for_peer(LONG_S)
        server.send(text("first"))
        assert len(taken(client, 1)) == 1
    until(lambda: not client.connected)
    with pytest.raises(InputError, match="the connection ended; start the server again"):
        client.send(text("nobody"))
    with client, igtl.Server(port=server.port) as server:
        assert server.wait_for_peer(LONG_S)
        server.send(text("second"))
        assert [one.content.text for one in taken(client, 1)] == ["second"]
        assert any("connected again" in one for one in said(client))


def test_what_nobody_takes_is_dropped_from_the_oldest_on_and_counted():
    with igtl.Server() as server, igtl.Client("127.0.0.1", server.port, most=5) as client:
        assert server.wait_for_peer(LONG_S)
        for number in range(12):
            server.send(text(number))
        until(lambda: client.received == 12)
        assert [one.content.text for one in client.take(LONG_S)] == ["7", "8", "9", "10", "11"]
        assert client.dropped == 7


def test_a_queue_holds_no_more_bytes_than_it_may_and_always_the_last():
    box = Mailbox(100, 10)
    for size in (4, 4, 4, 50):
        box.put(size, size)
    assert (box.take(), box.dropped) == ([50], 3)
    box.seal()
    box.put(1, 1)
    assert box.take() == []


def test_a_stalled_server_is_seen_by_how_long_nothing_came():
    with connected() as (server, client):
        server.send(text(0))
        taken(client, 1)
        assert client.take(0.15) == []
        assert client.quiet_s > 0.1
        server.send(text(1))
        taken(client, 1)
        assert client.quiet_s < 0.1
        assert client.said() == []


def test_nobody_there_is_said():
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    with pytest.raises(InputError, match=f"127.0.0.1:{port}: no OpenIGTLink server answers there .*start it"):
        igtl.Client("127.0.0.1", port)


def test_a_port_that_is_taken_is_said():
    with igtl.Server() as server, pytest.raises(InputError, match="choose another port"):
        igtl.Server(port=server.port)


def test_what_a_peer_sends_damaged_is_noted():
    data = bytearray(as_sent(text(1)))
    data[-1] ^= 1
    with igtl.Server() as server, socket.create_connection(("127.0.0.1", server.port)) as peer:
        peer.sendall(bytes(data) + as_sent(text(2)))
        assert [one.message.content.text for one in server.take(LONG_S)] == ["2"]
        assert "its checksum is" in server.notes[0]


def test_a_server_listens_on_this_machine_alone():
    with igtl.Server() as server:
        assert server.host == "127.0.0.1"


@pytest.mark.parametrize(
    "given, meant",
    [
        ("localhost:18944", ("localhost", 18944)),
        ("tracker", ("tracker", 18944)),
        ("[::1]:5", ("::1", 5)),
    ],
)
def test_addresses(given, meant):
    assert igtl.address(given) == meant


@pytest.mark.parametrize("given", ["", ":5", "host:", "host:0", "host:70000", "host:²", "host:1e3"])
def test_addresses_that_are_none(given):
    with pytest.raises(InputError, match="an address must be HOST:PORT"):
        igtl.address(given)
