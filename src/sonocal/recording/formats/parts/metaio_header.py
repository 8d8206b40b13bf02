"""The header of a MetaIO file: its fields, and those of the items of a PLUS sequence."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from sonocal.errors import FormatError
from sonocal.files import reading
from sonocal.recording.formats.parts.header_lines import HeaderLines
from sonocal.recording.formats.parts.sequence_fields import ItemFields

__all__ = ["ELEMENT_TYPES", "FIELD", "GROWN", "STRUCTURE", "Header", "read_header"]

ELEMENT_TYPES = {
    "MET_UCHAR": "u1",
    "MET_CHAR": "i1",
    "MET_USHORT": "u2",
    "MET_SHORT": "i2",
    "MET_UINT": "u4",
    "MET_INT": "i4",
    "MET_ULONG_LONG": "u8",
    "MET_LONG_LONG": "i8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
GROWN = "WrittenAsItCame"
"""Says that images were written one after the other while the header grew."""
# What the format itself defines; the writer states it anew, everything else is kept as it came.
STRUCTURE = (
    "ObjectType",
    "NDims",
    "BinaryData",
    "BinaryDataByteOrderMSB",
    "ElementByteOrderMSB",
    "CompressedData",
    "CompressedDataSize",
    "DimSize",
    "ElementNumberOfChannels",
    "ElementType",
    "HeaderSize",
    "Kinds",
    "UltrasoundImageOrientation",
    "ElementDataFile",
    GROWN,
)
KEY = re.compile(r"[A-Za-z_][\w .\-]*")
# Of the header itself: not of an item, and no blank at its end, which readers drop.
FIELD = re.compile(r"(?!Seq_Frame)[A-Za-z_]([\w .\-]*[\w.\-])?")
END = re.compile(rb"^[^\S\n]*ElementDataFile[^\S\n]*=[^\n]*\n?", re.MULTILINE)
LINES = HeaderLines(
    END, b"ElementDataFile", longest=1 << 20, kind="a MetaIO header", closing="ends with ElementDataFile"
)


@dataclass
class Header:
    """Fields as they stand in the file; `end` is the first byte after them."""

    name: str
    fields: dict[str, str]
    items: ItemFields
    end: int

    def whole(self, key: str) -> tuple[int, ...]:
        """The whole numbers of a field; () where it is absent."""
        text = self.fields.get(key, "")
        if not all(re.fullmatch(r"[+-]?\d{1,18}", word) for word in text.split()):
            raise FormatError(f"{self.name}: {key} = {text[:60]!r} is not of whole numbers")
        return tuple(int(word) for word in text.split())

    def true(self, key: str) -> bool:
        """Whether a field is set; MetaIO reads the first letter."""
        return self.fields.get(key, "")[:1] in ("T", "t", "1")


def read_header(path: Path) -> Header:
    """Read the header of a MetaIO file.

    Raises:
        FormatError: it is none, or has no end.
    """
    fields: dict[str, str] = {}
    items, name = ItemFields(path.name), path.name
    with reading(path), path.open("rb") as file:
        for first, lines, end in LINES.blocks(name, file):
            for number, text in items.take(enumerate(lines, first), "="):
                _take(fields, name, number, text)
            if "ElementDataFile" in fields:
                return Header(name, fields, items, end)
    if not fields:
        raise FormatError(f"{name}: is empty; a MetaIO file starts with a header")
    raise FormatError(f"{name}: its header ends without ElementDataFile; it was cut short, copy it again")


def _take(fields: dict[str, str], name: str, number: int, text: str) -> None:
    key, equals, value = text.partition("=")
    key = key.strip()
    if not key and not equals:
        return
    if not equals or not KEY.fullmatch(key):
        raise FormatError(
            f"{name}, line {number}: {text.strip()[:60]!r} is not 'name = value' of a MetaIO header"
        )
    if key in fields:
        raise FormatError(f"{name}, line {number}: {key} stands twice in the header; delete one")
    fields[key] = value.strip()
