"""A DICOM file, opened by pydicom: damage ends in a sentence, and no length in it is believed."""

from __future__ import annotations

import struct
import warnings
from collections.abc import MutableSequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError
from sonocal.files import file_size
from sonocal.geometry import FURTHEST, Array
from sonocal.recording.formats.parts.bounded_file import BoundedFile
from sonocal.recording.formats.parts.layout import COUNT_LIMIT
from sonocal.recording.formats.parts.packages import needed

__all__ = ["DicomFile", "Item"]

# What is read of the header; other values are passed over, since private ones hold whole volumes.
KEYS = (
    *(
        "SOPClassUID",
        "Manufacturer",
        "FrameTime",
        "FrameTimeVector",
        "CineRate",
        "RecommendedDisplayFrameRate",
    ),
    *(
        "AcquisitionDateTime",
        "AcquisitionTime",
        "ContentTime",
        "NumberOfFrames",
        "Rows",
        "Columns",
        "PixelSpacing",
    ),
    *(
        "SamplesPerPixel",
        "PhotometricInterpretation",
        "PlanarConfiguration",
        "PixelRepresentation",
        "PixelPresentation",
    ),
    *("BitsAllocated", "BitsStored", "HighBit", "ExtendedOffsetTable", "ExtendedOffsetTableLengths"),
    *(f"{colour}PaletteColorLookupTableDescriptor" for colour in ("Red", "Green", "Blue")),
    *(f"{cut}{c}PaletteColorLookupTableData" for cut in ("", "Segmented") for c in ("Red", "Green", "Blue")),
    *("SequenceOfUltrasoundRegions", "SharedFunctionalGroupsSequence", "PerFrameFunctionalGroupsSequence"),
    *("PhysicalDeltaX", "PhysicalDeltaY", "PhysicalUnitsXDirection", "PhysicalUnitsYDirection"),
    *(0x30010010, 0x30011001, 0x30011002, 0x30011003),  # Philips' volumes
)
PIXEL_DATA = (0x7FE0, 0x0010)


@dataclass(frozen=True)
class Item:
    """A data set: the file's own, or an item of a sequence in it; pydicom parses values when they are asked for.

    Attributes:
        name: of the file, for messages.
        data: pydicom's.
    """

    name: str
    data: Any

    def get(self, key: Any) -> Any:
        """A value by its keyword or tag; None where it is absent or empty.

        Raises:
            FormatError: it is damaged.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = self.data.get(key)
            found = getattr(found, "value", found) if isinstance(key, int) else found
        except Exception as error:  # pydicom raises many kinds for damaged values
            raise FormatError(f"{self.name}: its {_named(key)} cannot be read ({str(error)[:60]})") from None
        return None if found is None or (isinstance(found, str) and not found) else found

    def text(self, key: Any) -> str:
        """A value as text, without the blanks around it; empty where it is absent."""
        value = self.get(key)
        if isinstance(value, MutableSequence):  # several; damaged, items of a sequence
            value = "\\".join(one for one in value if isinstance(one, str))
        return str(value or "").strip(" \0")

    def number(self, key: Any, default: float) -> float:
        """A finite number; the default where it is absent.

        Raises:
            FormatError: it is none.
        """
        if (value := self.get(key)) is None:
            return default
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError, AttributeError):
            number = np.nan
        if not np.isfinite(number):
            raise FormatError(f"{self.name}: its {_named(key)} is not a number")
        return number

    def numbers(self, key: Any, count: int) -> Array | None:
        """`count` numbers of usual size; None where the value is absent.

        Raises:
            FormatError: they are others.
        """
        value = self.get(key)
        if value is None:
            return None
        try:
            found = np.atleast_1d(np.asarray(value, dtype=float))
        except (TypeError, ValueError, OverflowError):
            found = np.empty(0)
        if found.shape != (count,) or not np.all(np.abs(found) < FURTHEST):
            raise FormatError(f"{self.name}: its {_named(key)} is not {count} numbers ({str(value)[:60]})")
        return found

    def items(self, key: Any) -> list[Item]:
        """The items of a sequence; none where it is absent.

        Raises:
            FormatError: it is no sequence.
        """
        value = self.get(key)
        try:
            return [Item(self.name, data) for data in value or () if hasattr(data, "get")]
        except Exception as error:  # an item may be damaged, too
            raise FormatError(f"{self.name}: its {_named(key)} cannot be read ({str(error)[:60]})") from None


@dataclass(frozen=True)
class DicomFile(Item):
    """A DICOM file without its pixels.

    Attributes:
        path: of the file.
        pixels_at: where the value of its pixel data starts; None where it has none.
        pixels_vr: the type of that value, where the file says.
    """

    path: Path
    pixels_at: int | None
    pixels_vr: str | None

    @classmethod
    def open(cls, path: Path) -> DicomFile:
        """Read the header of a file.

        Raises:
            UnsupportedError: pydicom is not installed.
            FormatError: the file is not DICOM.
        """
        file_size(path)
        pydicom = needed("pydicom", path, "DICOM needs pydicom")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                with BoundedFile(path) as file:
                    data = pydicom.dcmread(file, stop_before_pixels=True, specific_tags=list(KEYS))
                    return cls(path.name, data, path, *_pixels(file, *data.original_encoding))
        except Exception as error:  # pydicom raises many kinds for damaged files
            raise FormatError(f"{path.name}: is not a DICOM file ({str(error)[:80]})") from None

    @property
    def sop_class(self) -> str:
        """What kind of DICOM it is, as a UID."""
        return self.text("SOPClassUID")

    @property
    def frame_count(self) -> int:
        """How many images it says that it holds.

        Raises:
            FormatError: more than any recording has, or none.
        """
        count = int(self.number("NumberOfFrames", 1))
        if not 1 <= count <= COUNT_LIMIT:
            raise FormatError(f"{self.name}: states {count} frames; is it damaged?")
        return count

    @property
    def transfer_syntax(self) -> Any:
        """How the pixels are written; the plain way in which the header is where the file does not say."""
        from pydicom import uid

        stated = getattr(self.data, "file_meta", {}).get("TransferSyntaxUID")
        implicit, little = self.data.original_encoding
        plain = uid.ExplicitVRLittleEndian if little else uid.ExplicitVRBigEndian
        return stated or (uid.ImplicitVRLittleEndian if implicit else plain)


def _pixels(file: BoundedFile, implicit: bool, little: bool) -> tuple[int | None, str | None]:
    """Where the value of the pixel data starts, and its type: pydicom stops before the element."""
    place, head = file.tell(), file.read(8)
    if len(head) < 8 or struct.unpack("<HH" if little else ">HH", head[:4]) != PIXEL_DATA:
        return None, None
    return (place + 8, None) if implicit else (place + 12, head[4:6].decode("ascii", "replace"))


def _named(key: Any) -> str:
    return f"value ({key >> 16:04X},{key & 0xFFFF:04X})" if isinstance(key, int) else str(key)
