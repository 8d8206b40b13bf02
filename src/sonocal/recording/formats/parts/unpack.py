"""Pieces that bags compress (bz2, lz4, zstd), decompressed no further than they may go."""

from __future__ import annotations

import bz2
import sys
from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

from sonocal.errors import FormatError, SonocalError, UnsupportedError

__all__ = ["DECODERS", "PIECE_LIMIT", "pieces", "unpack"]

PIECE_LIMIT = 1 << 28
"""Largest piece that is decompressed at once, bytes: recorders write some megabytes, or one image."""
STEP = 1 << 20


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
    return data if compression in ("", "none") else b"".join(pieces(name, compression, data, most))


def pieces(name: str, compression: str, data: bytes, most: int) -> Iterator[bytes]:
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
