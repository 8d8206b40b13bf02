"""Trackers without a server: Motive as it speaks NatNet 3.0, and the functions of `ndicapy`."""

from __future__ import annotations

import socket
import struct
import threading
import time
from typing import Self

import numpy as np

from sonocal.devices import Reading
from sonocal.recording import Recording

CONNECT, SERVER_INFO, ASK_MODELS, MODELS, FRAME = 0, 1, 4, 5, 7


def packet(kind: int, body: bytes) -> bytes:
    return struct.pack("<HH", kind, len(body)) + body


def server_info() -> bytes:
    return packet(SERVER_INFO, b"Motive".ljust(256, b"\0") + bytes([3, 0, 0, 0]) + bytes([3, 0, 0, 0]))


def models(names: dict[int, str]) -> bytes:
    """Descriptions of rigid bodies without markers."""
    body = struct.pack("<I", len(names))
    for number, name in names.items():
        body += struct.pack("<I", 1) + name.encode() + b"\0"
        body += struct.pack("<Ii3fI", number, -1, 0, 0, 0, 0)
    return packet(MODELS, body)


def frame(number: int, bodies: list[tuple[int, tuple, tuple, bool]]) -> bytes:
    """Bodies by number: place in m, quaternion x, y, z, w, and whether each is tracked."""
    body = struct.pack("<I", number) + struct.pack("<II", 0, 0) + struct.pack("<I", len(bodies))
    for one, place, turn, tracked in bodies:
        body += struct.pack("<I3f4ffH", one, *place, *turn, 0.0001, int(tracked))
    body += struct.pack("<IIII", 0, 0, 0, 0)  # skeletons, labelled markers, force plates, devices
    body += (
        struct.pack("<II", 0, 0)
        + struct.pack("<d", 1.5)
        + struct.pack("<QQQ", 0, 0, 0)
        + struct.pack("<H", 0)
    )
    return packet(FRAME, body)


class FakeMotive:
    """Answers a client of NatNet on this machine, and sends it packets again and again."""

    def __init__(self, names: dict[int, str], packets: list[bytes]) -> None:
        self._names, self._packets = names, packets

    def __enter__(self) -> Self:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.01)
        self.port = self._socket.getsockname()[1]
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        peer, known = None, False
        while not self._stop.is_set():
            try:
                data, peer = self._socket.recvfrom(1024)
            except (TimeoutError, OSError):
                data = b""
            kind = struct.unpack_from("<H", data)[0] if data else None
            if kind == CONNECT:
                self._socket.sendto(server_info(), peer)
            elif kind == ASK_MODELS:
                self._socket.sendto(models(self._names), peer)
                known = True
            if known and peer:
                for one in self._packets:
                    self._socket.sendto(one, peer)


class FakeNdi:
    """As `ndicapy`; `replies` to commands by their beginning, `refused` as one of them."""

    NDI_OKAY = 0

    def __init__(self, replies: dict[str, str], refused: str = "") -> None:
        self._replies, self._refused, self._error = replies, refused, 0
        self.said: list[str] = []
        self.open = False

    def ndiOpenNetwork(self, host: str, port: int) -> object:  # noqa: N802
        self.said.append(f"open {host}:{port}")
        self.open = host != "nobody"
        return self if self.open else None

    def ndiOpen(self, name: str) -> object:  # noqa: N802
        self.said.append(f"open {name}")
        self.open = True
        return self

    def ndiCommand(self, _: object, command: str) -> str:  # noqa: N802
        self.said.append(command)
        self._error = 7 if self._refused and command.startswith(self._refused) else 0
        return next((text for key, text in self._replies.items() if command.startswith(key)), "OKAY")

    def ndiPVWRFromFile(self, _: object, handle: int, path: str) -> None:  # noqa: N802
        self.said.append(f"load {handle}")

    def ndiGetError(self, _: object) -> int:  # noqa: N802
        return self._error

    def ndiErrorString(self, error: int) -> str:  # noqa: N802
        return f"Invalid port handle {error}"

    def ndiClose(self, _: object) -> None:  # noqa: N802
        self.open = False

    ndiCloseNetwork = ndiClose  # noqa: N815


class Played:
    """A recording as a tracker and a frame grabber on one desk would give it: each pose before and behind its image."""

    def __init__(self, recording: Recording, each_s: float = 0.01) -> None:
        self._recording, self._each_s = recording, each_s
        self._turn = threading.Condition()
        self._read = self._shown = self.closed = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.closed += 1

    def read(self, timeout_s: float) -> Reading | None:
        item = self._read // 2
        with self._turn:
            in_time = self._turn.wait_for(lambda: self._shown >= (self._read + 1) // 2, timeout_s)
            if not in_time or item >= len(self._recording):
                return None
            time.sleep(self._each_s)
            now_s = time.time()
            self._read += 1
            self._turn.notify_all()
        poses = self._recording.poses.values()
        return Reading(now_s, {one.source: one.matrices[item] for one in poses})

    def __iter__(self):
        for item, image in enumerate(self._recording.frames):
            with self._turn:
                if not self._turn.wait_for(lambda item=item: self._read > 2 * item, 3.0):
                    return
                time.sleep(self._each_s)
                now_s = time.time()
                self._shown += 1
                self._turn.notify_all()
            yield now_s, np.asarray(image)
        with self._turn:
            self._turn.wait_for(lambda: self._read == 2 * len(self._recording), 3.0)
        time.sleep(0.5)
