"""Pieces that bags compress (bz2, lz4, zstd), decompressed no further than they may go."""

from __future__ import annotations

import bz2
import sys
from collections import deque
from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, BinaryIO

from sonocal.errors import FormatError, SonocalError, UnsupportedError
from sonocal.recording.formats.parts.bounded_file import BoundedFile

__all__ = ["PIECE_LIMIT", "check_mcap_chunks", "unpack"]

PIECE_LIMIT = 1 << 28
"""Largest piece that is decompressed at once, bytes: recorders write some megabytes, or one image."""
STEP = 1 << 20
MCAP = b"\x89MCAP0\r\n"
CHUNK, CHUNK_FIXED = 0x06, 40


def unpack(name: str, compression: str, data: bytes, most: int = PIECE_LIMIT) -> bytes:
    """A piece of a bag as it was before it was compressed.

    Args:
        name: of the file, for messages.
        compression: "bz2", "lz4" or "zstd"; "" or "none" leaves it as it is.
        data: the compressed piece.
        most: bytes it may have.

    Raises:
        FormatError: it is damaged, or larger than it may be.
        UnsupportedError: another compression.
    """
    return data if compression in ("", "none") else b"".join(_pieces(name, compression, data, most))


def _pieces(name: str, compression: str, data: bytes, most: int) -> Iterator[bytes]:
    """The steps of a decompression, with its failures as sentences."""
    if compression not in DECODERS:
        raise UnsupportedError(
            f"{name}: is compressed by {compression[:40]!r}; bags have none, lz4, zstd or bz2"
        )
    try:
        yield from _steps(name, DECODERS[compression](), data, most)
    except SonocalError:
        raise
    except Exception as error:  # each decoder raises kinds of its own
        raise FormatError(
            f"{name}: a compressed piece of it is damaged ({str(error)[:60]}); copy it again"
        ) from None


def _steps(name: str, decoder: Any, data: bytes, most: int) -> Iterator[bytes]:
    total = 0
    while not decoder.eof:
        piece = decoder.decompress(data, STEP)
        data, total = b"", total + len(piece)
        if total > most:
            raise FormatError(
                f"{name}: a compressed piece of it holds more than the {most} bytes that it may have"
            )
        if not piece and decoder.needs_input:
            raise FormatError(f"{name}: a compressed piece of it ends early; copy it again")
        yield piece
    if decoder.unused_data:
        raise FormatError(f"{name}: a compressed piece of it goes on after its end; copy it again")


def _lz4() -> Any:
    return import_module("lz4.frame").LZ4FrameDecompressor()


def _zstd() -> Any:
    return import_module(
        "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    ).ZstdDecompressor()


DECODERS: dict[str, Callable[[], Any]] = {"bz2": bz2.BZ2Decompressor, "lz4": _lz4, "zstd": _zstd}


def check_mcap_chunks(path: Path) -> set[int]:
    """Look through an MCAP file before a library trusts what it states, and decompress every chunk once.

    Returns:
        Where its chunks lie.

    Raises:
        FormatError: it was cut short, or a chunk is not what it states.
    """
    chunks = set()
    with BoundedFile(path) as file:
        end = file.seek(0, 2)
        place = file.seek(len(MCAP))
        while place < end - len(MCAP):
            head = file.read(9)
            size = int.from_bytes(head[1:], "little")
            if len(head) < 9 or size > end - file.tell():
                raise FormatError(
                    f"{path.name}: ends within a record at byte {place}: it was cut short, or its recorder was "
                    "stopped; mend it with mcap recover"
                )
            if head[0] == CHUNK:
                chunks.add(place)
                _check_chunk(path.name, file, size)
            place = file.seek(place + 9 + size)
    return chunks


def _check_chunk(name: str, file: BinaryIO, size: int) -> None:
    fixed = file.read(32)
    stated, letters = int.from_bytes(fixed[16:24], "little"), int.from_bytes(fixed[28:32], "little")
    if size < CHUNK_FIXED or letters > min(size - CHUNK_FIXED, 64) or stated > PIECE_LIMIT:
        raise FormatError(
            f"{name}: a chunk states {stated} bytes; those of recorders have less than {PIECE_LIMIT}"
        )
    compression = file.read(letters).decode("latin-1")
    length = int.from_bytes(file.read(8), "little")
    if length > size - CHUNK_FIXED - letters:
        raise FormatError(f"{name}: a chunk states more bytes than it has; copy it again")
    if compression:
        deque(_pieces(name, compression, file.read(length), stated), maxlen=0)  # and none of it is kept
