"""Servers that die, stall and come back: one sentence each, the session goes on, and what was recorded stays."""

import os
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest

import sonocal as sc
from sonocal import igtl
from sonocal.live import Replay
from tests.builders.live import LONG_S, live_at, swept, until
from tests.builders.messages import as_sent

STALL_S = 5.0


@pytest.fixture(scope="module")
def sweep():
    return swept(40)


@pytest.fixture(autouse=True)
def _threads_are_joined():
    before = set(threading.enumerate())
    yield
    assert not [one for one in threading.enumerate() if one not in before and one.is_alive()]


def bytes_of(recording, first, last):
    sent = Replay(recording, begin_s=1e9)
    return b"".join(as_sent(one) for i in range(first, last) for one in sent.messages(i))


def listened():
    return socket.create_server(("127.0.0.1", 0))


def sentences(running):
    return [one for _, one in running.state.said]


def test_a_server_that_dies_inside_a_message_is_waited_for(sweep, tmp_path):
    with listened() as listening, live_at(listening.getsockname()[1], tmp_path) as running:
        first, _ = listening.accept()
        first.sendall(bytes_of(sweep, 0, 10) + bytes_of(sweep, 10, 11)[:5000])
        until(lambda: running.client.received == 30)
        first.close()
        again, _ = listening.accept()
        with again:
            again.sendall(bytes_of(sweep, 10, 20))
            until(lambda: running.client.received == 60)
            running.stop()
            running.close()
        said = sentences(running)
    assert [one for one in said if "inside message 31, a IMAGE" in one]
    assert [one for one in said if "connected again" in one]
    kept = sc.read_recording(tmp_path / "recording.mhd")
    assert len(kept) == 20
    assert all(one.valid.all() for one in kept.poses.values())


def test_a_header_byte_by_byte_and_a_stall_change_nothing(sweep, tmp_path):
    data = bytes_of(sweep, 0, 2)
    with listened() as listening, live_at(listening.getsockname()[1], tmp_path) as running:
        connection, _ = listening.accept()
        with connection:
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            for byte in data[:60]:
                connection.sendall(bytes([byte]))
            until(lambda: "nothing arrives any more; is the server still sending?" in sentences(running))
            time.sleep(STALL_S)
            connection.sendall(data[60:])
            until(lambda: "messages arrive again" in sentences(running))
            until(lambda: running.client.received == 6)
            running.close()
        said = sentences(running)
    said = [one for one in said if "asked the server for its tools" not in one]  # of a slow machine
    assert said == ["nothing arrives any more; is the server still sending?", "messages arrive again"]
    assert len(sc.read_recording(tmp_path / "recording.mhd")) == 2


def test_a_damaged_message_costs_itself_alone(sweep, tmp_path):
    sound = [as_sent(one) for i in range(3) for one in Replay(sweep, begin_s=1e9).messages(i)]
    sound[4] = sound[4][:-1] + bytes([sound[4][-1] ^ 1])
    with listened() as listening, live_at(listening.getsockname()[1], tmp_path) as running:
        connection, _ = listening.accept()
        with connection:
            connection.sendall(b"".join(sound))
            until(lambda: running.client.received == 8)
            running.close()
        (sentence,) = sentences(running)
        assert running.state.damaged == 1
    assert "checksum" in sentence
    kept = sc.read_recording(tmp_path / "recording.mhd")
    assert sorted(int(one.valid.sum()) for one in kept.poses.values()) == [2, 3]


def test_a_second_client_gets_the_same(sweep, tmp_path):
    folders = [tmp_path / "one", tmp_path / "two"]
    for folder in folders:
        folder.mkdir()
    with (
        igtl.Server() as server,
        live_at(server.port, folders[0]) as one,
        live_at(server.port, folders[1]) as two,
    ):
        until(lambda: len(server.peers) == 2)
        replay = Replay(sweep)
        replay.run(server, threading.Event(), rate_hz=400)
        sent = sum(len(list(replay.messages(i))) for i in range(40))  # the last image's poses come behind it
        until(lambda: all(running.client.received >= sent for running in (one, two)))
        until(lambda: one.pairing.images == two.pairing.images == 40)
        one.close()
        two.close()
    first, second = (sc.read_recording(folder / "recording.mhd") for folder in folders)
    for name, poses in first.poses.items():
        np.testing.assert_array_equal(poses.matrices, second.poses[name].matrices)


def test_another_depth_on_the_way_is_said_once_and_the_session_goes_on(sweep, tmp_path):
    with igtl.Server() as server, live_at(server.port, tmp_path) as running:
        assert server.wait_for_peer(LONG_S)
        sent = Replay(sweep, begin_s=1e9)
        for i in range(8):
            for message in sent.messages(i):
                server.send(message)
            if i in (3, 5):
                other = igtl.Image.of(np.zeros((40, 50), np.uint8))
                server.send(igtl.Message(other, "Image_Reference", igtl.stamp_of(1e9 + i * 0.05 + 0.02)))
        until(lambda: running.pairing.images == 10)
        running.close()
        (sentence,) = [one for one in sentences(running) if "arrive" not in one]
    assert "leave the scanner's depth and format as they are" in sentence
    assert len(sc.read_recording(tmp_path / "recording.mhd")) == 8


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal here")
def test_what_was_recorded_survives_a_kill(sweep, tmp_path):
    code = (
        "import sys, time, pathlib\n"
        "from tests.builders.live import live_at\n"
        "with live_at(int(sys.argv[1]), pathlib.Path(sys.argv[2])) as running:\n"
        "    while True:\n"
        "        print(running.state.recorded, flush=True)\n"
        "        time.sleep(0.01)\n"
    )
    with igtl.Server() as server:
        child = subprocess.Popen(
            [sys.executable, "-c", code, str(server.port), str(tmp_path)], stdout=subprocess.PIPE, text=True
        )
        assert server.wait_for_peer(LONG_S)
        sender = threading.Thread(
            target=Replay(sweep).run,
            args=(server, stop := threading.Event()),
            kwargs={"rate_hz": 100, "loop": True},
        )
        sender.start()
        recorded = next(count for line in child.stdout if (count := int(line)) >= 25)
        os.kill(child.pid, signal.SIGKILL)
        child.wait(LONG_S)
        child.stdout.close()
        stop.set()
        sender.join()
    kept = sc.read_recording(tmp_path / "recording.mhd")
    assert len(kept) >= recorded
    np.testing.assert_array_equal(kept.frames[24], sweep.frames[24])
