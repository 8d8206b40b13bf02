"""Pictures as PNG files, with no further package."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

__all__ = ["Pixels", "png"]

Pixels = NDArray[np.uint8]


def png(pixels: Pixels) -> bytes:
    """The bytes of a PNG file of (rows, columns[, 3]) uint8 (ISO/IEC 15948)."""
    rows, columns = pixels.shape[:2]
    colour = 2 if pixels.ndim == 3 else 0
    lines = np.concatenate([np.zeros((rows, 1), np.uint8), pixels.reshape(rows, -1)], axis=1)
    header = struct.pack(">IIBBBBB", columns, rows, 8, colour, 0, 0, 0)
    # Said in the file, so that a later run knows a picture of its own.
    software = (b"tEXt", b"Software\0sonocal")
    chunks = [(b"IHDR", header), software, (b"IDAT", zlib.compress(lines.tobytes(), 9)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
