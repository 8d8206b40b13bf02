"""Writing NRRD sequences as PLUS does."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sonocal.errors import UnsupportedError
from sonocal.files import writing
from sonocal.recording.formats.parts.inflate import GZIP
from sonocal.recording.formats.parts.item_lines import item_lines
from sonocal.recording.formats.parts.nrrd_header import (
    ORIENTATION_KEY,
    PAIR,
    TYPES,
)
from sonocal.recording.formats.parts.written import (
    NRRD_GEOMETRY,
    check_field,
    is_sequence,
    kept_fields,
    little_endian,
    pixels_of,
    stored_orientation,
)
from sonocal.recording.model import Recording

__all__ = ["write_nrrd"]


def write_nrrd(recording: Recording, path: str | Path, compress: bool = True) -> None:
    """Write a recording as a PLUS NRRD sequence; reading it again gives the same frames, poses, times, fields.

    Args:
        recording: what to write.
        path: ``.nrrd``.
        compress: with gzip.

    Raises:
        InputError: a field cannot stand in a header, or the file cannot be written.
        UnsupportedError: the pixels have no NRRD type.
    """
    compress = compress and recording.image is not None
    with writing(path) as file:
        file.write(b"NRRD0005\n")
        for key, text, separator in _header_lines(recording, compress):
            file.write(f"{key}{separator}{text}\n".encode())
        file.write(b"\n")
        deflate = zlib.compressobj(wbits=GZIP)
        for frame in pixels_of(recording):
            block = little_endian(frame)
            file.write(deflate.compress(block) if compress else block)
        if compress:
            file.write(deflate.flush())


def _header_lines(recording: Recording, compress: bool) -> Iterator[tuple[str, str, str]]:
    kept = kept_fields(recording, "nrrd")
    geometry = {key: kept.pop(key) for key in NRRD_GEOMETRY if key in kept}
    # Readers want the dimension first and the space before the directions in it.
    for key, text in (_structure(recording, compress) | _geometry(recording, geometry)).items():
        yield key, text, ": "
    if recording.image is not None:
        yield ORIENTATION_KEY, stored_orientation(recording), ":="
    for key, text in kept.items():
        check_field(recording, key, text, PAIR, (ORIENTATION_KEY,))
        yield key, text, ":="
    if is_sequence(recording):
        for key, text in item_lines(recording):
            yield key, text, ":="


def _structure(recording: Recording, compress: bool) -> dict[str, str]:
    image = recording.image
    sizes = [0, 0] if image is None else list(image.size_px)
    kinds = ["domain"] * len(sizes)
    if image is not None and image.channels > 1:
        sizes, kinds = [image.channels, *sizes], ["vector", *kinds]
    if is_sequence(recording):
        sizes, kinds = [*sizes, len(recording)], [*kinds, "list"]
    return {
        "type": "uint8" if image is None else _type(recording.name, np.dtype(image.dtype)),
        "dimension": str(len(sizes)),
        "sizes": " ".join(map(str, sizes)),
        "kinds": " ".join(kinds),
        "endian": "little",
        "encoding": "gzip" if compress else "raw",
    }


def _geometry(recording: Recording, kept: dict[str, str]) -> dict[str, str]:
    image = recording.image
    if kept or image is None or (image.spacing_mm is None and not is_sequence(recording)):
        return kept
    # Sequences say 1 where the spacing is not known, as PLUS does.
    n = image.dimension
    spacing = image.spacing_mm or (1.0,) * n
    vectors = [
        "(" + ",".join(repr(float(s)) if i == k else "0" for i in range(n)) + ")"
        for k, s in enumerate(spacing)
    ]
    vectors = ["none"] * (image.channels > 1) + vectors + ["none"] * is_sequence(recording)
    return {
        "space dimension": str(n),
        "space directions": " ".join(vectors),
        "space origin": f"({','.join('0' * n)})",
    }


def _type(name: str, dtype: np.dtype[np.generic]) -> str:
    for code, names in TYPES.items():
        if np.dtype(code) == dtype:
            return names[0]
    raise UnsupportedError(f"{name}: pixels of type {dtype} have no NRRD type; convert them to uint8")
