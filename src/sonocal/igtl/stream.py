"""Messages of a socket, one after the other, in whatever pieces they arrive."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Sequence

from sonocal.errors import InputError
from sonocal.igtl.fields import Bytes
from sonocal.igtl.header import HEADER_BYTES, Header, read_header
from sonocal.igtl.message import Message, decode_body

__all__ = ["Stream"]

# Pieces below this go out together: a segment of its own costs more than the copy.
SMALL_PIECE = 1 << 12
# A longer body gets room as it comes: what a header announces costs nothing until it is there.
FIRST_ROOM = 1 << 20


class Stream:
    """A connected socket. Its buffers are used again for every message.

    Attributes:
        peer: as HOST:PORT.
        count: how many messages began.
    """

    def __init__(self, connection: socket.socket, peer: str) -> None:
        self.peer = peer
        self.count = 0
        self._socket = connection
        self._header = memoryview(bytearray(HEADER_BYTES))
        self._body = memoryview(bytearray())
        connection.settimeout(None)
        with contextlib.suppress(OSError):  # not a socket of the internet's family
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def header(self) -> Header:
        """The next header.

        Raises:
            FormatError: it is none: what follows cannot be told apart any more.
            InputError: the connection ended.
        """
        self._fill(self._header, "between messages", 0, HEADER_BYTES)
        self.count += 1
        return read_header(self._header, self._where())

    def body(self, header: Header) -> Message:
        """The message whose header was read.

        Raises:
            FormatError: it is damaged; the next one can be read.
            InputError: the connection ended inside it.
        """
        size, done, when = header.body_bytes, 0, f"inside message {self.count}, a {header.kind}"
        while done < size:
            if done == len(self._body):
                self._grow(min(size, max(FIRST_ROOM, 2 * done)))
            end = min(size, len(self._body))
            self._fill(self._body[done:end], when, done, size)
            done = end
        return decode_body(header, self._body[:size], self._where())

    def send(self, pieces: Sequence[Bytes]) -> None:
        """Send the pieces of a message.

        Raises:
            InputError: the connection ended.
        """
        waiting = b""
        try:
            for piece in pieces:
                if len(piece) < SMALL_PIECE:
                    waiting += piece
                else:
                    self._socket.sendall(waiting)
                    self._socket.sendall(piece)
                    waiting = b""
            self._socket.sendall(waiting)
        except OSError as error:
            raise InputError(
                f"{self.peer}: the connection ended while sending ({_reason(error)}); connect again"
            ) from error

    def close(self) -> None:
        """End the connection, and wake the thread that waits for it."""
        with contextlib.suppress(OSError):  # the peer may have gone first
            self._socket.shutdown(socket.SHUT_RDWR)
        self._socket.close()

    def _where(self) -> str:
        return f"{self.peer}, message {self.count}"

    def _grow(self, size: int) -> None:
        room = memoryview(bytearray(size))
        room[: len(self._body)] = self._body
        self._body = room

    def _fill(self, room: memoryview, when: str, before: int, due: int) -> None:
        """Fill a part of a whole of `due` bytes, of which `before` are there."""
        done = 0
        while done < len(room):
            try:
                got = self._socket.recv_into(room[done:])
            except OSError as error:
                raise InputError(
                    f"{self.peer}: the connection ended {when} ({_reason(error)}); connect again"
                ) from error
            if got == 0:
                cut = f", after {before + done} of {due} bytes" if before + done else ""
                raise InputError(f"{self.peer}: the connection ended {when}{cut}; connect again")
            done += got


def _reason(error: OSError) -> str:
    return error.strerror or type(error).__name__
