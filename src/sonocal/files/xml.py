"""XML from elsewhere, read in one way whoever reads it: in UTF-8, without declarations, no deeper than sound files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Protocol
from xml.etree import ElementTree as ET
from xml.parsers import expat

from sonocal.errors import FormatError, InputError
from sonocal.files.disk import file_size, read_at

__all__ = ["BOM", "DEEPEST", "Elements", "parse_xml", "read_xml", "tell_elements"]

SIZE_LIMIT = 16 << 20
DEEPEST = 100
BOM = b"\xef\xbb\xbf"
# Of the first line: the first are UTF-8 or a part of it; the others are where all characters are ASCII's.
AS_UTF8 = ("utf-8", "utf8", "ascii", "us-ascii")
ASCII_IN_THEM = ("iso-8859-1", "latin-1", "windows-1252")


class Elements(Protocol):
    """What is told of a document's elements; places are in bytes from its start."""

    def opened(self, tag: str, attributes: dict[str, str], place: int) -> None:
        """An element begins."""

    def closed(self, tag: str, place: int) -> None:
        """An element ends: where its closing tag begins, or, of an empty ``<.../>``, where it ends."""


def read_xml(path: Path) -> bytes:
    """The content of an XML file.

    Raises:
        InputError: it cannot be read, or is larger than any device set.
    """
    if (size := file_size(path)) > SIZE_LIMIT:
        raise InputError(
            f"{path.name}: holds {size} bytes, more than the {SIZE_LIMIT} of a PLUS device set; is it the right file?"
        )
    return read_at(path, 0, size)


def parse_xml(name: str, content: bytes, what: str = "device set") -> ET.Element:
    """The tree of an XML document; as `tell_elements`."""
    tree = _Tree()
    tell_elements(name, content, tree, what)
    root: ET.Element = tree.builder.close()
    return root


def tell_elements(name: str, content: bytes, elements: Elements, what: str = "device set") -> None:
    """Tell of the elements of an XML document that declares nothing: no document type, hence no entities and no bombs.

    Args:
        name: what messages call it.
        content: the document; a byte order mark before it does not count in places.
        elements: is told.
        what: it should be, for messages.

    Raises:
        FormatError: it is not XML in UTF-8, declares a document type, or is deeper than documents are.
    """
    body = content.removeprefix(BOM)
    _refuse_encoding(name, body, what)
    if re.match(rb"\s*<(!doctype\s+)?html", body, re.IGNORECASE):
        raise FormatError(f"{name}: is a web page (HTML) and not a {what}; download the file itself")
    parser, depth = expat.ParserCreate("utf-8"), 0

    def opened(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise FormatError(f"{name}: has elements more than {DEEPEST} deep, which no {what} has")
        elements.opened(tag, attributes, parser.CurrentByteIndex)

    def closed(tag: str) -> None:
        nonlocal depth
        depth -= 1
        elements.closed(tag, parser.CurrentByteIndex)

    def declared(*_: object) -> None:
        raise FormatError(
            f"{name}: declares a document type or entities, which a {what} never needs; delete them"
        )

    parser.StartElementHandler, parser.EndElementHandler = opened, closed
    parser.StartDoctypeDeclHandler = declared
    try:
        parser.Parse(body, True)
    except expat.ExpatError as error:
        raise FormatError(f"{name}: is not XML ({error})") from None


def _refuse_encoding(name: str, body: bytes, what: str) -> None:
    try:
        body.decode("utf-8")
    except UnicodeDecodeError as error:
        raise FormatError(f"{name}: byte {error.start} is not UTF-8; save the {what} as UTF-8") from None
    said = re.match(rb"<\?xml[^>]*\sencoding\s*=\s*[\"']([^\"']*)[\"']", body)
    encoding = said[1].decode().lower() if said else "utf-8"
    if encoding not in AS_UTF8 and not (encoding in ASCII_IN_THEM and body.isascii()):
        raise FormatError(
            f"{name}: says that its encoding is {encoding[:40]!r}; save the {what} as UTF-8 and say so in "
            "its first line"
        )


class _Tree:
    """The elements as a tree."""

    def __init__(self) -> None:
        self.builder = ET.TreeBuilder()

    def opened(self, tag: str, attributes: dict[str, str], place: int) -> None:
        self.builder.start(tag, attributes)

    def closed(self, tag: str, place: int) -> None:
        self.builder.end(tag)
