"""What asks for other messages, and what sonocal does not look into."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import Self

from sonocal.geometry.shown import brief
from sonocal.igtl.fields import Bytes, name_of, padded, take

__all__ = ["Other", "Query", "Reply", "Start"]


@dataclass(frozen=True)
class Start:
    """Asks a device to send its tools from now on.

    Attributes:
        kind: "STT_TDATA" or "STT_QTDATA".
        interval_ms: between two messages.
        frame: in which poses are wanted, at most 32 bytes; "" for the tracker's own.
    """

    kind: str
    interval_ms: int
    frame: str = ""

    __repr__ = brief

    @classmethod
    def from_bytes(cls, kind: str, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        interval, frame = take("i32s", body, where)
        return cls(kind, interval, name_of(frame))

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        return (struct.pack(">i32s", self.interval_ms, padded(self.frame, 32, "a coordinate system's name")),)


@dataclass(frozen=True)
class Query:
    """Asks for a message once (``GET_...``) or for no more of them (``STP_...``); has no content."""

    kind: str

    __repr__ = brief

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message: nothing."""
        return ()


@dataclass(frozen=True)
class Reply:
    """Whether a device does what was asked of it.

    Attributes:
        kind: such as "RTS_TDATA".
        status: 0 where it does.
    """

    kind: str
    status: int

    __repr__ = brief

    @classmethod
    def from_bytes(cls, kind: str, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        return cls(kind, *take("B", body, where))

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        return (struct.pack(">B", self.status),)


@dataclass(frozen=True)
class Other:
    """A message that sonocal carries and does not look into."""

    kind: str
    body: bytes

    __repr__ = brief

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        return (self.body,)
