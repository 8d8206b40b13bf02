"""Volumes in private elements of DICOM files: found, so that nobody takes the pictures beside them for all there is."""

from __future__ import annotations

import re
import warnings
from contextlib import suppress
from typing import Any

from sonocal.errors import UnsupportedError
from sonocal.files import read_at
from sonocal.findings import Diagnostic
from sonocal.recording.formats.parts.bounded_file import BoundedFile
from sonocal.recording.formats.parts.dicom_file import DicomFile

__all__ = ["kretz_at", "private_volumes"]

GE = re.compile(r"\bGE\b|GEMS|Kretz|General Electric", re.IGNORECASE)
PHILIPS = re.compile("Philips", re.IGNORECASE)
KRETZ, KRETZ_START = 0x7FE11101, b"KRETZFILE 1.0"
GE_MOVIES, PHILIPS_STREAMS = 0x7FE11001, 0x200D3016
# GE's type of a movie, such as "Trace+3D", and Philips' type of a stream of volumes.
GE_3D, PHILIPS_3D = (
    re.compile(rb"\xe1\x7f\x02\x10.{4,8}[ -~]{0,32}3D", re.DOTALL),
    re.compile(rb"DATATYPE_DIN_3D"),
)
PHILIPS_GROUP, BLOCKS, PHILIPS_PLANES = 0x200D0000, range(0x10, 0x100), "Philips US Imaging DD 036"
GLANCE = 1 << 16


def kretz_at(file: DicomFile) -> int | None:
    """Where GE's Kretz volume starts in the file; None where there is none."""
    if not GE.search(file.text("Manufacturer")):
        return None
    place = _place(file, KRETZ)
    return place if place is not None and read_at(file.path, place, len(KRETZ_START)) == KRETZ_START else None


def private_volumes(file: DicomFile) -> tuple[Diagnostic, ...]:
    """What is to be said of volumes that are not read, and of which the file holds pictures beside them.

    Raises:
        UnsupportedError: it holds no pictures either.
    """
    maker = file.text("Manufacturer")
    for name, tag, sign, whose in (
        (GE, GE_MOVIES, GE_3D, "GE's private volumes (7FE1,1001)"),
        (PHILIPS, PHILIPS_STREAMS, PHILIPS_3D, "Philips' private volumes (200D,3016)"),
    ):
        if name.search(maker) and sign.search(_glance(file, tag)):
            advice = "export Cartesian DICOM from the maker's software, or NRRD from 3D Slicer"
            if file.pixels_at is None:
                raise UnsupportedError(f"{file.name}: holds {whose}, whose layout is not public; {advice}")
            said = Diagnostic(
                code="private-volumes",
                severity="warning",
                message=f"the file holds {whose}, whose layout is not public; the pictures beside them were read",
                advice=advice,
            )
            return (said,)
    return _planes_of_philips(file) if PHILIPS.search(maker) else ()


def _planes_of_philips(file: DicomFile) -> tuple[Diagnostic, ...]:
    """What is to be said where images are likely the planes of a volume: one open reader takes them for that."""
    with suppress(
        Exception
    ):  # pydicom raises many kinds for damaged files, and the images are there all the same
        data = _read(file, [PHILIPS_GROUP | block for block in BLOCKS], defer_size=256)
        named = [
            block for block in BLOCKS if str(data.get(PHILIPS_GROUP | block, "")).find(PHILIPS_PLANES) >= 0
        ]
        spacings = [PHILIPS_GROUP | block << 8 | 0x03 for block in named]
        if any(_place(file, tag) is not None for tag in spacings):
            said = Diagnostic(
                code="private-volumes",
                severity="warning",
                message="the images may be the planes of a volume, whose spacing is in a private element of Philips; "
                "they were read one after the other",
                advice="compare two neighbouring images; if they are planes, export Cartesian DICOM or NRRD",
            )
            return (said,)
    return ()


def _glance(file: DicomFile, tag: int) -> bytes:
    """The first bytes of a private element; none where it is absent."""
    place = _place(file, tag)
    return b"" if place is None else read_at(file.path, place, GLANCE)


def _place(file: DicomFile, tag: int) -> int | None:
    """Where the value of an element is, which may stand behind the pixels; None where it is absent or damaged."""
    try:
        data = _read(file, [tag], defer_size=1)
        if tag not in data:
            return None
        element = data.get_item(tag, keep_deferred=True)
    except (
        Exception
    ):  # pydicom raises many kinds for damaged files, and pictures are worth more than what is private
        return None
    place = getattr(element, "value_tell", None) or getattr(element, "file_tell", None)
    return None if place is None else int(place)


def _read(file: DicomFile, tags: list[int], defer_size: int) -> Any:
    """Some elements of a file as pydicom gives them; longer values are left where they are."""
    import pydicom

    with warnings.catch_warnings(), BoundedFile(file.path) as stream:
        warnings.simplefilter("ignore")
        return pydicom.dcmread(stream, defer_size=defer_size, specific_tags=tags)
