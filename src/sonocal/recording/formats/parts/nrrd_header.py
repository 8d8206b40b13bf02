"""The header of an NRRD file: its fields, its key-value pairs, and those of the items of a PLUS sequence."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from sonocal.errors import FormatError
from sonocal.files import reading
from sonocal.recording.formats.parts.header_lines import HeaderLines
from sonocal.recording.formats.parts.sequence_fields import ItemFields

__all__ = ["ORIENTATION_KEY", "PAIR", "STRUCTURE", "TYPES", "Header", "read_header"]

TYPES = {
    "u1": ("uint8", "uchar", "unsigned char", "uint8_t"),
    "i1": ("int8", "signed char", "int8_t"),
    "u2": ("uint16", "ushort", "unsigned short", "unsigned short int", "uint16_t"),
    "i2": ("int16", "short", "short int", "signed short", "signed short int", "int16_t"),
    "u4": ("uint32", "uint", "unsigned int", "uint32_t"),
    "i4": ("int32", "int", "signed int", "int32_t"),
    "u8": ("uint64", "ulonglong", "unsigned long long", "unsigned long long int", "uint64_t"),
    "i8": ("int64", "longlong", "long long", "long long int", "signed long long", "int64_t"),
    "f4": ("float",),
    "f8": ("double",),
}
ORIENTATION_KEY = "ultrasound image orientation"
STRUCTURE = (
    "type",
    "dimension",
    "sizes",
    "kinds",
    "encoding",
    "endian",
    "data file",
    "datafile",
    "byte skip",
    "line skip",
)
# The key of a key-value pair: not of an item, and no comment.
PAIR = re.compile(r"(?!Seq_Frame|#)[^:\s]([^:\r\n\0]*[^:\s])?")
# Slicer keeps the index values of a whole sequence in one line.
LINES = HeaderLines(
    re.compile(rb"^\r?\n", re.MULTILINE),
    word=b"\n",
    longest=1 << 24,
    kind="an NRRD header",
    closing="ends with an empty line",
)


@dataclass
class Header:
    """Fields, key-value pairs and those of the items; `end` is the first byte after them."""

    name: str
    fields: dict[str, str]
    pairs: dict[str, str]
    items: ItemFields
    end: int

    def need(self, key: str) -> str:
        """A field that every file has."""
        if key not in self.fields:
            raise FormatError(f"{self.name}: the header lacks {key!r}, which every NRRD file has")
        return self.fields[key]

    def whole(self, key: str, default: str | None = None) -> tuple[int, ...]:
        """The whole numbers of a field."""
        text = self.need(key) if default is None else self.fields.get(key, default)
        if not all(re.fullmatch(r"[+-]?\d{1,18}", word) for word in text.split()):
            raise FormatError(f"{self.name}: {key} {text[:60]!r} is not of whole numbers")
        return tuple(int(word) for word in text.split())


def read_header(path: Path) -> Header:
    """Read the header of an NRRD file.

    Raises:
        FormatError: it is none.
    """
    header = Header(path.name, {}, {}, ItemFields(path.name), 0)
    with reading(path), path.open("rb") as file:
        if not re.match(rb"NRRD000[1-5]\r?\n", file.readline(16)):
            raise FormatError(f"{path.name}: does not start with NRRD0001 to NRRD0005; it is no NRRD file")
        for first, lines, end in LINES.blocks(path.name, file, number=2):
            for number, text in header.items.take(enumerate(lines, first), ":="):
                _take(header, number, text.rstrip("\r"))
            header.end = end
    return header


def _take(header: Header, number: int, text: str) -> None:
    if not text or text.startswith("#"):
        return
    match = re.match(r"([^:]+):(=| ?)(.*)", text)
    if match is None:
        raise FormatError(
            f"{header.name}, line {number}: {text[:60]!r} is neither 'field: value' nor 'key:=value'"
        )
    key, value, is_pair = match[1], match[3].strip(), match[2] == "="
    place = header.pairs if is_pair else header.fields
    key = key if is_pair else key.strip().lower()
    if key in place:
        raise FormatError(f"{header.name}, line {number}: {key} stands twice in the header; delete one")
    place[key] = value
