"""MetaIO images and PLUS sequence metafiles: ``.mha``, ``.igs.mha``, ``.seq.mha``, ``.mhd`` + ``.raw``.

Own code where libraries exist: the ones there are fail on recordings of a tracker alone
(``DimSize = 0 0 N``, ``MET_OTHER``), decode a whole file at once, or weigh 200 MB.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.files import beside, file_beside, file_size
from sonocal.files.kinds import Format, Head
from sonocal.recording.formats.parts.inflate import ZLIB, InflatedFrames
from sonocal.recording.formats.parts.layout import Layout, assemble, check_sizes
from sonocal.recording.formats.parts.metaio_header import (
    ELEMENT_TYPES,
    GROWN,
    STRUCTURE,
    Header,
    read_header,
)
from sonocal.recording.formats.parts.metaio_write import write_metaio
from sonocal.recording.formats.parts.written import METAIO_GEOMETRY
from sonocal.recording.frames import Frames, RawFrames, no_frames
from sonocal.recording.model import Provenance, Recording

__all__ = ["FORMAT", "read_metaio"]

# Any of these makes a header: the first line may be another field.
FIELDS = re.compile(rb"^(ObjectType|NDims|DimSize|ElementType|ElementDataFile)[ \t]*=", re.MULTILINE)


def read_metaio(path: Path) -> Recording:
    """Read a MetaIO image or a PLUS sequence metafile.

    Args:
        path: the ``.mha``, or the ``.mhd`` beside its data file.

    Raises:
        FormatError: the header is damaged, or does not match the data.
        UnsupportedError: a kind of MetaIO that recordings do not use.
    """
    header = read_header(path)
    layout, as_stored = _layout(header)
    data_path, offset = _data_place(path, header, layout)
    frames = no_frames() if layout.image_free else _frames(header, layout, data_path, offset)
    left = STRUCTURE if as_stored else (*STRUCTURE, *METAIO_GEOMETRY)  # would not fit the axes we write
    kept = {key: text for key, text in header.fields.items() if key not in left}
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


def _layout(header: Header) -> tuple[Layout, bool]:
    """How the frames lie, and whether the axes of a frame are those of the file: a lone slice is an image."""
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
    count = sizes[-1] if dimensions > 2 and _is_sequence(header, sizes) else None
    frame = sizes if count is None else sizes[:-1]
    single_slice = count is not None and len(frame) == 3 and frame[2] == 1
    frame = frame[:2] if single_slice else frame
    channels = (*header.whole("ElementNumberOfChannels"), 1)[0]
    dtype, spacing = _dtype(header, 0 in frame), _spacing(header, len(frame))
    layout = Layout(header.name, frame, 1 if count is None else count, channels, dtype, spacing)
    return layout, not single_slice


def _is_sequence(header: Header, sizes: tuple[int, ...]) -> bool:
    """Whether the last axis is the time line.

    Some writers mark a plain volume's third axis as a list, and others a volume's fields as an item's: what counts is
    what the fields of items describe, and the name where there are none.
    """
    kinds, described = header.fields.get("Kinds", "").split(), header.items.count
    if len(sizes) == 4:
        return True
    if kinds and kinds[-1] == "list":
        return described > 0 or bool(re.search(r"\.(igs|seq)\.", header.name))
    return described > 0 and (not kinds or described == sizes[-1])


def _dtype(header: Header, image_free: bool) -> np.dtype[Any]:
    element = header.fields.get("ElementType", "")
    if image_free:
        return np.dtype("u1")
    if element not in ELEMENT_TYPES:
        raise UnsupportedError(
            f"{header.name}: ElementType {element[:40]!r} is not one of {', '.join(ELEMENT_TYPES)}"
        )
    big = header.true("BinaryDataByteOrderMSB") or header.true("ElementByteOrderMSB")
    return np.dtype((">" if big else "<") + ELEMENT_TYPES[element])


def _spacing(header: Header, dimension: int) -> tuple[float, ...] | None:
    text = header.fields.get("ElementSpacing", header.fields.get("ElementSize", ""))
    try:
        spacing = tuple(float(word) for word in text.split())
    except ValueError:
        raise FormatError(f"{header.name}: ElementSpacing = {text[:60]!r} is not of numbers") from None
    return spacing[:dimension] if len(spacing) >= dimension else None


def _data_place(path: Path, header: Header, layout: Layout) -> tuple[Path, int]:
    name = header.fields["ElementDataFile"]
    if name.upper() == "LOCAL":
        return path, header.end
    if not name or name.split()[0].upper() == "LIST" or "%" in name:
        raise UnsupportedError(
            f"{path.name}: keeps every frame in its own file ({name[:40]!r}); convert it to .mha"
        )
    if layout.image_free:
        return beside(path, name), 0
    data = file_beside(path, name)
    if data is None:
        raise FormatError(
            f"{path.name}: its data file {name[:80]} is not beside it; copy both files together"
        )
    return data, _skipped(header, data, layout)


def _skipped(header: Header, data: Path, layout: Layout) -> int:
    """Bytes before the pixels of a separate data file."""
    skip, size = (*header.whole("HeaderSize"), 0)[0], file_size(data)
    if skip == -1:  # MetaIO: the pixels are the last bytes of the file
        skip = size - layout.total_bytes
    if not 0 <= skip <= size:
        raise FormatError(f"{header.name}: HeaderSize {skip} does not fit the {size} bytes of {data.name}")
    return skip


def _frames(header: Header, layout: Layout, path: Path, offset: int) -> Frames:
    if header.fields.get("BinaryData", "True")[:1] not in ("T", "t", "1"):
        raise UnsupportedError(f"{header.name}: holds pixels as text; convert it to a binary .mha")
    if not header.true("CompressedData"):
        # A recorder that was killed may have written an image that its header does not count yet.
        exactly = not header.true(GROWN)
        return RawFrames(path, offset, layout.count, layout.shape, layout.dtype, exactly=exactly)
    length = (*header.whole("CompressedDataSize"), None)[0]
    return InflatedFrames(path, offset, length, layout.count, layout.shape, layout.dtype, ZLIB)


def _sniff(head: Head) -> bool:
    return re.match(rb"\w+[ \t]*=", head.text) is not None and FIELDS.search(head.text) is not None


FORMAT = Format(
    name="PLUS sequence metafile, MetaIO image",
    kind="recording",
    suffixes=(".mha", ".mhd"),
    sniff=_sniff,
    read=read_metaio,
    holds="plain and zlib; 2D and 3D frames; 8 to 64 bit, float, colour; either byte order; a tracker alone "
    "(`DimSize = 0 0 N`, `MET_OTHER`); a volume without fields of items, or without a list axis, is one frame; "
    "frames of a single slice are images",
    write=write_metaio,
    writes=(".mha", ".mhd"),
)
