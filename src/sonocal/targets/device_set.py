"""PLUS device sets (XML): constant transforms, and the wires of an N-wire phantom."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from sonocal.errors import InputError
from sonocal.files import path_of
from sonocal.files.kinds import Format
from sonocal.files.xml import parse_xml, read_xml
from sonocal.geometry import FURTHEST, Array
from sonocal.geometry.shown import brief
from sonocal.targets.lines import (
    Line,
    Point,
    check_lines,
)

__all__ = ["FORMAT", "DeviceSet", "Stated", "read_device_set"]

# Of a determinant, as a share of the product of the columns' lengths: less is a plane.
FLAT = 1e-9


@dataclass(frozen=True)
class Stated:
    """What PLUS says of a transform.

    Attributes:
        error_mm: its error, computed as the tool that made it does; None where it says none.
        date: when it was made, as spelt.
    """

    error_mm: float | None = None
    date: str = ""

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class DeviceSet:
    """What sonocal uses of a PLUS device set.

    Attributes:
        name: of the file.
        transforms: ``(target, source) -> (4, 4)``, such as ``("Reference", "Phantom")``.
        wires: of the phantom, in its own frame; one that several patterns share stands once.
        patterns: names of the wires of each N: left, middle, right.
        stated: of transforms by the same names, what PLUS says of them.
        landmarks: points of the phantom to touch with a stylus, in its own frame.
        reference: in whose frame PLUS registers the phantom; "" where the device set does not say.
    """

    name: str
    transforms: Mapping[tuple[str, str], Array]
    wires: tuple[Line, ...]
    patterns: tuple[tuple[str, ...], ...]
    stated: Mapping[tuple[str, str], Stated] = field(default_factory=dict)
    landmarks: tuple[Point, ...] = ()
    reference: str = ""

    __repr__ = brief


def read_device_set(path: str | Path) -> DeviceSet:
    """Read a PLUS device set.

    Raises:
        FormatError: the file is not XML in UTF-8, or holds entities or a document type, which device sets never
            need and attacks do.
        InputError: it is another XML document, or a matrix or wire in it is wrong.
    """
    path = path_of(path)
    root = parse_xml(path.name, read_xml(path))
    if root.tag != "PlusConfiguration":
        raise InputError(
            f"{path.name}: its root is <{str(root.tag)[:40]}> where a PLUS device set has <PlusConfiguration>"
        )
    phantom = _phantom_frame(root)
    patterns = [list(_wires(path.name, element, phantom)) for element in _patterns(root)]
    wires = tuple(_each_once(wire for pattern in patterns for wire in pattern))
    for lines in (*patterns, wires):
        check_lines(path.name, lines)
    landmarks = tuple(_landmarks(path.name, root, phantom))
    check_lines(path.name, landmarks, "landmarks")
    names = tuple(tuple(wire.name for wire in pattern) for pattern in patterns)
    return DeviceSet(
        path.name,
        dict(_transforms(path.name, root)),
        wires,
        names,
        dict(_stated(path.name, root)),
        landmarks,
        _registered_in(root),
    )


def _transforms(name: str, root: ET.Element) -> Iterator[tuple[tuple[str, str], Array]]:
    for element in root.iterfind("CoordinateDefinitions/Transform"):
        source, target = element.get("From"), element.get("To")
        if not source or not target:
            raise InputError(f"{name}: a Transform lacks From or To")
        yield (target, source), _matrix(name, f"{source}To{target}", element.get("Matrix"))
    for element in root.iterfind("PhantomDefinition/Geometry/Registration"):  # before PLUS 2
        match = re.fullmatch(r"(.+?)To([A-Z].*)", element.get("MatrixName", ""))
        if match:
            yield (match[2], match[1]), _matrix(name, match[0], element.get("MatrixValue"))


def _stated(name: str, root: ET.Element) -> Iterator[tuple[tuple[str, str], Stated]]:
    """What is said of the transforms of CoordinateDefinitions, each of which is there once.

    Raises:
        InputError: one is there twice with different matrices: which of them counts would depend on the program.
    """
    known: dict[tuple[str, str], str] = {}
    for element in root.iterfind("CoordinateDefinitions/Transform"):
        key = element.get("To", ""), element.get("From", "")
        matrix = " ".join((element.get("Matrix") or "").split())
        if known.setdefault(key, matrix) != matrix:
            raise InputError(f"{name}: defines {key[1]}To{key[0]} twice, differently; delete all but one")
        error = _numbers(element.get("Error"))
        # PLUS writes -1 where it knows none.
        sound = error is not None and len(error) == 1 and error[0] >= 0
        yield key, Stated(float(error[0]) if sound and error is not None else None, element.get("Date", ""))


def _matrix(name: str, transform: str, text: str | None) -> Array:
    numbers = _numbers(text)
    if numbers is None or len(numbers) != 16 or not np.all(np.abs(numbers) < FURTHEST):
        raise InputError(
            f"{name}: Transform {transform} needs a Matrix of 16 finite numbers; got {str(text)[:60]!r}"
        )
    matrix = numbers.reshape(4, 4)
    if np.array_equal(matrix[:, 3], [0, 0, 0, 1]) and not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise InputError(
            f"{name}: Transform {transform} is transposed: its last column is 0 0 0 1; write it row by row, with the "
            "translation in the last column"
        )
    # Against its own size: of metres per px the determinant is tiny.
    size = np.prod(np.linalg.norm(matrix[:3, :3], axis=0))
    with np.errstate(divide="ignore"):
        volume = abs(np.linalg.det(matrix))
    if not np.array_equal(matrix[3], [0, 0, 0, 1]) or not volume > FLAT * size:
        raise InputError(f"{name}: Transform {transform} cannot be inverted, or its last row is not 0 0 0 1")
    return matrix


def _patterns(root: ET.Element) -> Iterator[ET.Element]:
    for geometry in root.iterfind("PhantomDefinition/Geometry"):
        yield from (pattern for pattern in geometry.iterfind("Pattern") if pattern.find("Wire") is not None)
        yield from geometry.iterfind("NWire")  # before PLUS 2.1


def _wires(name: str, pattern: ET.Element, phantom: str) -> Iterator[Line]:
    for wire in pattern.iterfind("Wire"):
        label = wire.get("Name", "")
        ends = [_numbers(wire.get(key)) for key in ("EndPointFront", "EndPointBack")]
        if any(end is None or len(end) != 3 for end in ends):
            raise InputError(
                f"{name}: wire {label!r} needs EndPointFront and EndPointBack of three numbers, mm"
            )
        yield Line(label, phantom, np.array(ends))


def _landmarks(name: str, root: ET.Element, phantom: str) -> Iterator[Point]:
    for element in root.iterfind("PhantomDefinition/Geometry/Landmarks/Landmark"):
        label, place = element.get("Name", ""), _numbers(element.get("Position"))
        if place is None or len(place) != 3:
            raise InputError(f"{name}: landmark {label!r} needs a Position of three numbers, mm")
        yield Point(label, phantom, place)


def _registered_in(root: ET.Element) -> str:
    algorithm = root.find("vtkPlusPhantomLandmarkRegistrationAlgo")
    return "" if algorithm is None else algorithm.get("ReferenceCoordinateFrame", "")


def _each_once(wires: Iterable[Line]) -> Iterator[Line]:
    """The wires without those that came before: patterns may share a wire, whichever way round its ends are."""
    seen: dict[str, Array] = {}
    for wire in wires:
        ends = seen.setdefault(wire.name, wire.segment_mm)
        same = np.array_equal(wire.segment_mm, ends) or np.array_equal(wire.segment_mm[::-1], ends)
        if ends is wire.segment_mm or not same:
            yield wire


def _phantom_frame(root: ET.Element) -> str:
    for element in root.iter():
        if frame := element.get("PhantomCoordinateFrame"):
            return frame
    return "Phantom"


def _numbers(text: str | None) -> Array | None:
    try:
        numbers = np.array([float(word) for word in (text or "").split()])
    except ValueError:
        return None
    return numbers if np.isfinite(numbers).all() else None


FORMAT = Format(
    name="PLUS device set",
    kind="device set",
    suffixes=(".xml",),
    sniff=lambda head: head.text.startswith(b"<") and b"<MRML" not in head.text and not head.is_page,
    read=read_device_set,
    holds="constant transforms, wires of a phantom; a wire that patterns share is one",
)
