"""Where a target is in each image: found, moved, added or dropped; and the edits that made it so."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import msgspec
import numpy as np

from sonocal.detection import Detections
from sonocal.errors import InputError
from sonocal.observations import Observations

__all__ = ["Edit", "Mark", "Marks", "edited", "marks_of", "points_csv", "points_of"]

Origin = Literal["found", "moved", "added"]
Key = tuple[int, str]
"""A frame and a target: one sighting."""


@dataclass(frozen=True)
class Mark:
    """One sighting.

    Attributes:
        points_px: one point, or of a wall or a volume's needle two or more; each (u, v) or (u, v, w).
        origin: who placed it.
        dropped: that it takes no part.
    """

    points_px: tuple[tuple[float, ...], ...]
    origin: Origin = "found"
    dropped: bool = False


Marks = Mapping[Key, Mark]


class Edit(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One thing that a person did.

    Attributes:
        id: of the click, so that one that is sent twice counts once.
        action: "move" a point (or add the first of its frame), "drop" a sighting, "keep" a dropped one, or "undo" the
            last of these that still stands.
        frame, target: which sighting.
        place: which point of it.
        at_px: where it is moved to, (u, v); of a volume w stays.
    """

    id: str
    action: Literal["move", "drop", "keep", "undo"]
    frame: int = 0
    target: str = ""
    place: int = 0
    at_px: tuple[float, float] | None = None


def marks_of(rows: Observations) -> dict[Key, Mark]:
    """The sightings of a table of chosen rows."""
    points: dict[Key, list[tuple[float, ...]]] = {}
    for frame, target, place in zip(
        rows.frame.tolist(), rows.target.tolist(), rows.points_px.tolist(), strict=True
    ):
        points.setdefault((frame, target), []).append(tuple(place))
    return {key: Mark(tuple(places)) for key, places in points.items()}


def standing(edits: Iterable[Edit]) -> list[Edit]:
    """The edits that were not undone."""
    left: list[Edit] = []
    for edit in edits:
        if edit.action != "undo":
            left.append(edit)
        elif left:
            left.pop()
    return left


def edited(found: Marks, edits: Iterable[Edit]) -> dict[Key, Mark]:
    """The sightings after edits, one after the other; those of an earlier run that fit nothing any more do nothing."""
    marks = dict(found)
    for edit in standing(edits):
        key = (edit.frame, edit.target)
        if edit.action == "move" and edit.at_px is not None:
            marks[key] = _moved(marks.get(key), edit.place, edit.at_px)
        elif key in marks:
            marks[key] = replace(marks[key], dropped=edit.action == "drop")
    return marks


def _moved(mark: Mark | None, place: int, at_px: tuple[float, float]) -> Mark:
    """A sighting with one of its points elsewhere: a dropped one takes part again."""
    if mark is None:
        return Mark((at_px,), "added")
    points = list(mark.points_px)
    place = min(place, len(points) - 1)
    points[place] = (*at_px, *points[place][2:])
    return Mark(tuple(points), "added" if mark.origin == "added" else "moved")


def points_of(marks: Marks, source: str) -> Detections:
    """The points of the sightings that take part, frame after frame; raises `InputError` where none does."""
    rows = _rows(marks)
    if not rows:
        raise InputError(
            f"{source}: no sighting takes part; click where the needle is, or keep what was dropped"
        )
    frames, targets, points, origins = zip(*rows, strict=True)
    return Detections.of_points(np.array(frames), np.array(points), targets, source=source, origin=origins)


def points_csv(marks: Marks) -> bytes:
    """The same as the text of a table of points, which reads back to the last bit."""
    from csv import writer
    from io import StringIO

    rows, text = _rows(marks), StringIO()
    lines = writer(text, lineterminator="\n")
    axes = ("u_px", "v_px", "w_px")[: len(rows[0][2]) if rows else 2]
    lines.writerow(["frame", *axes, "target", "origin"])
    lines.writerows([frame, *place, target, origin] for frame, target, place, origin in rows)
    return text.getvalue().encode()


def _rows(marks: Marks) -> list[tuple[int, str, tuple[float, ...], Origin]]:
    return [
        (frame, target, place, mark.origin)
        for (frame, target), mark in sorted(marks.items())
        if not mark.dropped
        for place in mark.points_px
    ]
