"""A connection to a server that is kept up: a thread receives, whoever calibrates takes what is there."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import deque
from collections.abc import Sequence

from sonocal.errors import FormatError, InputError
from sonocal.files.closing import Closing
from sonocal.igtl.mailbox import Mailbox
from sonocal.igtl.message import Message, encode
from sonocal.igtl.stream import Stream

__all__ = ["Client", "address"]

MOST_HELD = 1 << 14
MOST_HELD_BYTES = 1 << 28
"""Of messages that nobody took yet: five hundred images of 820 x 616."""
CONNECT_S = 5.0
AGAIN_S = 0.25
# Of sentences that nobody asked for yet; of more the last.
MOST_SAID = 200
PORT = 18944


def address(text: str) -> tuple[str, int]:
    """HOST and PORT of a text as HOST:PORT or HOST, then with OpenIGTLink's own port.

    Raises:
        InputError: it is neither.
    """
    host, colon, port = text.rpartition(":") if ":" in text else (text, ":", str(PORT))
    host = host.removeprefix("[").removesuffix("]")
    number = int(port) if port.isascii() and port.isdecimal() and len(port) < 6 else 0
    if not host or not colon or not 0 < number < 1 << 16:
        raise InputError(f"an address must be HOST:PORT, such as localhost:{PORT}; got {text!r}")
    return host, number


class Client(Closing):
    """Messages of a server, from a thread of its own, which connects again when the server went.

    Attributes:
        received: how many whole messages came.
        damaged: how many were refused.
        connected: whether the server is there now.
    """

    def __init__(
        self,
        host: str,
        port: int,
        *,
        greeting: Sequence[Message] = (),
        most: int = MOST_HELD,
        most_bytes: int = MOST_HELD_BYTES,
    ) -> None:
        """Connect.

        Args:
            host: name or number of the server's machine.
            port: of the server.
            greeting: what is sent first, whenever it is connected to: such as one message of version 2, behind which
                PLUS answers in that.
            most: how many messages are kept that nobody takes.
            most_bytes: the same in bytes.

        Raises:
            InputError: nobody listens there.
        """
        self.received = self.damaged = 0
        self._address, self._peer = (host, port), f"{host}:{port}"
        self._greeting = [encode(message) for message in greeting]
        self._box: Mailbox[Message] = Mailbox(most, most_bytes)
        self._said: deque[str] = deque(maxlen=MOST_SAID)
        self._closing = threading.Event()
        self._sending = threading.Lock()
        self._last = time.monotonic()
        self._stream: Stream | None = self._connect()
        self._thread = threading.Thread(target=self._run, name=f"receives from {self._peer}", daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        there = "connected" if self.connected else "not connected"
        return f"<Client of {self._peer[:80]}: {self.received} messages, {there}>"

    @property
    def dropped(self) -> int:
        """How many messages were lost because nobody took them in time."""
        return self._box.dropped

    @property
    def connected(self) -> bool:
        """Whether the server is there now."""
        return self._stream is not None

    @property
    def quiet_s(self) -> float:
        """How long nothing came."""
        return time.monotonic() - self._last

    def take(self, timeout_s: float) -> list[Message]:
        """What came since the last time, in order; waits until something did, or the time is over: then nothing."""
        return self._box.take(timeout_s)

    def said(self) -> list[str]:
        """What went wrong since the last time, a sentence each."""
        return [self._said.popleft() for _ in range(len(self._said))]

    def send(self, message: Message) -> None:
        """Send a message to the server.

        Raises:
            InputError: it is not there, or something in the message is larger than its field.
        """
        pieces, stream = encode(message), self._stream
        if stream is None:
            raise InputError(f"{self._peer}: the connection ended; start the server again")
        with self._sending:
            stream.send(pieces)

    def close(self) -> None:
        """End the connection and wait for the thread; what came can still be taken."""
        self._closing.set()
        if (stream := self._stream) is not None:
            stream.close()
        self._thread.join()
        self._box.seal()

    def _connect(self) -> Stream:
        try:
            connection = socket.create_connection(self._address, timeout=CONNECT_S)
        except (OSError, UnicodeError) as error:
            reason = getattr(error, "strerror", None) or "no answer"
            raise InputError(
                f"{self._peer}: no OpenIGTLink server answers there ({reason}); start it, or check the address"
            ) from error
        stream = Stream(connection, self._peer)
        with contextlib.suppress(InputError):  # whoever receives says that it ended
            for pieces in self._greeting:
                stream.send(pieces)
        return stream

    def _run(self) -> None:
        while not self._closing.is_set():
            stream = self._stream
            if stream is None:
                with contextlib.suppress(InputError):  # said once, when it went
                    self._stream = self._connect()
                    self._said.append(f"{self._peer}: connected again")
                self._closing.wait(0 if self._stream else AGAIN_S)
                continue
            try:
                self._receive(stream)
            except InputError as error:
                if not self._closing.is_set():
                    self._said.append(str(error).removesuffix("; connect again") + "; connecting again")
            self._stream = None
            stream.close()

    def _receive(self, stream: Stream) -> None:
        while True:
            header = stream.header()
            try:
                message = stream.body(header)
            except FormatError as error:
                self.damaged += 1
                self._said.append(str(error))
                continue
            self.received += 1
            self._last = time.monotonic()
            self._box.put(message, header.body_bytes)
