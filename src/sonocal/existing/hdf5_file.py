"""The part of HDF5 that files of transforms use: groups, and small datasets of numbers and text in them.

Our own, since the library that there is loops without end on some damaged files, and follows links into any other file
of the machine. Nothing is read that a file of transforms does not have: no links but to what is in the file, no dataset
in several pieces, no groups of more than a few members in the newer form.

Source: "HDF5 File Format Specification Version 3.0", The HDF Group; section numbers stand where they are followed.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator

import numpy as np

from sonocal.existing.hdf5_parts import (
    Damaged,
    Message,
    attribute_of,
    count_of,
    datatype_of,
    exactly,
    filters_of,
    link_of,
    messages_in,
    name_at,
    unpacked,
)

__all__ = ["MAGIC", "Damaged", "Item", "open_hdf5"]

MAGIC = b"\x89HDF\r\n\x1a\n"
UNDEFINED = (1 << 64) - 1
# Of messages (IV.A.2) that matter here.
DATASPACE, LINK_INFO, DATATYPE, LINK, LAYOUT, FILTERS, ATTRIBUTE, CONTINUATION, SYMBOLS = (
    1,
    2,
    3,
    6,
    8,
    11,
    12,
    16,
    17,
)
FLOAT, STRING, LIST = 1, 3, 9
# Of filters: that which ITK uses.
DEFLATE = 1
SLACK = 64
MOST_BLOCKS, MOST_NODES, MOST_NUMBERS = 64, 2000, 64


def open_hdf5(content: bytes) -> Item:
    """The root of a file (II.A).

    Raises:
        Damaged: it is no HDF5.
    """
    file = _File(content)
    if not content.startswith(MAGIC):
        raise Damaged("it does not start as HDF5 does")
    version = file.at(8, 1)[0]
    if version in (0, 1):
        sizes, root = file.at(13, 2), file.number(64 + 4 * version)
    elif version in (2, 3):
        sizes, root = file.at(9, 2), file.number(36)
    else:
        raise Damaged(f"its version is {version}")
    if sizes != b"\x08\x08":
        raise Damaged("its addresses are not of 8 bytes")
    return Item(file, root)


class Item:
    """A group or a dataset.

    Args:
        file: that it is in.
        address: of its header.
    """

    def __init__(self, file: _File, address: int) -> None:
        self._file = file
        self._messages = list(file.messages(address))

    def members(self) -> dict[str, Item]:
        """What a group holds, by name; links to elsewhere are left out. Nothing of a dataset."""
        return {name: Item(self._file, address) for name, address in self._links()}

    def numbers(self) -> list[float]:
        """The numbers of a dataset; none of one that has too many for a matrix.

        Raises:
            Damaged: it has no numbers.
        """
        count, (kind, size, big) = count_of(self._one(DATASPACE)), datatype_of(self._one(DATATYPE))
        if count > MOST_NUMBERS:
            return []
        if kind != FLOAT or size not in (4, 8):
            raise Damaged("its numbers are no floating-point ones")
        data = self._data(count * size)
        return [float(x) for x in np.frombuffer(data, f"{'>' if big else '<'}f{size}")]

    def text(self) -> str:
        """The text of a dataset of one.

        Raises:
            Damaged: it has no text.
        """
        kind, size, _ = datatype_of(self._one(DATATYPE))
        if count_of(self._one(DATASPACE)) != 1:
            raise Damaged("a text is several")
        return self._file.text(kind, self._data(size))

    def attribute(self, name: str) -> str:
        """The text of an attribute; "" where there is none."""
        for message in self._messages:
            if message.kind == ATTRIBUTE and (found := attribute_of(message.data)) and found[0] == name:
                return self._file.text(*found[1:])
        return ""

    def _one(self, kind: int) -> bytes:
        for message in self._messages:
            if message.kind == kind:
                return message.data
        raise Damaged("a dataset lacks a part of its header")

    def _data(self, size: int) -> bytes:
        """The data of a dataset, which must lie in one piece (IV.A.2.i)."""
        version, how, dimension = exactly(self._one(LAYOUT), 3)
        rest = self._one(LAYOUT)[2:]
        if version not in (3, 4) or how > 2 or (how == 2 and version == 4):
            raise Damaged("its numbers lie otherwise")
        if how == 0:
            return exactly(rest[2:], size)
        if how == 1:
            return self._file.at(unpacked("<Q", rest)[0], size)
        piece, mask = self._file.piece(unpacked("<Q", rest[1:])[0], dimension)
        return exactly(piece if mask else self._unfiltered(piece, size), size)

    def _unfiltered(self, piece: bytes, size: int) -> bytes:
        """A piece that may be compressed (IV.A.2.l), as ITK does when it is told to."""
        filters = [message.data for message in self._messages if message.kind == FILTERS]
        for one in reversed(filters_of(filters[0]) if filters else []):
            if one != DEFLATE:
                raise Damaged("its numbers are compressed in a way that ITK does not use")
            try:
                piece = zlib.decompressobj().decompress(piece, max(size, 1) + SLACK)
            except zlib.error:
                raise Damaged("its numbers cannot be decompressed") from None
        return piece

    def _links(self) -> Iterator[tuple[str, int]]:
        for message in self._messages:
            if message.kind == SYMBOLS:
                tree, heap = unpacked("<QQ", message.data)
                yield from self._file.symbols(tree, heap)
            elif message.kind == LINK and (link := link_of(message.data)) is not None:
                yield link
            elif message.kind == LINK_INFO:
                offset = 2 + 8 * (message.data[1:2] > b"\0" and message.data[1] & 1)
                if unpacked("<Q", message.data[offset:])[0] != UNDEFINED:
                    raise Damaged("a group has more members than a file of transforms")


class _File:
    """The bytes of a file, with every address checked."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def at(self, address: int, size: int) -> bytes:
        if address < 0 or address + size > len(self._content):
            raise Damaged("it ends before what it says it holds")
        return self._content[address : address + size]

    def number(self, address: int) -> int:
        return int.from_bytes(self.at(address, 8), "little")

    def messages(self, address: int) -> Iterator[Message]:
        """Of an object's header in either form (IV.A.1), with its continuations."""
        newer = self.at(address, 4) == b"OHDR"
        if newer:
            flags = self.at(address + 5, 1)[0]
            start = address + 6 + 16 * bool(flags & 32) + 4 * bool(flags & 16)
            width = 1 << (flags & 3)
            size, start = int.from_bytes(self.at(start, width), "little"), start + width
        else:
            flags, start = 0, address + 16
            size = unpacked("<I", self.at(address + 8, 4))[0]
        blocks = [(start, size)]
        for done, (begin, length) in enumerate(blocks):
            if done > MOST_BLOCKS:
                raise Damaged("a header has no end")
            for message in messages_in(self.at(begin, length), newer=newer, ordered=bool(flags & 4)):
                if message.kind == CONTINUATION:
                    where, count = unpacked("<QQ", message.data)
                    # The newer form has a signature before, and a checksum behind.
                    blocks.append((where + 4, count - 8) if newer else (where, count))
                else:
                    yield message

    def symbols(self, tree: int, heap: int) -> Iterator[tuple[str, int]]:
        """Names and addresses of an older group's members: a B-tree of nodes, and a heap of names (III.A to III.D)."""
        if self.at(heap, 4) != b"HEAP":
            raise Damaged("a group has no names")
        size, names = self.number(heap + 8), self.number(heap + 24)
        ahead, nodes = [tree], 0
        while ahead:
            node, nodes = ahead.pop(), nodes + 1
            if nodes > MOST_NODES:
                raise Damaged("a group has no end")
            mark = self.at(node, 4)
            if mark == b"TREE":
                (used,) = unpacked("<H", self.at(node + 6, 2))
                ahead += [self.number(node + 32 + 16 * i) for i in range(used)]
            elif mark == b"SNOD":
                (count,) = unpacked("<H", self.at(node + 6, 2))
                for entry in range(node + 8, node + 8 + 40 * count, 40):
                    name, address, cached = unpacked("<QQI", self.at(entry, 20))
                    if cached != 2:  # a link by name
                        yield name_at(self.at(names, size), name), address
            else:
                raise Damaged("a group's members are not where it says")

    def piece(self, tree: int, dimension: int) -> tuple[bytes, int]:
        """The only piece of a dataset in pieces, and which filters it was spared (III.A.1, node type 1)."""
        mark, kind, level, used = self.at(tree, 4), *unpacked("<BBH", self.at(tree + 4, 4))
        if (mark, kind, level, used) != (b"TREE", 1, 0, 1):
            raise Damaged("its numbers lie in several pieces")
        size, mask = unpacked("<II", self.at(tree + 24, 8))
        return self.at(self.number(tree + 32 + 8 * dimension), size), mask

    def text(self, kind: int, data: bytes) -> str:
        """Text of one fixed length, or of any, whose bytes are in a heap of the file (III.E)."""
        if kind == LIST:
            length, heap, index = unpacked("<IQI", data)
            data = self._heaped(heap, index)[:length]
        elif kind != STRING:
            raise Damaged("a text is none")
        return data.split(b"\0")[0].decode("utf-8", "replace")

    def _heaped(self, heap: int, wanted: int) -> bytes:
        if self.at(heap, 4) != b"GCOL":
            raise Damaged("a text is not where it says")
        end, here = heap + self.number(heap + 8), heap + 16
        while here + 16 <= end:
            (index,), size = unpacked("<H", self.at(here, 2)), self.number(here + 8)
            if index == wanted:
                return self.at(here + 16, size)
            if index == 0:
                break
            here += 16 + (size + 7) // 8 * 8
        raise Damaged("a text is not where it says")
