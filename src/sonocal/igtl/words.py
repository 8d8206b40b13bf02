"""What is said in words: STRING, STATUS, CAPABILITY and COMMAND."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import ClassVar, Self

from sonocal.errors import FormatError
from sonocal.geometry.shown import brief
from sonocal.igtl.fields import Bytes, name_of, padded, take, text_bytes, text_of

__all__ = ["Capability", "Command", "CommandReply", "Status", "Text"]

_TYPE_BYTES = 12
MOST_TYPES = 1 << 12
_COMMAND = struct.Struct(">I128sHI")


@dataclass(frozen=True)
class Text:
    """A text."""

    kind: ClassVar[str] = "STRING"
    text: str

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        encoding, size = take("HH", body, where)
        return cls(text_of(_rest(body, 4, size, where), encoding))

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        encoding, field = text_bytes(self.text, (1 << 16) - 1, "a text to send")
        return (struct.pack(">HH", encoding, len(field)) + field,)


@dataclass(frozen=True)
class Status:
    """How a device is.

    Attributes:
        code: 1 for well; others as the protocol lists them.
        subcode: of the device's own.
        name: of the error, at most 20 bytes.
        text: for people.
    """

    kind: ClassVar[str] = "STATUS"
    code: int
    subcode: int = 0
    name: str = ""
    text: str = ""

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        code, subcode, name = take("Hq20s", body, where)
        return cls(code, subcode, name_of(name), name_of(body[30:]))

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        head = struct.pack(">Hq20s", self.code, self.subcode, padded(self.name, 20, "an error's name"))
        return (head + padded(self.text, len(self.text.encode()), "a status") + b"\0",)


@dataclass(frozen=True)
class Capability:
    """Types of messages that a device knows."""

    kind: ClassVar[str] = "CAPABILITY"
    types: tuple[str, ...]

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        if len(body) % _TYPE_BYTES or len(body) > MOST_TYPES * _TYPE_BYTES:
            raise FormatError(
                f"{where}: types take {_TYPE_BYTES} bytes each, at most {MOST_TYPES} of them, {len(body)} bytes "
                "arrived; see what sends it"
            )
        starts = range(0, len(body), _TYPE_BYTES)
        return cls(tuple(name_of(body[at : at + _TYPE_BYTES]) for at in starts))

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        return (b"".join(padded(one, _TYPE_BYTES, "the type of a message") for one in self.types),)


@dataclass(frozen=True)
class Command:
    """A command to a device; its answer has the same identity.

    Attributes:
        identity: that the answer repeats.
        name: at most 128 bytes, such as "UpdateTransform".
        text: mostly XML.
    """

    kind: ClassVar[str] = "COMMAND"
    identity: int
    name: str
    text: str

    __repr__ = brief

    @classmethod
    def from_bytes(cls, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message."""
        identity, name, encoding, size = take(_COMMAND.format[1:], body, where)
        return cls(identity, name_of(name), text_of(_rest(body, _COMMAND.size, size, where), encoding))

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message."""
        encoding, field = text_bytes(self.text, (1 << 32) - 1, "a command")
        name = padded(self.name, 128, "a command's name")
        return (_COMMAND.pack(self.identity, name, encoding, len(field)) + field,)


class CommandReply(Command):
    """What a device answers to a command."""

    kind: ClassVar[str] = "RTS_COMMAND"


def _rest(body: Bytes, at: int, size: int, where: str) -> Bytes:
    if len(body) != at + size:
        raise FormatError(
            f"{where}: a text of {size} bytes is announced, {len(body) - at} are there; see what sends it"
        )
    return body[at:]
