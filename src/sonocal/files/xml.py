"""XML documents: parsed without what attacks need."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree as ET

from sonocal.errors import FormatError

__all__ = ["DEEPEST", "parse_xml"]

DEEPEST = 100


def parse_xml(name: str, text: str, what: str) -> ET.Element:
    """Parse XML that declares nothing: no document type, hence no entities and no bombs.

    Args:
        name: of the file, for messages.
        text: of the document.
        what: it should be, such as "device set".

    Raises:
        FormatError: it declares something, or is not XML.
    """
    if re.match(r"\s*<(!doctype\s+)?html", text, re.IGNORECASE):
        raise FormatError(f"{name}: is a web page (HTML) and not a {what}; download the file itself")
    if re.search(r"<!(?!--|\[CDATA\[)", text):
        raise FormatError(
            f"{name}: declares a document type or entities, which a {what} never needs; delete them"
        )
    parser = ET.XMLParser(target=_Shallow(name, what))
    try:
        # As bytes, with the declaration dropped: the text was decoded already.
        parser.feed(re.sub(r"^\s*<\?xml[^>]*\?>", "", text).encode())
        root: ET.Element = parser.close()
    except (ET.ParseError, ValueError, LookupError) as error:
        raise FormatError(f"{name}: is not XML ({error})") from None
    return root


class _Shallow(ET.TreeBuilder):
    """A tree no deeper than documents are: Python ends when it lets go of one a million deep."""

    def __init__(self, name: str, what: str) -> None:
        super().__init__()
        self._name, self._what, self._depth = name, what, 0

    def start(self, tag: str, attrs: dict[Any, Any], /) -> ET.Element:
        self._depth += 1
        if self._depth > DEEPEST:
            raise FormatError(
                f"{self._name}: has elements more than {DEEPEST} deep, which no {self._what} has"
            )
        return super().start(tag, attrs)

    def end(self, tag: str, /) -> ET.Element:
        self._depth -= 1
        return super().end(tag)
