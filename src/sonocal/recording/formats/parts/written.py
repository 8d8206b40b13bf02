"""What writers of every format need of a recording."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Literal

import numpy as np

from sonocal.errors import InputError
from sonocal.recording.frames import Image
from sonocal.recording.model import Recording

__all__ = [
    "METAIO_GEOMETRY",
    "NRRD_GEOMETRY",
    "check_field",
    "is_sequence",
    "kept_fields",
    "little_endian",
    "pixels_of",
    "stored_orientation",
]

# Fields in which each format keeps where the image lies; they mean nothing to the other one.
METAIO_GEOMETRY = (
    "AnatomicalOrientation",
    "CenterOfRotation",
    "ElementSize",
    "ElementSpacing",
    "Offset",
    "Orientation",
    "Origin",
    "Position",
    "Rotation",
    "TransformMatrix",
)
NRRD_GEOMETRY = (
    "space",
    "space dimension",
    "space directions",
    "space origin",
    "space units",
    "measurement frame",
    "spacings",
    "labels",
    "units",
    "thicknesses",
    "axis mins",
    "axis maxs",
    "centers",
    "content",
)


def kept_fields(recording: Recording, target: Literal["metaio", "nrrd"]) -> dict[str, str]:
    """The header fields to write back: all that came, but for the other format's geometry.

    The geometry of a file whose axes were turned to MF no longer fits either.
    """
    drop = set(METAIO_GEOMETRY if target == "nrrd" else NRRD_GEOMETRY)
    if recording.image is not None and not _as_stored(recording):
        drop |= set(METAIO_GEOMETRY) | set(NRRD_GEOMETRY)
    kept = {key: text for key, text in recording.fields.items() if key not in drop}
    image = recording.image
    if (
        target == "metaio"
        and image is not None
        and "ElementSpacing" not in kept
        and image.spacing_mm is not None
    ):
        kept["ElementSpacing"] = " ".join(map(repr, image.spacing_mm)) + " 1" * is_sequence(recording)
    return kept


def check_field(
    recording: Recording, key: str, text: str, names: re.Pattern[str], taken: Collection[str] = ()
) -> None:
    """Refuse a field that would be read again as another one, or not at all.

    Args:
        recording: for the message.
        key: the field's name.
        text: its value.
        names: what names the format can hold.
        taken: names that the format itself defines.

    Raises:
        InputError: it cannot stand in a header.
    """
    if not names.fullmatch(key) or key in taken:
        raise InputError(f"{recording.name}: a header cannot hold a field of the name {key!r}; rename it")
    if re.search(r"[\r\n\0]", text):
        raise InputError(
            f"{recording.name}: field {key!r} holds a line break or zero byte and cannot stand in a header"
        )
    try:
        (key + text).encode()
    except UnicodeEncodeError:
        raise InputError(f"{recording.name}: field {key!r} is not Unicode text; write it otherwise") from None


def is_sequence(recording: Recording) -> bool:
    """Whether a file must say that it is a sequence: a lone image without fields is a plain image."""
    described = bool(recording.poses or recording.item_fields or np.isfinite(recording.times).any())
    return described or len(recording) != 1 or not recording.image_valid.all()


def stored_orientation(recording: Recording) -> str:
    """The orientation of the images as they are written: MF, in as many letters as came."""
    image = recording.image
    if image is None:
        return "XX"
    if _as_stored(recording):
        return image.orientation or "XX"
    return "MF" if image.dimension == 2 else "MFA"


def pixels_of(recording: Recording) -> Iterator[Image]:
    """The frames, one at a time, each checked against the header that goes before them."""
    if recording.image is None:
        return
    shape, dtype = recording.frames.shape, recording.frames.dtype
    for index, frame in enumerate(recording.frames):
        if frame.shape != shape or frame.dtype != dtype:
            raise InputError(
                f"{recording.name}, frame {index}: is {frame.shape} {frame.dtype} where the first is {shape} {dtype}"
            )
        yield frame


def little_endian(frame: Image) -> memoryview:
    """The bytes of a frame, as files that we write keep them."""
    return np.ascontiguousarray(frame.astype(frame.dtype.newbyteorder("<"), copy=False)).data


def _as_stored(recording: Recording) -> bool:
    image = recording.image
    if image is None:
        return True
    n = image.dimension
    return np.array_equal(image.image_from_file[:n, :n], np.eye(n))
