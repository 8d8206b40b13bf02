"""The fields of the items of a sequence as lines of its header, such that they are read as what they are."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping

import numpy as np

from sonocal.errors import InputError
from sonocal.recording.formats.parts.sequence_fields import IMAGE_STATUS, PREFIX, TRANSFORM
from sonocal.recording.formats.parts.written import check_field
from sonocal.recording.model import Recording
from sonocal.recording.poses import Poses

__all__ = ["check_times", "item_lines"]

# What a field of an item may be called, so that it is read as itself from MetaIO and from NRRD.
ITEM_FIELD = re.compile(r"(?!.+To[A-Z0-9_].*Transform(Status)?$)[^=:\s\0]([^=:\r\n\0]*[^=:\s\0])?")


def item_lines(recording: Recording) -> Iterator[tuple[str, str]]:
    """The fields of every item as ``(key, text)``, to the last digit, in the order PLUS writes them.

    Raises:
        InputError: a field could not be read again as what it is.
    """
    _check_names(recording)
    fields = _item_fields(recording)
    if recording and not any(_of_item(recording, fields, len(recording) - 1)):
        # Readers count items by what describes them.
        vouched = recording.image_valid if recording.image is not None else [True] * len(recording)
        fields |= {IMAGE_STATUS[0]: tuple("OK" if good else "INVALID" for good in vouched)}
    for i in range(len(recording)):
        yield from _of_item(recording, fields, i)


def _of_item(
    recording: Recording, fields: Mapping[str, tuple[str | None, ...]], i: int
) -> Iterator[tuple[str, str]]:
    prefix = f"{PREFIX}{i:0{max(4, len(str(len(recording) - 1)))}d}_"
    for one in recording.poses.values():
        matrix = one.matrices[i].ravel().tolist()
        if not all(map(math.isnan, matrix)):  # an item without the pose has NaN throughout
            yield f"{prefix}{one.plus_name}Transform", " ".join(map(repr, matrix))
        if (status := _status(one, i, matrix)) is not None:
            yield f"{prefix}{one.plus_name}TransformStatus", status
    if not math.isnan(stamp := float(recording.times[i])):
        yield f"{prefix}Timestamp", repr(stamp)
    for name, column in fields.items():
        if (text := column[i]) is not None:
            yield f"{prefix}{name}", text


def _status(poses: Poses, i: int, matrix: list[float]) -> str | None:
    said = None if poses.status is None else poses.status[i]
    if poses.status is None:
        return "OK" if poses.valid[i] else "INVALID"
    return _vouched(said, bool(poses.valid[i])) if all(map(math.isfinite, matrix)) else said


def _vouched(said: str | None, valid: bool) -> str | None:
    """A status that is read as what the recording holds to be valid, whatever was said of it before."""
    if (said in (None, "OK")) == valid:
        return said
    return "OK" if valid else "INVALID"


def _item_fields(recording: Recording) -> dict[str, tuple[str | None, ...]]:
    """The other fields of the items, and whether the recorder vouches for their images."""
    fields = dict(recording.item_fields)
    if recording.image is None:
        return fields
    name = next((name for name in IMAGE_STATUS if name in fields), IMAGE_STATUS[0])
    said = fields.get(name, (None,) * len(recording))
    stated = tuple(map(_vouched, said, recording.image_valid.tolist()))
    return fields | {name: stated} if any(stated) else fields


def check_times(recording: Recording) -> None:
    """Refuse times of which some are none.

    Raises:
        InputError: they are.
    """
    finite = np.isfinite(recording.times)
    if not (finite.all() or np.isnan(recording.times).all()):
        i = int(np.flatnonzero(~finite)[0])
        raise InputError(
            f"{recording.name}, frame {i}: its time is {recording.times[i]} where others have one; "
            "give every item a time, or none"
        )


def _check_names(recording: Recording) -> None:
    """Refuse what would be read again as something else, or not at all."""
    check_times(recording)
    for one in recording.poses.values():
        match = TRANSFORM.fullmatch(f"{one.plus_name}Transform")
        if match is None or match.groups() != (one.source, one.target):
            raise InputError(
                f"{recording.name}: the transform {one.plus_name!r} would not be read as {one.source!r} to "
                f"{one.target!r} again; frames have names such as Probe, Needle2 and Tracker"
            )
        check_field(recording, one.plus_name, "".join(filter(None, one.status or ())), ITEM_FIELD)
    for name, column in recording.item_fields.items():
        check_field(recording, name, "".join(filter(None, column)), ITEM_FIELD, ("Timestamp",))
