"""A contact sheet: small images with what was found in them, as a PNG that needs no further package."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from numpy.typing import NDArray

from sonocal.detection import Candidates, as_grey
from sonocal.errors import InputError
from sonocal.geometry import Array
from sonocal.recording import Recording

__all__ = ["contact_sheet", "png"]

Pixels = NDArray[np.uint8]

COLUMNS = 4
TILE_PX = 320
OTHER, FIRST, CHOSEN = (255, 170, 0), (255, 230, 90), (60, 230, 90)


def contact_sheet(
    recording: Recording,
    candidates: Candidates,
    chosen: tuple[NDArray[np.int64], Array] | None = None,
    tiles: int = 12,
) -> Pixels:
    """Images spread over a recording with candidates marked: orange, yellow the best, green the chosen one.

    Args:
        recording: 2D images.
        candidates: of its images.
        chosen: frames (M,) and points (M, 2) px that a calibration rests on.
        tiles: how many images.

    Returns:
        (rows, columns, 3) uint8.

    Raises:
        InputError: the recording has no images.
    """
    if len(recording.frames) == 0:
        raise InputError(f"{recording.name}: has no images to show")
    wanted = np.unique(
        np.linspace(0, len(recording.frames) - 1, min(tiles, len(recording.frames))).astype(int)
    )
    pictures = [_tile(recording, candidates, chosen, int(i)) for i in wanted]
    pictures += [np.zeros_like(pictures[0])] * (-len(pictures) % COLUMNS)
    rows = [np.hstack(pictures[i : i + COLUMNS]) for i in range(0, len(pictures), COLUMNS)]
    return np.asarray(np.vstack(rows))


def png(pixels: Pixels) -> bytes:
    """The bytes of a PNG file of (rows, columns[, 3]) uint8 (ISO/IEC 15948)."""
    rows, columns = pixels.shape[:2]
    colour = 2 if pixels.ndim == 3 else 0
    lines = np.concatenate([np.zeros((rows, 1), np.uint8), pixels.reshape(rows, -1)], axis=1)
    header = struct.pack(">IIBBBBB", columns, rows, 8, colour, 0, 0, 0)
    chunks = [(b"IHDR", header), (b"IDAT", zlib.compress(lines.tobytes(), 9)), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _tile(
    recording: Recording, candidates: Candidates, chosen: tuple[NDArray[np.int64], Array] | None, index: int
) -> Pixels:
    grey = as_grey(recording.frames[index], 2, f"{recording.name}, frame {index}")
    step = max(grey.shape) / TILE_PX
    rows, columns = (max(1, int(n / step)) for n in grey.shape)
    v, u = np.arange(rows) * step, np.arange(columns) * step
    tile = np.repeat(
        grey.clip(0, 255).astype(np.uint8)[v.astype(int)[:, None], u.astype(int), None], 3, axis=2
    )
    here = np.flatnonzero(candidates.frame == index)
    for rank, row in reversed(list(enumerate(here))):
        _cross(tile, candidates.points_px[row] / step, FIRST if rank == 0 else OTHER)
    if chosen is not None:
        for row in np.flatnonzero(chosen[0] == index):
            _cross(tile, chosen[1][row] / step, CHOSEN)
    tile[-1], tile[:, -1] = 60, 60
    return tile


def _cross(tile: Pixels, place: Array, colour: tuple[int, int, int]) -> None:
    """Four strokes around a place, which itself stays visible."""
    u, v = (round(float(x)) for x in place)
    for reach in range(4, 9):
        for du, dv in ((reach, 0), (-reach, 0), (0, reach), (0, -reach)):
            if 0 <= v + dv < tile.shape[0] and 0 <= u + du < tile.shape[1]:
                tile[v + dv, u + du] = colour
