"""Palettes of DICOM images: what each stored value means. DICOM PS3.3, C.7.6.3.1.5 and 6."""

from __future__ import annotations

from typing import Any

import numpy as np

from sonocal.errors import FormatError
from sonocal.geometry import Array
from sonocal.recording.formats.parts.dicom_file import DicomFile
from sonocal.recording.frames import Image

__all__ = ["palette_of"]

COLOURS = ("Red", "Green", "Blue")


def palette_of(file: DicomFile, stored: np.dtype[Any]) -> Image:
    """What each value of the type `stored` means: (values,) where the palette is grey, else (values, 3).

    The first row is of the least value that the type has.

    Raises:
        FormatError: the palette is missing or damaged.
    """
    info = np.iinfo(stored)
    values = np.arange(info.min, int(info.max) + 1)
    if file.get("SegmentedRedPaletteColorLookupTableData") is not None:
        table = _segmented(file, values)
    else:
        table = np.stack([_colour(file, name, values) for name in COLOURS], axis=1)
    return np.ascontiguousarray(table[:, 0] if (table == table[:, :1]).all() else table)


def _colour(file: DicomFile, name: str, values: Image) -> Image:
    """(values,) of one colour; values beside the table have its first or last entry."""
    count, first, bits = _descriptor(file, f"{name}PaletteColorLookupTableDescriptor")
    data = file.get(f"{name}PaletteColorLookupTableData")
    if not isinstance(data, bytes) or bits not in (8, 16) or len(data) < count:
        raise FormatError(f"{file.name}: its palette lacks {name.lower()}, or is shorter than it says")
    if len(data) >= 2 * count:
        entries = np.frombuffer(data, "<u2" if file.data.original_encoding[1] else ">u2", count).astype(
            np.uint16
        )
        entries = entries.astype(np.uint8) if bits == 8 else entries
    else:
        entries = np.frombuffer(data, np.uint8, count)
    return np.asarray(entries[np.clip(values - first, 0, count - 1)])


def _descriptor(file: DicomFile, key: str) -> tuple[int, int, int]:
    """Entries, the value of the first one, bits of an entry."""
    value = file.get(key)
    if isinstance(value, bytes):  # of files without types, where it may be signed or not
        order = "<" if file.data.original_encoding[1] else ">"
        kinds = f"{order}u2", f"{order}i2" if file.number("PixelRepresentation", 0) else f"{order}u2"
        value = [np.frombuffer(value, kinds[i == 1])[i] for i in range(3)] if len(value) == 6 else None
    numbers = _three(value)
    if numbers is None:
        raise FormatError(f"{file.name}: its palette is not described ({key})")
    count, first, bits = (int(number) for number in numbers)
    return count or 1 << 16, first, bits


def _three(value: Any) -> Array | None:
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return None
    return numbers if numbers.shape == (3,) and np.isfinite(numbers).all() else None


def _segmented(file: DicomFile, values: Image) -> Image:
    """(values, 3) of a palette in runs and ramps, which pydicom unrolls."""
    from pydicom.pixels.processing import apply_color_lut

    try:
        table = apply_color_lut(values, file.data)[:, :3]
    except Exception as error:  # pydicom raises many kinds for damaged palettes
        raise FormatError(f"{file.name}: its palette cannot be read ({str(error)[:80]})") from None
    if table.shape != (len(values), 3) or table.dtype not in (np.uint8, np.uint16):
        raise FormatError(f"{file.name}: its palette is not of red, green and blue in 8 or 16 bits")
    return np.asarray(table)
