"""The header of a message: 58 bytes that say what follows, and how much of it."""

from __future__ import annotations

import struct
from dataclasses import dataclass

from sonocal.errors import FormatError
from sonocal.geometry.shown import brief, quoted
from sonocal.igtl.fields import Bytes, name_of, padded

__all__ = ["HEADER_BYTES", "MOST_BODY", "Header", "read_header"]

_LAYOUT = struct.Struct(">H12s20sQQQ")
HEADER_BYTES = _LAYOUT.size
MOST_BODY = 1 << 28
"""Of a message, bytes; what says more is taken for damaged before memory is asked for."""
VERSIONS = (1, 2)


@dataclass(frozen=True)
class Header:
    """What a message says of itself.

    Attributes:
        version: 1, or 2 with an extended header at the start of the body.
        kind: such as "TRANSFORM".
        device: such as "ProbeToTracker"; of longer names the first 20 bytes.
        stamp: when it was taken, in units of 2^-32 s.
        body_bytes: how many bytes follow.
        crc: their CRC-64.
    """

    version: int
    kind: str
    device: str
    stamp: int
    body_bytes: int
    crc: int

    __repr__ = brief

    def as_bytes(self) -> bytes:
        """The header as it is sent."""
        return _LAYOUT.pack(
            self.version,
            padded(self.kind, 12, "the type of a message"),
            padded(self.device, 20, "a device's name"),
            self.stamp,
            self.body_bytes,
            self.crc,
        )


def read_header(data: Bytes, where: str = "message") -> Header:
    """What a header says.

    Args:
        data: its 58 bytes.
        where: for messages of errors.

    Raises:
        FormatError: it is no header, or says that more follows than any image has: what comes behind it cannot be
            told apart any more.
    """
    if len(data) != HEADER_BYTES:
        raise FormatError(
            f"{where}: a header has {HEADER_BYTES} bytes, {len(data)} arrived; see what sends it"
        )
    version, kind, device, stamp, size, crc = _LAYOUT.unpack(data)
    word = kind.rstrip(b"\0")
    if version not in VERSIONS or not word or not all(33 <= byte < 127 for byte in word):
        raise FormatError(
            f"{where}: no header of OpenIGTLink 1 or 2 (version {version}, type {quoted(name_of(kind))}); "
            "is it an OpenIGTLink server that sends?"
        )
    header = Header(version, word.decode("ascii"), name_of(device), stamp, size, crc)
    if size > MOST_BODY:
        raise FormatError(
            f"{where}: a {header.kind} of {size} bytes is announced, more than the {MOST_BODY} that sonocal "
            "takes; the stream is damaged: connect again"
        )
    return header
