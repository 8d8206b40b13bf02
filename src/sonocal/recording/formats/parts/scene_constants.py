"""Transforms that stand in a scene of 3D Slicer as one matrix: of a tip to its tool, of a reference to the patient."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from xml.etree import ElementTree as ET

import numpy as np

from sonocal.errors import InputError
from sonocal.findings import Diagnostic
from sonocal.geometry import FURTHEST, Array
from sonocal.recording.poses import Poses

__all__ = ["constant_transforms", "constants_note"]

NODE, MATRIX = "LinearTransform", "matrixTransformToParent"
NAME = re.compile(r"(.+?)To([A-Z0-9_].*?)(?:Transform)?")
LONGEST_NAME = 100
MOST = 100


def constant_transforms(name: str, root: ET.Element, moving: Collection[Poses], count: int) -> list[Poses]:
    """What stands in the scene itself and is called from where to where, once an item.

    What leads to where tools were tracked is left out: Slicer keeps the last pose of a tool whose transform was not
    recorded, or the present item of a sequence, in the same way.

    Args:
        name: of the scene.
        root: its document.
        moving: what was recorded.
        count: of items.

    Raises:
        InputError: a matrix is none, or there are absurdly many.
    """
    places = {one.target.lower() for one in moving}
    known = {one.name for one in moving}
    found: dict[str, Poses] = {}
    for source, target, text in _named(root):
        one = Poses.of(source, target, np.empty((0, 4, 4)))
        if target.lower() in places or one.name in known:
            continue
        matrix = _matrix(name, one.plus_name, text)
        before = found.setdefault(one.name, Poses.of(source, target, np.repeat(matrix[None], count, axis=0)))
        if not np.array_equal(before.matrices[:1], matrix[None]):
            raise InputError(f"{name}: has two transforms {one.plus_name} that differ; delete one in Slicer")
        if len(found) > MOST:
            raise InputError(f"{name}: has more than {MOST} transforms; delete those that are not needed")
    return [*found.values()]


def constants_note(found: Collection[Poses]) -> list[Diagnostic]:
    """That such transforms were taken to hold all the time; nothing where there are none."""
    if not found:
        return []
    names = ", ".join(one.plus_name for one in found)[:200]
    return [
        Diagnostic(
            code="constant-transforms",
            severity="info",
            message=f"{names}: one matrix in the scene, taken to hold for all items",
            advice="record a sequence of whatever moved",
        )
    ]


def _named(root: ET.Element) -> Iterator[tuple[str, str, str]]:
    for node in root.iter(NODE):
        called, text = node.get("name") or "", node.get(MATRIX)
        if text is not None and len(called) <= LONGEST_NAME and (match := NAME.fullmatch(called)):
            yield match[1], match[2], text


def _matrix(name: str, called: str, text: str) -> Array:
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.empty(0)
    if len(numbers) != 16 or not np.all(np.abs(numbers) < FURTHEST):
        raise InputError(
            f"{name}: the matrix of {called} is not 16 numbers ({text[:40]!r}); save the scene again"
        )
    return numbers.reshape(4, 4)
