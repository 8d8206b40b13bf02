"""Pieces of HDF5's headers, from their bytes: messages, links, attributes, datatypes.

Source: "HDF5 File Format Specification Version 3.0", The HDF Group; section numbers stand where they are followed.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

__all__ = [
    "Damaged",
    "Filtered",
    "Message",
    "attribute_of",
    "count_of",
    "datatype_of",
    "dtype_of",
    "exactly",
    "filters_of",
    "link_of",
    "messages_in",
    "name_at",
    "shape_of",
    "unpacked",
]

MOST_AXES = 32
# Filters from here on have names.
OWN_NAMES = 256


class Damaged(ValueError):  # noqa: N818 - what the file is
    """The file is not what HDF5 is, or holds what is not read; the text says what."""


class Filtered(Damaged):
    """Numbers went through a filter that is not read; the text says which."""


class Message(NamedTuple):
    """One message of an object's header: its kind and its data."""

    kind: int
    data: bytes


def messages_in(block: bytes, *, newer: bool, ordered: bool) -> Iterator[Message]:
    """The messages of a piece of a header."""
    here, head = 0, (6 if ordered else 4) if newer else 8
    while here + head <= len(block):
        kind, size = unpacked("<BH" if newer else "<HH", block[here:])
        yield Message(kind, exactly(block[here + head :], size))
        here += head + size


def link_of(data: bytes) -> tuple[str, int] | None:
    """Name and address of a link (IV.A.2.g); None of one that leads elsewhere."""
    flags, here = exactly(data, 2)[1], 2
    hard = not flags & 8 or data[2:3] == b"\0"
    here += bool(flags & 8) + 8 * bool(flags & 4) + bool(flags & 16)
    width = 1 << (flags & 3)
    size, here = int.from_bytes(data[here : here + width], "little"), here + width
    if not hard:
        return None
    return exactly(data[here:], size).decode("utf-8", "replace"), unpacked("<Q", data[here + size :])[0]


def attribute_of(data: bytes) -> tuple[str, int, bytes] | None:
    """Name, kind and bytes of an attribute of one value (IV.A.2.m); None of others."""
    version, _, *sizes = unpacked("<BBHHH", data)
    here = 9 if version == 3 else 8
    parts = []
    for size in sizes:
        parts.append(exactly(data[here:], size))
        here += (size + 7) // 8 * 8 if version == 1 else size
    name, datatype, space = parts
    if count_of(space) != 1:
        return None
    kind, size, _ = datatype_of(datatype)
    return name.split(b"\0")[0].decode("utf-8", "replace"), kind, exactly(data[here:], size)


def filters_of(data: bytes) -> list[int]:
    """Which filters a dataset's pieces went through, in their order."""
    version, count = exactly(data, 2)
    here, found = 8 if version == 1 else 2, []
    for _ in range(count):
        (one,) = unpacked("<H", data[here:])
        named = version == 1 or one >= OWN_NAMES
        length = unpacked("<H", data[here + 2 :])[0] if named else 0
        (values,) = unpacked("<H", data[here + (6 if named else 4) :])
        padded = (values + values % 2 if version == 1 else values) * 4
        here += (8 if named else 6) + length + padded
        found.append(one)
    return found


def shape_of(space: bytes) -> tuple[int, ...]:
    """How many values there are along each axis (IV.A.2.b)."""
    version, rank = exactly(space, 2)
    if rank > MOST_AXES:
        raise Damaged(f"it has {rank} axes")
    return unpacked(f"<{rank}Q", space[8 if version == 1 else 4 :])


def count_of(space: bytes) -> int:
    """How many values there are."""
    return math.prod(shape_of(space))


def datatype_of(data: bytes) -> tuple[int, int, bool]:
    """The kind of values, their size, and whether the high byte comes first (IV.A.2.d)."""
    head, bits, size = unpacked("<BBxxI", data)
    return head & 15, size, bool(bits & 1)


def dtype_of(data: bytes) -> np.dtype[Any]:
    """Whole or floating-point numbers; `Damaged` of others."""
    kind, size, big = datatype_of(data)
    signed = exactly(data, 2)[1] & 8
    code = {0: "i" if signed else "u", 1: "f"}.get(kind)
    if code is None or size not in ((4, 8) if code == "f" else (1, 2, 4, 8)):
        raise Damaged("it does not hold numbers")
    return np.dtype(f"{'>' if big else '<'}{code}{size}")


def name_at(names: bytes, offset: int) -> str:
    """The name that starts at a place of a heap of names."""
    end = names.find(b"\0", offset)
    if end < 0:
        raise Damaged("a name has no end")
    return names[offset:end].decode("utf-8", "replace")


def exactly(data: bytes, size: int) -> bytes:
    """So many bytes from the start, or `Damaged`."""
    if len(data) < size:
        raise Damaged("a part of a header is cut off")
    return data[:size]


def unpacked(form: str, data: bytes) -> tuple[int, ...]:
    """The numbers at the start, or `Damaged`."""
    return struct.unpack(form, exactly(data, struct.calcsize(form)))
