"""A message: a content with a device's name, a stamp and texts by key; to bytes and from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from sonocal.errors import FormatError, InputError
from sonocal.geometry.shown import brief, quoted
from sonocal.igtl import control, meta, poses, words
from sonocal.igtl.fields import Bytes, checksum
from sonocal.igtl.header import HEADER_BYTES, Header, read_header
from sonocal.igtl.image import Image

__all__ = ["Content", "Message", "decode", "decode_body", "encode", "stamp_of"]

NAME_BYTES = 20
NAME_KEY = "IGTL_DEVICE_NAME"
STATUS_KEY = "TransformStatus"
TICKS = 1 << 32
MOST_STAMP = (1 << 64) - 1


class Content(Protocol):
    """What a message says: one class a type."""

    @property
    def kind(self) -> str:
        """The type, such as "TRANSFORM"."""

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content, in pieces to be sent one after the other."""


_CONTENTS: dict[str, Callable[[Bytes, str], Content]] = {
    kind.kind: kind.from_bytes
    for kind in (
        poses.Transform,
        poses.Position,
        poses.Tools,
        poses.QuaternionTools,
        words.Text,
        words.Status,
        words.Capability,
        words.Command,
        words.CommandReply,
        Image,
    )
}
_STARTS = ("STT_TDATA", "STT_QTDATA")
_REPLIES = ("RTS_TDATA", "RTS_QTDATA")


@dataclass(frozen=True, eq=False)
class Message:
    """One message.

    Attributes:
        content: what it says.
        device: such as "ProbeToTracker"; of a name over 20 bytes what the header holds.
        stamp: when it was taken, in units of 2^-32 s, as whole numbers so that equal stamps are equal.
        version: 1, or 2 with meta data.
        meta: texts by key.
        identity: of a message of version 2.
    """

    content: Any
    device: str = ""
    stamp: int = 0
    version: int = 1
    meta: Mapping[str, str] = field(default_factory=dict)
    identity: int = 0

    __repr__ = brief

    @property
    def kind(self) -> str:
        """The type, such as "TRANSFORM"."""
        return str(self.content.kind)

    @property
    def name(self) -> str:
        """The device's whole name, which meta data hold where the header's field is too short for it."""
        return self.meta.get(NAME_KEY, self.device)

    @property
    def stamp_s(self) -> float:
        """When it was taken, s."""
        return self.stamp / TICKS

    @property
    def valid(self) -> bool:
        """Whether its sender vouches for it: PLUS says so in the meta data of what a tracker lost."""
        return self.meta.get(STATUS_KEY, "OK").upper() == "OK"


def stamp_of(time_s: float) -> int:
    """A stamp from seconds.

    Raises:
        InputError: the time is before 1970, or after 2106.
    """
    if not (math.isfinite(time_s) and 0 <= time_s < TICKS):
        raise InputError(f"a message is stamped with seconds since 1970 up to 2^32; got {time_s}")
    return int(time_s * TICKS)


def encode(message: Message) -> list[Bytes]:
    """A message as it is sent, in pieces.

    A name over 20 bytes is cut in the header and stands whole in the meta data, where the version has them.

    Raises:
        InputError: something in it is larger than its field.
    """
    pieces = list(message.content.as_bytes())
    device = message.device.encode()[:NAME_BYTES].decode("utf-8", errors="ignore")
    if message.version > 1:
        texts = dict(message.meta)
        if device != message.device:
            texts.setdefault(NAME_KEY, message.device)
        before, behind = meta.extended(texts, message.identity)
        pieces = [before, *pieces, behind]
    crc = 0
    for piece in pieces:
        crc = checksum(piece, crc)
    size = sum(map(len, pieces))
    if not 0 <= message.stamp <= MOST_STAMP:
        raise InputError(f"a stamp must be between 0 and 2^64; got {message.stamp}")
    header = Header(message.version, message.kind, device, message.stamp, size, crc)
    return [header.as_bytes(), *pieces]


def decode(data: Bytes, where: str = "message") -> Message:
    """One whole message.

    Raises:
        FormatError: it is damaged: says where and what arrived.
    """
    header = read_header(data[:HEADER_BYTES], where)
    return decode_body(header, memoryview(data)[HEADER_BYTES:], where)


def decode_body(header: Header, body: memoryview, where: str = "message") -> Message:
    """A message from its header and its body; nothing of the body is kept.

    Raises:
        FormatError: it is damaged: says where and what arrived.
    """
    where = f"{where}, {header.kind} {quoted(header.device)}"
    if len(body) != header.body_bytes:
        raise FormatError(f"{where}: {header.body_bytes} bytes are due, {len(body)} arrived; send it again")
    if (crc := checksum(body)) != header.crc:
        raise FormatError(
            f"{where}: its checksum is {crc:016x} where its header says {header.crc:016x}; the message is damaged"
        )
    texts: Mapping[str, str] = {}
    identity = 0
    if header.version > 1:
        body, texts, identity = meta.split(body, where)
    content = _content(header.kind, body, where)
    return Message(content, header.device, header.stamp, header.version, texts, identity)


def _content(kind: str, body: memoryview, where: str) -> Content:
    if kind in _CONTENTS:
        return _CONTENTS[kind](body, where)
    if kind in _STARTS and len(body):
        return control.Start.from_bytes(kind, body, where)
    if kind in _REPLIES and len(body):
        return control.Reply.from_bytes(kind, body, where)
    if not len(body) and kind.startswith(("GET_", "STP_", "STT_")):
        return control.Query(kind)
    return control.Other(kind, bytes(body))
