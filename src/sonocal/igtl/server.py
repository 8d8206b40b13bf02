"""A server: whoever connects is sent every message, in the version that it speaks."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

from sonocal.errors import FormatError, InputError
from sonocal.files.closing import Closing
from sonocal.geometry.shown import brief
from sonocal.igtl.fields import Bytes
from sonocal.igtl.mailbox import Mailbox
from sonocal.igtl.message import Message, encode
from sonocal.igtl.stream import Stream

__all__ = ["Arrival", "Peer", "Server"]

LOOPBACK = "127.0.0.1"
MOST_WAITING = 1 << 12
MOST_WAITING_BYTES = 1 << 27
MOST_PEERS = 16
JOIN_S = 5.0
POLL_S = 0.002


class Peer:
    """One of those who are connected.

    Attributes:
        name: as HOST:PORT.
        version: 1 until it sent a message of version 2: old clients lose their place in messages of version 2.
        failed: what ended it, in a sentence; "" while it is there.
    """

    def __init__(self, server: Server, connection: socket.socket, name: str) -> None:
        self.name, self.version, self.failed = name, 1, ""
        self._server, self._stream = server, Stream(connection, name)
        self._box: Mailbox[list[Bytes]] = Mailbox(MOST_WAITING, MOST_WAITING_BYTES)
        self._given = self._sent = 0
        self._threads = [
            threading.Thread(target=run, name=f"{what} {name}", daemon=True)
            for run, what in ((self._read, "reads"), (self._write, "writes"))
        ]
        for thread in self._threads:
            thread.start()

    @property
    def dropped(self) -> int:
        """How many messages it was too slow for."""
        return self._box.dropped

    @property
    def waiting(self) -> int:
        """How many messages are not sent yet."""
        return 0 if self._box.sealed else self._given - self._sent - self._box.dropped

    @property
    def alive(self) -> bool:
        """Whether a thread of it runs."""
        return any(thread.is_alive() for thread in self._threads)

    def send(self, message: Message) -> None:
        """Send a message to it alone, in its version."""
        self.send_pieces(encode(replace(message, version=self.version)))

    def send_pieces(self, pieces: list[Bytes]) -> None:
        """Send what is encoded."""
        self._given += 1
        self._box.put(pieces, sum(map(len, pieces)))

    def close(self) -> None:
        """End the connection and wait for the threads."""
        self._box.seal()
        self._stream.close()
        for thread in self._threads:
            if thread is not threading.current_thread():
                thread.join(JOIN_S)

    def _read(self) -> None:
        with self._failing():
            while True:
                header = self._stream.header()
                self.version = max(self.version, header.version)
                try:
                    message = self._stream.body(header)
                except FormatError as error:
                    self._server.notes.append(str(error))
                    continue
                self._server.arrived(Arrival(self, message), header.body_bytes)

    def _write(self) -> None:
        with self._failing():
            while not self._box.sealed:
                for pieces in self._box.take():
                    self._stream.send(pieces)
                    self._sent += 1

    @contextlib.contextmanager
    def _failing(self) -> Iterator[None]:
        try:
            yield
        except InputError as error:
            self.failed = self.failed or str(error)
        finally:
            self._box.seal()
            self._stream.close()
            self._server.gone(self)


@dataclass(frozen=True, eq=False)
class Arrival:
    """A message and who sent it."""

    peer: Peer
    message: Message

    __repr__ = brief


class Server(Closing):
    """Listens on this machine alone unless told otherwise.

    Attributes:
        host: on which it listens.
        port: of it.
        notes: what was wrong with what peers sent, a sentence each.
    """

    def __init__(self, host: str = LOOPBACK, port: int = 0) -> None:
        """Begin to listen.

        Args:
            host: "127.0.0.1" for this machine alone, "0.0.0.0" for the network.
            port: 0 for one that is free.

        Raises:
            InputError: the port is taken, or the host is not this machine's.
        """
        self.host, self.notes = host, list[str]()
        try:
            self._socket = socket.create_server((host, port))
        except (OSError, OverflowError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise InputError(f"cannot listen on {host}:{port} ({reason}); choose another port") from error
        self.port = int(self._socket.getsockname()[1])
        self._peers: list[Peer] = []
        self._ending: list[Peer] = []
        self._lock = threading.Condition()
        self._box: Mailbox[Arrival] = Mailbox(MOST_WAITING, MOST_WAITING_BYTES)
        self._thread = threading.Thread(target=self._accept, name=f"listens on {self.port}", daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        return f"<Server on {self.host}:{self.port}: {len(self.peers)} connected>"

    @property
    def peers(self) -> list[Peer]:
        """Who is connected."""
        with self._lock:
            return list(self._peers)

    def send(self, message: Message) -> None:
        """Send a message to everybody, each in its version."""
        encoded: dict[int, list[Bytes]] = {}
        for peer in self.peers:
            version = peer.version
            if version not in encoded:
                encoded[version] = encode(replace(message, version=version))
            peer.send_pieces(encoded[version])

    def take(self, timeout_s: float) -> list[Arrival]:
        """What peers sent since the last time; waits until something came or the time is over."""
        return self._box.take(timeout_s)

    def wait_for_peer(self, timeout_s: float | None = None) -> bool:
        """Whether somebody connected within the time."""
        with self._lock:
            return self._lock.wait_for(lambda: bool(self._peers), timeout_s)

    def flush(self, timeout_s: float) -> bool:
        """Whether everything was handed on within the time."""
        until = time.monotonic() + timeout_s
        while waiting := any(peer.waiting > 0 for peer in self.peers):
            if time.monotonic() > until:
                break
            time.sleep(POLL_S)
        return not waiting

    def close(self) -> None:
        """End every connection and wait for every thread."""
        with contextlib.suppress(OSError):  # some systems do not shut down what only listens
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()
        self._thread.join(JOIN_S)
        with self._lock:
            ending = self._peers + self._ending
        for peer in ending:
            peer.close()
        self._box.seal()

    def arrived(self, arrival: Arrival, size: int) -> None:
        """Keep what a peer sent until it is taken."""
        self._box.put(arrival, size)

    def gone(self, peer: Peer) -> None:
        """Send no more to a peer whose connection ended."""
        with self._lock:
            self._ending = [one for one in self._ending if one.alive]
            if peer in self._peers:
                self._peers.remove(peer)
                self._ending.append(peer)

    def _accept(self) -> None:
        while True:
            try:
                connection, (host, port, *_) = self._socket.accept()
            except OSError:  # closed
                return
            if len(self.peers) >= MOST_PEERS:
                connection.close()
                continue
            with self._lock:
                self._peers.append(Peer(self, connection, f"{host}:{port}"))
                self._lock.notify_all()
