"""Writing PLUS sequence metafiles: ``.mha``, or ``.mhd`` beside a ``.raw`` or ``.zraw``."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from sonocal.errors import UnsupportedError
from sonocal.files import path_of, writing
from sonocal.recording.formats.parts.item_lines import item_lines
from sonocal.recording.formats.parts.metaio_header import ELEMENT_TYPES, FIELD, STRUCTURE
from sonocal.recording.formats.parts.written import (
    check_field,
    is_sequence,
    kept_fields,
    little_endian,
    pixels_of,
    stored_orientation,
)
from sonocal.recording.model import Recording

__all__ = ["element_type", "write_metaio"]

# Room for the size of the compressed pixels, which is known only after the header is written.
SIZE_DIGITS = 20


def write_metaio(recording: Recording, path: str | Path, compress: bool = True) -> None:
    """Write a recording as PLUS does; reading it again gives the same frames, poses, times and fields.

    Frames are written one at a time, in the MF orientation they were read in.

    Args:
        recording: what to write.
        path: ``.mha`` (one file) or ``.mhd`` (pixels in a file beside it).
        compress: with zlib.

    Raises:
        InputError: a field cannot stand in a header, or the file cannot be written; nothing is left half
            written.
    """
    path = path_of(path)
    compress = compress and recording.image is not None
    if path.suffix.lower() == ".mhd":
        data = path.with_suffix(".zraw" if compress else ".raw")
        with writing(data) as pixels, writing(path) as header:  # both or neither
            _write_header(recording, header, compress, data.name)
            size = _write_pixels(recording, pixels, compress)
            _fill_size(header, size, compress)
        return
    with writing(path) as file:
        _write_header(recording, file, compress, "LOCAL")
        size = _write_pixels(recording, file, compress)
        _fill_size(file, size, compress)


def _write_header(recording: Recording, file: BinaryIO, compress: bool, data: str) -> None:
    # MetaIO reads on after ElementDataFile, so that field comes last.
    for key, text in _header_lines(recording, compress):
        file.write(f"{key} = {text}\n".encode())
    file.write(f"ElementDataFile = {data}\n".encode())


def _header_lines(recording: Recording, compress: bool) -> Iterator[tuple[str, str]]:
    for key, text in _structure(recording, compress).items():
        yield key, text
        if key == "CompressedData" and compress:
            yield "CompressedDataSize", " " * SIZE_DIGITS
    if recording.image is not None:
        yield "UltrasoundImageOrientation", stored_orientation(recording)
    for key, text in kept_fields(recording, "metaio").items():
        check_field(recording, key, text, FIELD, STRUCTURE)
        yield key, text
    if is_sequence(recording):
        yield from item_lines(recording)


def _structure(recording: Recording, compress: bool) -> dict[str, str]:
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
        "ElementType": "MET_OTHER" if image is None else element_type(recording.name, np.dtype(image.dtype)),
    }


def element_type(name: str, dtype: np.dtype[Any]) -> str:
    """What MetaIO calls a type of pixels.

    Raises:
        UnsupportedError: it has no word for it.
    """
    for element, code in ELEMENT_TYPES.items():
        if np.dtype(code) == dtype:
            return element
    raise UnsupportedError(f"{name}: pixels of type {dtype} have no MetaIO type; convert them to uint8")


def _write_pixels(recording: Recording, file: BinaryIO, compress: bool) -> int:
    deflate = zlib.compressobj()
    written = 0
    for frame in pixels_of(recording):
        block = little_endian(frame)
        written += file.write(deflate.compress(block) if compress else block)
    if compress:
        written += file.write(deflate.flush())
    return written


def _fill_size(file: BinaryIO, size: int, compress: bool) -> None:
    if not compress:
        return
    file.flush()
    file.seek(0)
    while line := file.readline():
        if line.startswith(b"CompressedDataSize"):
            file.seek(-len(line), 1)
            file.write(f"CompressedDataSize = {size:<{SIZE_DIGITS}d}".encode())
            return
