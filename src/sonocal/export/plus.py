"""PLUS toolkit: the calibration as the ``ImageToProbe`` transform of a device set, a new one or one that exists."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from sonocal.calibration import Calibration
from sonocal.errors import InputError
from sonocal.existing import Existing
from sonocal.export.content import Content, content_of
from sonocal.files.xml import BOM, tell_elements

__all__ = ["plus_xml", "put_into_device_set"]

COMMENT = (
    " {image}To{probe} maps pixels to millimetres in the probe marker's frame: its columns hold the mm per px. "
    "Pixels are (u right, v down) of the MF-oriented image, counted from the centre of the top left one. "
)
COPY = "Copy the Transform into the CoordinateDefinitions of your device set. "
PLACE = ("PlusConfiguration", "CoordinateDefinitions")


def plus_xml(calibration: Calibration | Existing, image: str = "Image", probe: str = "Probe") -> bytes:
    """A PLUS configuration that holds the calibration alone.

    PLUS's ``From="Image" To="Probe"`` is ``probe_from_image``; numbers are written so that reading them
    gives the same to the last bit. ``Error`` is the root mean square distance in mm of the held-out rows
    from their lines, or of the fitted rows where none were held out; of a matrix of other software it is what that
    says, or -1.

    Args:
        calibration: what to write.
        image: what PLUS calls the image's frame.
        probe: what PLUS calls the frame of the probe's marker.
    """
    root = ElementTree.Element("PlusConfiguration", version="2.1")
    definitions = ElementTree.SubElement(root, "CoordinateDefinitions")
    written = content_of(calibration)
    comment = COMMENT.format(image=image, probe=probe) + COPY + written.remark + " "
    definitions.append(ElementTree.Comment(comment))
    ElementTree.SubElement(definitions, "Transform", {"From": image, "To": probe, **_values(written)})
    ElementTree.indent(root)
    return bytes(ElementTree.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def put_into_device_set(
    calibration: Calibration | Existing, content: bytes, name: str, image: str = "Image", probe: str = "Probe"
) -> bytes:
    """A device set that differs from the one given in the calibration's transform alone, every other byte kept.

    The transform's Matrix, Error and Date are replaced where it stands; where it does not, it is added to the
    CoordinateDefinitions, with a comment on what it maps and the verdict on it.

    Args:
        calibration: what to put in.
        content: the device set.
        name: what messages call it.
        image: what the device set calls the image's frame.
        probe: what the device set calls the frame of the probe's marker.

    Raises:
        FormatError: it is not XML in UTF-8, or declares a document type.
        InputError: it is another XML document, holds the transform twice, or connects the two frames otherwise.
    """
    start = len(BOM) if content.startswith(BOM) else 0
    body = content[start:]
    there = _look(content, name)
    if there.name != PLACE[0]:
        raise InputError(f"{name}: its root is <{there.name[:40]}> where a PLUS device set has <{PLACE[0]}>")
    same = there.transforms.get((image, probe), [])
    if len(same) > 1:
        raise InputError(f"{name}: defines {image}To{probe} {len(same)} times; delete all but one")
    if _connected([pair for pair in there.transforms if pair != (image, probe)], image, probe):
        raise InputError(
            f"{name}: leads from {image} to {probe} by other transforms already; PLUS allows one way between two "
            "frames, so delete one of them"
        )
    written = content_of(calibration)
    values = _values(written)
    if same:
        edited = _replaced(body, same[0], values)
    else:
        comment = COMMENT.format(image=image, probe=probe) + written.remark + " "
        if "--" in comment:
            raise InputError(f"{name}: a frame's name must not hold '--'")
        edited = _added(body, there, {"From": image, "To": probe, **values}, comment)
    return content[:start] + edited


def _values(written: Content) -> dict[str, str]:
    rows = (" ".join(repr(float(x)) for x in row) for row in written.matrix)
    return {
        "Matrix": "  ".join(rows),
        # PLUS's own sign for one that is not known: that of another matrix must not stay.
        "Error": "-1" if written.error_mm is None else f"{written.error_mm:.6g}",
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
