"""A PLUS device set with one transform replaced or added, every other byte kept."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from xml.sax.saxutils import quoteattr

from sonocal.errors import InputError
from sonocal.files.xml import BOM, tell_elements
from sonocal.geometry import Array

__all__ = ["put_transform", "transform_values"]

PLACE = ("PlusConfiguration", "CoordinateDefinitions")


def put_transform(
    content: bytes, name: str, frames: tuple[str, str], values: Mapping[str, str], comment: str
) -> bytes:
    """The device set with a transform's attributes replaced where it stands, or added with a comment where it does not.

    Args:
        content: the device set.
        name: what messages call it.
        frames: from and to which frame the transform leads.
        values: its attributes, as `transform_values` makes them.
        comment: stands before a transform that is added.

    Raises:
        FormatError: it is not XML in UTF-8, or declares a document type.
        InputError: it is another XML document, holds the transform twice, or connects the two frames otherwise.
    """
    start = len(BOM) if content.startswith(BOM) else 0
    body = content[start:]
    source, target = frames
    there = _look(content, name)
    if there.name != PLACE[0]:
        raise InputError(f"{name}: its root is <{there.name[:40]}> where a PLUS device set has <{PLACE[0]}>")
    same = there.transforms.get(frames, [])
    if len(same) > 1:
        raise InputError(f"{name}: defines {source}To{target} {len(same)} times; delete all but one")
    if _connected([pair for pair in there.transforms if pair != frames], source, target):
        raise InputError(
            f"{name}: leads from {source} to {target} by other transforms already; PLUS allows one way between two "
            "frames, so delete one of them"
        )
    if same:
        edited = _replaced(body, same[0], values)
    else:
        if "--" in comment:
            raise InputError(f"{name}: a frame's name must not hold '--'")
        edited = _added(body, there, {"From": source, "To": target, **values}, comment)
    return content[:start] + edited


def transform_values(matrix: Array, error_mm: float | None) -> dict[str, str]:
    """Attributes of a transform: numbers that read back to the last bit, its error, and now as its date."""
    rows = (" ".join(repr(float(x)) for x in row) for row in matrix)
    return {
        "Matrix": "  ".join(rows),
        # PLUS's own sign for one that is not known: that of another matrix must not stay.
        "Error": "-1" if error_mm is None else f"{error_mm:.6g}",
        "Date": datetime.datetime.now().astimezone().strftime("%m%d%y_%H%M%S"),
    }


@dataclass
class _Found:
    """Where things stand in a device set, in bytes from its start.

    Elements are (start of the tag that opens them, start of the tag that closes them); of an empty ``<.../>`` the
    second is its end.
    """

    name: str = ""
    root: tuple[int, int] = (0, 0)
    definitions: tuple[int, int] | None = None
    transforms: dict[tuple[str, str], list[int]] = field(default_factory=dict)
    path: list[str] = field(default_factory=list)

    def opened(self, tag: str, attributes: dict[str, str], place: int) -> None:
        """Keep the place of what matters."""
        self.path.append(tag)
        if len(self.path) == 1:
            self.name, self.root = tag, (place, -1)
        if tuple(self.path) == PLACE and self.definitions is None:
            self.definitions = (place, -1)
        if tuple(self.path) == (*PLACE, "Transform"):
            key = attributes.get("From", ""), attributes.get("To", "")
            self.transforms.setdefault(key, []).append(place)

    def closed(self, tag: str, place: int) -> None:
        """Keep the end of what matters."""
        if tuple(self.path) == PLACE and self.definitions is not None and self.definitions[1] < 0:
            self.definitions = (self.definitions[0], place)
        if len(self.path) == 1:
            self.root = (self.root[0], place)
        self.path.pop()


def _look(content: bytes, name: str) -> _Found:
    found = _Found()
    tell_elements(name, content, found)
    return found


def _connected(pairs: Iterable[tuple[str, str]], first: str, second: str) -> bool:
    """Whether transforms lead from one frame to another, whichever way each is given."""
    reached, before = {first}, 0
    while len(reached) > before:
        before = len(reached)
        reached |= {frame for pair in pairs if reached & set(pair) for frame in pair}
    return second in reached


def _replaced(body: bytes, start: int, values: Mapping[str, str]) -> bytes:
    """The tag at `start` with the attributes it has set to new values; a Matrix is added where it has none."""
    end = _tag_end(body, start)
    tag = body[start:end]
    for key, value in values.items():
        pattern = rb"(\s" + key.encode() + rb"\s*=\s*)(\"[^\"]*\"|'[^']*')"
        match = re.search(pattern, tag)
        if match:
            quote = match[2][:1]
            tag = tag[: match.start(2)] + quote + value.encode() + quote + tag[match.end(2) :]
        elif key == "Matrix":
            tag = (
                tag[: len("<Transform")].replace(b"<Transform", b"<Transform " + _attribute(key, value))
                + (tag[len("<Transform") :])
            )
    return body[:start] + tag + body[end:]


def _added(body: bytes, there: _Found, attributes: Mapping[str, str], comment: str) -> bytes:
    """The device set with the transform as the last of its CoordinateDefinitions, indented as its neighbours."""
    transform = b"<Transform " + b" ".join(_attribute(*pair) for pair in attributes.items()) + b" />"
    lines = [f"<!--{comment}-->".encode(), transform]
    if there.definitions is not None:
        return _filled(body, there.definitions, PLACE[1], lines)
    step = _step(body)
    wrapped = [b"<CoordinateDefinitions>", *(step + line for line in lines), b"</CoordinateDefinitions>"]
    return _filled(body, there.root, PLACE[0], wrapped)


def _filled(body: bytes, element: tuple[int, int], tag: str, lines: list[bytes]) -> bytes:
    """The body with lines at the end of an element, one step further in than its own tags."""
    newline = b"\r\n" if b"\r\n" in body else b"\n"
    start, closing = element
    indent = _indent(body, start)
    text = b"".join(indent + _step(body) + line + newline for line in lines)
    if not body.startswith(b"</", closing):
        opened = body[start:closing].removesuffix(b"/>").rstrip() + b">"
        return body[:start] + opened + newline + text + indent + f"</{tag}>".encode() + body[closing:]
    blanks = body[body.rfind(b"\n", 0, closing) + 1 : closing]
    own_line = not blanks.strip(b" \t") and b"\n" in body[:closing]
    head = body[: closing - len(blanks)] if own_line else body[:closing] + newline
    return head + text + (blanks if own_line else indent) + body[closing:]


def _step(body: bytes) -> bytes:
    """By how much the device set indents."""
    return b"\t" if b"\n\t" in body else b"  "


def _indent(body: bytes, place: int) -> bytes:
    """The blanks at the start of the line of `place`."""
    line = body[body.rfind(b"\n", 0, place) + 1 : place]
    return line[: len(line) - len(line.lstrip(b" \t"))]


def _tag_end(body: bytes, start: int) -> int:
    """Behind the tag that starts at `start`: attributes may hold a >."""
    match = re.compile(rb"<(?:[^\"'>]|\"[^\"]*\"|'[^']*')*>").match(body, start)
    assert match is not None, "expat accepted the tag"
    return match.end()


def _attribute(key: str, value: str) -> bytes:
    return f"{key}={quoteattr(value)}".encode()
