"""The part of HDF5 that transforms and scans use: groups, and datasets of numbers and text in them.

Our own, since the library that there is loops without end on some damaged files, and follows links into any other file
of the machine. Nothing is read that such files do not have: no links but to what is in the file, no groups of more than
a few members in the newer form, no index of pieces in the newer form.

Source: "HDF5 File Format Specification Version 3.0", The HDF Group; section numbers stand where they are followed.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from sonocal.files.hdf5_bytes import UNDEFINED, Bytes
from sonocal.files.hdf5_data import Dataset
from sonocal.files.hdf5_parts import (
    Damaged,
    Filtered,
    attribute_of,
    count_of,
    datatype_of,
    dtype_of,
    filters_of,
    link_of,
    shape_of,
    unpacked,
)

__all__ = ["MAGIC", "Damaged", "Dataset", "Filtered", "Item", "names_in", "open_hdf5"]

MAGIC = b"\x89HDF\r\n\x1a\n"
# Of messages (IV.A.2) that matter here.
DATASPACE, LINK_INFO, DATATYPE, LINK, EXTERNAL = 1, 2, 3, 6, 7
LAYOUT, FILTERS, ATTRIBUTE, SYMBOLS = 8, 11, 12, 17
FLOAT, VIRTUAL = "f", 3
MOST_NUMBERS = 64
MOST_NAMES = 10_000


def open_hdf5(path: Path) -> Item:
    """The root of a file (II.A).

    Raises:
        Damaged: it is no HDF5.
    """
    file = Bytes(path)
    if file.at(0, min(len(MAGIC), file.size)) != MAGIC:
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


def names_in(path: Path) -> frozenset[str]:
    """What a file holds, by name; nothing where it is no HDF5, or damaged."""
    try:
        return frozenset(islice(open_hdf5(path).names(), MOST_NAMES))
    except Damaged:
        return frozenset()


class Item:
    """A group or a dataset.

    Args:
        file: that it is in.
        address: of its header.
    """

    def __init__(self, file: Bytes, address: int) -> None:
        self._file = file
        self._messages = list(file.messages(address))

    def members(self) -> dict[str, Item]:
        """What a group holds, by name; links to elsewhere are left out. Nothing of a dataset."""
        return {name: Item(self._file, address) for name, address in self._links()}

    def names(self) -> Iterator[str]:
        """The names of a group's members."""
        return (name for name, _ in self._links())

    def numbers(self) -> list[float]:
        """The numbers of a dataset; none of one that has too many for a matrix.

        Raises:
            Damaged: it has no numbers.
        """
        if count_of(self._one(DATASPACE)) > MOST_NUMBERS:
            return []
        data = self.dataset()
        if data.dtype.kind != FLOAT:
            raise Damaged("its numbers are no floating-point ones")
        return [float(x) for x in data.all().ravel()]

    def dataset(self) -> Dataset:
        """The numbers of a dataset, to be read when they are asked for.

        Raises:
            Damaged: it has none.
        """
        filters = [message.data for message in self._messages if message.kind == FILTERS]
        return Dataset(
            self._file,
            shape_of(self._one(DATASPACE)),
            dtype_of(self._one(DATATYPE)),
            self._one(LAYOUT),
            filters_of(filters[0]) if filters else [],
        )

    @property
    def is_dataset(self) -> bool:
        """Whether it is no group."""
        return any(message.kind == LAYOUT for message in self._messages)

    @property
    def is_elsewhere(self) -> bool:
        """Whether it is a dataset whose numbers lie in other files."""
        kinds = {message.kind for message in self._messages}
        return EXTERNAL in kinds or (LAYOUT in kinds and self._one(LAYOUT)[1:2] == bytes([VIRTUAL]))

    def text(self) -> str:
        """The text of a dataset of one.

        Raises:
            Damaged: it has no text.
        """
        kind, size, _ = datatype_of(self._one(DATATYPE))
        if count_of(self._one(DATASPACE)) != 1:
            raise Damaged("a text is several")
        return self._file.text(kind, Dataset.of_one(self._file, size, self._one(LAYOUT)))

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
                    raise Damaged("a group has more members than are read")
