"""Memory is bounded by what arrived, whatever a message says of itself."""

import random
import socket
import tracemalloc
from contextlib import contextmanager

import pytest

from sonocal import FormatError, InputError, SonocalError, igtl
from sonocal.igtl.stream import Stream
from tests.builders.igtl_calls import content_of, sound
from tests.builders.messages import as_sent, messages, pixels, with_crc

MB = 1 << 20
SOME = 3000


@contextmanager
def peak():
    """A list whose one number is, behind the block, the most bytes that were held in it."""
    found = []
    tracemalloc.start()
    try:
        yield found
        found.append(tracemalloc.get_traced_memory()[1])
    finally:
        tracemalloc.stop()


@contextmanager
def stream():
    """A stream, and the socket from which it receives."""
    one, other = socket.socketpair()
    with one, other:
        yield Stream(one, "peer"), other


def announcing(data, size):
    """A message whose header says that so many bytes follow."""
    return data[:42] + size.to_bytes(8, "big") + data[50:]


@pytest.mark.parametrize("message", messages()[::3], ids=lambda m: m.kind)
@pytest.mark.parametrize("size", [1 << 60, (1 << 64) - 1, igtl.MOST_BODY + 1])
def test_a_body_that_no_message_has_is_refused_before_memory_is_asked_for(message, size):
    with stream() as (receiver, sender), peak() as most:
        sender.sendall(announcing(as_sent(message), size)[: igtl.HEADER_BYTES])
        with pytest.raises(FormatError, match=f"a {message.kind} of {size} bytes is announced, more than"):
            receiver.header()
    assert most[0] < MB


def test_a_long_body_that_does_not_come_takes_no_room():
    data = announcing(as_sent(igtl.Message(igtl.Text("cut"))), igtl.MOST_BODY)
    with stream() as (receiver, sender), peak() as most:
        sender.sendall(data)
        sender.shutdown(socket.SHUT_WR)
        header = receiver.header()
        with pytest.raises(
            InputError, match=f"inside message 1, a STRING, after 7 of {igtl.MOST_BODY} bytes"
        ):
            receiver.body(header)
    assert most[0] < 3 * MB


def test_a_long_body_arrives_whole_behind_a_short_one():
    image = pixels("u2", (1100, 1600))
    with igtl.Server() as server, igtl.Client("127.0.0.1", server.port) as client:
        assert server.wait_for_peer(30)
        for content in (igtl.Text("short"), igtl.Image.of(image), igtl.Image.of(image[:7])):
            server.send(igtl.Message(content))
        found = []
        while len(found) < 3:
            found += client.take(30)
    assert (found[1].content.pixels == image).all()
    assert (found[2].content.pixels == image[:7]).all()


def test_mutated_messages_take_no_more_than_a_few_times_their_bytes():
    longest = max(len(data) for kind in sound().values() for data in kind)
    chance = random.Random(21)
    with peak() as most:
        for number in range(SOME):
            data = content_of(chance.choice(list(sound())), chance)
            if number % 7 == 0:
                data = announcing(data, 1 << chance.randrange(64))
            try:
                igtl.decode(data)
            except SonocalError as error:
                assert "\n" not in str(error)
    assert most[0] < 20 * longest + MB


@pytest.mark.parametrize("kind, size", [("TDATA", 70), ("QTDATA", 50), ("CAPABILITY", 12)])
def test_parts_beyond_number_are_refused(kind, size):
    header = igtl.Header(1, kind, "", 0, 0, 0).as_bytes()
    assert igtl.decode(with_crc(header + bytes(4096 * size)))
    data = with_crc(header + bytes(4097 * size))
    with peak() as most, pytest.raises(FormatError, match="4096"):
        igtl.decode(data)
    assert most[0] < MB
