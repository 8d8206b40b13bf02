"""MetaIO images and PLUS sequence metafiles: ``.mha``, ``.igs.mha``, ``.seq.mha``, ``.mhd`` + ``.raw``.

Own code where libraries exist: the ones there are fail on recordings of a tracker alone
(``DimSize = 0 0 N``, ``MET_OTHER``), decode a whole file at once, or weigh 200 MB.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.files import beside, file_size, reading
from sonocal.recording.formats.inflate import (
    ZLIB,
    InflatedFrames,
)
from sonocal.recording.formats.layout import (
    Layout,
    assemble,
    check_sizes,
)
from sonocal.recording.formats.sequence_fields import (
    PREFIX,
    ItemFields,
)
from sonocal.recording.frames import Frames, RawFrames, no_frames
from sonocal.recording.model import Provenance, Recording

__all__ = ["ELEMENT_TYPES", "STRUCTURE", "read_metaio"]

ELEMENT_TYPES = {
    "MET_UCHAR": "u1",
    "MET_CHAR": "i1",
    "MET_USHORT": "u2",
    "MET_SHORT": "i2",
    "MET_UINT": "u4",
    "MET_INT": "i4",
    "MET_ULONG_LONG": "u8",
    "MET_LONG_LONG": "i8",
    "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}
# What the format itself defines; the writer states it anew, everything else is kept as it came.
STRUCTURE = (
    "ObjectType",
    "NDims",
    "BinaryData",
    "BinaryDataByteOrderMSB",
    "ElementByteOrderMSB",
    "CompressedData",
    "CompressedDataSize",
    "DimSize",
    "ElementNumberOfChannels",
    "ElementType",
    "HeaderSize",
    "Kinds",
    "UltrasoundImageOrientation",
    "ElementDataFile",
)
KEY = re.compile(r"[A-Za-z_][\w .\-]*")
# A line of a header; longer ones are pixels taken for text.
LINE_LIMIT = 1 << 20


@dataclass
class _Header:
    name: str
    fields: dict[str, str]
    items: ItemFields
    end: int

    def whole(self, key: str) -> tuple[int, ...]:
        """The whole numbers of a field; () where it is absent."""
        text = self.fields.get(key, "")
        if not all(re.fullmatch(r"[+-]?\d{1,18}", word) for word in text.split()):
            raise FormatError(f"{self.name}: {key} = {text[:60]!r} is not of whole numbers")
        return tuple(int(word) for word in text.split())

    def true(self, key: str) -> bool:
        """Whether a field is set; MetaIO reads the first letter."""
        return self.fields.get(key, "")[:1] in ("T", "t", "1")


def read_metaio(path: Path) -> Recording:
    """Read a MetaIO image or a PLUS sequence metafile.

    Args:
        path: the ``.mha``, or the ``.mhd`` beside its data file.

    Raises:
        FormatError: the header is damaged, or does not match the data.
        UnsupportedError: a kind of MetaIO that recordings do not use.
    """
    header = _read_header(path)
    layout = _layout(header)
    data_path, offset = _data_place(path, header, layout)
    frames = no_frames() if layout.image_free else _frames(header, layout, data_path, offset)
    kept = {key: text for key, text in header.fields.items() if key not in STRUCTURE}
    paths = (str(path),) if data_path == path else (str(path), str(data_path))
    kind = "PLUS sequence metafile" if header.items.columns else "MetaIO image"
    return assemble(
        layout,
        frames,
        header.items,
        orientation=header.fields.get("UltrasoundImageOrientation", ""),
        fields=kept,
        provenance=Provenance(path.name, kind, paths),
    )


def _read_header(path: Path) -> _Header:
    fields: dict[str, str] = {}
    items = ItemFields(path.name)
    name, number = path.name, 0
    with reading(path), path.open("rb") as file:
        while line := file.readline(LINE_LIMIT):
            number += 1
            text = _text(name, number, line)
            key, equals, value = text.partition("=")
            if key[:9] == PREFIX and equals:  # most lines by far
                items.add(key.rstrip(), value.strip())
                continue
            key = key.strip()
            if not key and not equals:
                continue
            if not equals or not KEY.fullmatch(key):
                raise FormatError(
                    f"{name}, line {number}: {text.strip()[:60]!r} is not 'name = value' of a MetaIO header"
                )
            if key in fields:
                raise FormatError(f"{name}, line {number}: {key} stands twice in the header; delete one")
            fields[key] = value.strip()
            if key == "ElementDataFile":
                return _Header(name, fields, items, file.tell())
    if not fields:
        raise FormatError(f"{name}: is empty; a MetaIO file starts with a header")
    raise FormatError(f"{name}: its header ends without ElementDataFile; it was cut short, copy it again")


def _text(name: str, number: int, line: bytes) -> str:
    if len(line) == LINE_LIMIT or b"\0" in line:
        raise FormatError(f"{name}, line {number}: is not text; a MetaIO header ends with ElementDataFile")
    try:
        return line.decode("utf-8")
    except UnicodeDecodeError:
        raise FormatError(f"{name}, line {number}: is not UTF-8 text; a MetaIO header is") from None


def _layout(header: _Header) -> Layout:
    if header.fields.get("ObjectType", "Image") != "Image":
        raise UnsupportedError(
            f"{header.name}: holds a MetaIO {header.fields['ObjectType'][:40]}, not an image"
        )
    sizes, (dimensions, *_) = header.whole("DimSize"), (*header.whole("NDims"), 0)
    if len(sizes) != dimensions or dimensions not in (2, 3, 4):
        raise FormatError(
            f"{header.name}: DimSize = {header.fields.get('DimSize', '')!r} does not fit NDims = "
            f"{header.fields.get('NDims', '')!r}; recordings have 2, 3 or 4 dimensions"
        )
    check_sizes(header.name, sizes)
    # Some writers mark a plain volume's third axis as a list: fields of items, or the name, make it a sequence.
    named = header.fields.get("Kinds", "").endswith("list") and re.search(r"\.(igs|seq)\.", header.name)
    is_sequence = bool(header.items.columns or named) or dimensions == 4
    *frame, count = sizes if is_sequence and dimensions > 2 else (*sizes, 1)
    image_free = 0 in frame
    channels = (*header.whole("ElementNumberOfChannels"), 1)[0]
    return Layout(
        header.name, tuple(frame), count, channels, _dtype(header, image_free), _spacing(header, len(frame))
    )


def _dtype(header: _Header, image_free: bool) -> np.dtype[Any]:
    element = header.fields.get("ElementType", "")
    if image_free:
        return np.dtype("u1")
    if element not in ELEMENT_TYPES:
        raise UnsupportedError(
            f"{header.name}: ElementType {element[:40]!r} is not one of {', '.join(ELEMENT_TYPES)}"
        )
    big = header.true("BinaryDataByteOrderMSB") or header.true("ElementByteOrderMSB")
    return np.dtype((">" if big else "<") + ELEMENT_TYPES[element])


def _spacing(header: _Header, dimension: int) -> tuple[float, ...] | None:
    text = header.fields.get("ElementSpacing", header.fields.get("ElementSize", ""))
    try:
        spacing = tuple(float(word) for word in text.split())
    except ValueError:
        raise FormatError(f"{header.name}: ElementSpacing = {text[:60]!r} is not of numbers") from None
    return spacing[:dimension] if len(spacing) >= dimension else None


def _data_place(path: Path, header: _Header, layout: Layout) -> tuple[Path, int]:
    name = header.fields["ElementDataFile"]
    if name.upper() == "LOCAL":
        return path, header.end
    if not name or name.split()[0].upper() == "LIST" or "%" in name:
        raise UnsupportedError(
            f"{path.name}: keeps every frame in its own file ({name[:40]!r}); convert it to .mha"
        )
    data = beside(path, name)
    if layout.image_free:
        return data, 0
    if not data.is_file():
        raise FormatError(f"{path.name}: its data file {name} is not beside it; copy both files together")
    return data, _skipped(header, data, layout)


def _skipped(header: _Header, data: Path, layout: Layout) -> int:
    """Bytes before the pixels of a separate data file."""
    skip, size = (*header.whole("HeaderSize"), 0)[0], file_size(data)
    if skip == -1:  # MetaIO: the pixels are the last bytes of the file
        skip = size - layout.total_bytes
    if not 0 <= skip <= size:
        raise FormatError(f"{header.name}: HeaderSize {skip} does not fit the {size} bytes of {data.name}")
    return skip


def _frames(header: _Header, layout: Layout, path: Path, offset: int) -> Frames:
    if header.fields.get("BinaryData", "True")[:1] not in ("T", "t", "1"):
        raise UnsupportedError(f"{header.name}: holds pixels as text; convert it to a binary .mha")
    if not header.true("CompressedData"):
        return RawFrames(path, offset, layout.count, layout.shape, layout.dtype)
    length = (*header.whole("CompressedDataSize"), None)[0]
    return InflatedFrames(path, offset, length, layout.count, layout.shape, layout.dtype, ZLIB)


def structure_of(recording: Recording, compress: bool) -> Mapping[str, str]:
    """The header fields that the format itself defines, for a recording to be written."""
    image = recording.image
    sequence = is_sequence(recording)
    sizes = (0, 0) if image is None else image.size_px
    dims = [*sizes, len(recording)] if sequence else list(sizes)
    kinds = ["domain"] * len(sizes) + ["list"] * sequence
    return {
        "ObjectType": "Image",
        "NDims": str(len(dims)),
        "BinaryData": "True",
        "BinaryDataByteOrderMSB": "False",
        "CompressedData": str(compress),
        "DimSize": " ".join(map(str, dims)),
        "Kinds": " ".join(kinds),
        "ElementNumberOfChannels": str(1 if image is None else image.channels),
        "ElementType": "MET_OTHER" if image is None else _element_type(recording.name, np.dtype(image.dtype)),
    }


def is_sequence(recording: Recording) -> bool:
    """Whether a file must say that it is a sequence: a lone image without fields is a plain image."""
    described = bool(recording.poses or recording.item_fields or np.isfinite(recording.times).any())
    return described or len(recording) != 1 or recording.image is None


def _element_type(name: str, dtype: np.dtype[Any]) -> str:
    for element, code in ELEMENT_TYPES.items():
        if np.dtype(code) == dtype:
            return element
    raise UnsupportedError(f"{name}: pixels of type {dtype} have no MetaIO type; convert them to uint8")
