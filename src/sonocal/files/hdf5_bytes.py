"""The bytes of an HDF5 file, with every address checked: headers of objects, members of groups, texts and pieces.

Source: "HDF5 File Format Specification Version 3.0", The HDF Group; section numbers stand where they are followed.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from sonocal.files.disk import file_size, read_at
from sonocal.files.hdf5_parts import Damaged, Message, messages_in, name_at, unpacked

__all__ = ["UNDEFINED", "Bytes", "Piece"]

UNDEFINED = (1 << 64) - 1
CONTINUATION = 16
STRING, LIST = 3, 9
MOST_BLOCKS, MOST_NODES = 64, 2000
# Headers are small and lie together: they are read so much at a time.
PAGE, MOST_PAGES = 1 << 16, 64

Piece = tuple[int, int, int]
"""Of a dataset: where it lies, how many bytes it takes there, and which filters it was spared."""


class Bytes:
    """The bytes of a file, with every address checked."""

    def __init__(self, path: Path) -> None:
        self.path, self.size = path, file_size(path)
        self._pages: dict[int, bytes] = {}

    def at(self, address: int, size: int) -> bytes:
        """So many bytes from an address."""
        if address < 0 or address + size > self.size:
            raise Damaged("it ends before what it says it holds")
        first, last = address // PAGE, (address + size - 1) // PAGE
        if first == last:
            data = self._page(first)[address % PAGE : address % PAGE + size]
        else:
            data = read_at(self.path, address, size)
        if len(data) != size:
            raise Damaged("it was cut while it was read")
        return data

    def _page(self, number: int) -> bytes:
        if number not in self._pages:
            if len(self._pages) >= MOST_PAGES:
                self._pages.pop(next(iter(self._pages)))
            self._pages[number] = read_at(self.path, number * PAGE, PAGE)
        return self._pages[number]

    def number(self, address: int) -> int:
        """An address or a size that stands at an address."""
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

    def pieces(self, tree: int, rank: int, most: int) -> Iterator[tuple[tuple[int, ...], Piece]]:
        """The pieces of a dataset of `rank` axes, by where they start in it (III.A.1, node type 1)."""
        ahead, nodes, step = [(tree, -1)] if tree != UNDEFINED else [], 0, 16 + 8 * rank
        while ahead:
            (node, due), nodes = ahead.pop(), nodes + 1
            kind, level, used = unpacked("<BBH", self.at(node + 4, 4))
            if (
                self.at(node, 4) != b"TREE"
                or kind != 1
                or due not in (-1, level)
                or nodes > MOST_NODES + most
            ):
                raise Damaged("the pieces of its numbers are not where it says")
            for entry in range(node + 24, node + 24 + step * used, step):
                size, mask, *start = unpacked(f"<II{rank}Q", self.at(entry, 8 + 8 * rank))
                child = self.number(entry + step - 8)
                if level:
                    ahead.append((child, level - 1))
                else:
                    yield tuple(start), (child, size, mask)

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
