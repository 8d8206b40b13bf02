"""Names, texts and numbers in the bytes of a message, read with a sentence where they do not fit."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.errors import FormatError, InputError

__all__ = [
    "ASCII",
    "UTF_8",
    "Bytes",
    "as_floats",
    "checksum",
    "floats",
    "name_of",
    "padded",
    "take",
    "text_bytes",
    "text_of",
]

Bytes = bytes | bytearray | memoryview

# The numbers that IANA gave to the two encodings that messages use.
ASCII, UTF_8 = 3, 106


def checksum(data: Bytes, crc: int = 0) -> int:
    """The CRC-64 of bytes, or of what they follow and them."""
    return _core.crc64(np.frombuffer(data, np.uint8), crc)


def take(form: str, body: Bytes, where: str, at: int = 0) -> tuple[Any, ...]:
    """Numbers of a body, big-endian, from byte `at` on."""
    layout = struct.Struct(">" + form)
    if len(body) < at + layout.size:
        raise FormatError(
            f"{where}: the body ends after {len(body)} bytes, {at + layout.size} are due; see what sends it"
        )
    return layout.unpack_from(body, at)


def floats(body: Bytes, count: int, at: int = 0) -> NDArray[np.float64]:
    """Numbers of four bytes each."""
    with np.errstate(invalid="ignore"):  # some bits that are no number ring a bell where they are made longer
        return np.frombuffer(body, ">f4", count, at).astype(np.float64)


def name_of(field: Bytes) -> str:
    """The text of a field that is filled up with zeros."""
    return bytes(field).partition(b"\0")[0].decode("utf-8", errors="replace")


def padded(text: str, size: int, what: str) -> bytes:
    """A field of `size` bytes.

    Raises:
        InputError: the text is longer than the field, or holds a zero.
    """
    field = text.encode()
    if len(field) > size or b"\0" in field:
        raise InputError(f"{what} must be at most {size} bytes without a zero among them; got {text[:60]!r}")
    return field.ljust(size, b"\0")


def text_of(field: Bytes, encoding: int) -> str:
    """The text of a field; what is in none of the two encodings shows as a question mark."""
    return bytes(field).decode("ascii" if encoding == ASCII else "utf-8", errors="replace")


def text_bytes(text: str, most: int, what: str) -> tuple[int, bytes]:
    """A text's encoding and its bytes.

    Raises:
        InputError: it is longer than its length field can say.
    """
    field = text.encode("utf-8", errors="replace")
    if len(field) > most:
        raise InputError(f"{what} must be at most {most} bytes; got {len(field)}")
    return (ASCII if field.isascii() else UTF_8), field


def as_floats(values: Sequence[float] | NDArray[Any]) -> bytes:
    """Numbers as four bytes each."""
    with np.errstate(over="ignore"):
        return np.asarray(values, dtype=">f4").tobytes()
