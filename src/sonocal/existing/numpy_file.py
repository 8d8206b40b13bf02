"""A 4 x 4 matrix in NumPy's own files: ``.npy``, or an array of an ``.npz``."""

from __future__ import annotations

import re
import struct
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.existing.matrix import Matrices, checked
from sonocal.files import file_size, read_at
from sonocal.files.kinds import Format, Head
from sonocal.geometry import Array

__all__ = ["FORMAT", "read_numpy"]

MAGIC, ZIP = b"\x93NUMPY", b"PK\x03\x04"
SHAPE = re.compile(r"'shape'\s*:\s*\(([\d,\s]{1,100})\)")
KIND = re.compile(r"'descr'\s*:\s*'([<>=|]?(?:f[248]|[iu][1248]))'")
FORTRAN = re.compile(r"'fortran_order'\s*:\s*True")
# Of an array's file: its header and 16 numbers.
ARRAY_LIMIT = 64 << 10
ARCHIVE_LIMIT, MOST_ARRAYS = 256 << 20, 1000
# What Python's zipfile raises of damaged and of encrypted archives.
DAMAGE = (
    *(zipfile.BadZipFile, zlib.error, struct.error, NotImplementedError, RuntimeError, EOFError, OSError),
    *(ValueError, KeyError, OverflowError, MemoryError, IndexError),
)
# Ways to compress that NumPy writes.
COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


def read_numpy(path: Path) -> Matrices:
    """The matrix of an ``.npy``, or all of an ``.npz``; nothing pickled is looked into.

    Raises:
        FormatError: it is damaged, or holds no 4 x 4 array of numbers.
        InputError: a matrix cannot be inverted.
    """
    start = read_at(path, 0, ARRAY_LIMIT)
    if start.startswith(ZIP):
        return _archive(path)
    try:
        matrix = _array(start)
    except ValueError as error:
        raise FormatError(f"{path.name}: is a damaged .npy file ({error}); save it again"[:300]) from None
    if matrix is None:
        raise FormatError(f"{path.name}: holds no 4 x 4 array of numbers; save the matrix alone")
    return Matrices(path.name, FORMAT.name, (checked(path.name, matrix),))


def _archive(path: Path) -> Matrices:
    if file_size(path) > ARCHIVE_LIMIT:
        raise UnsupportedError(f"{path.name}: is larger than {ARCHIVE_LIMIT >> 20} MB; save the matrix alone")
    try:
        found = list(_members(path))
    except DAMAGE as error:
        raise FormatError(f"{path.name}: is a damaged .npz file ({error}); save it again"[:300]) from None
    if not found:
        raise FormatError(f"{path.name}: none of its arrays is a 4 x 4 matrix; save the matrix alone")
    name = "" if len(found) == 1 and found[0][0].startswith("arr_") else None
    stored = tuple(
        checked(f"{path.name}, {key}", matrix, key if name is None else name) for key, matrix in found
    )
    return Matrices(path.name, FORMAT.name, stored)


def _members(path: Path) -> Iterator[tuple[str, Array]]:
    """The 4 x 4 arrays of an archive by their names; of others the start alone is read."""
    with zipfile.ZipFile(path) as archive:
        for one in archive.infolist()[:MOST_ARRAYS]:
            if one.filename.endswith(".npy") and one.compress_type in COMPRESSIONS:
                with archive.open(one) as member:
                    matrix = _array(member.read(ARRAY_LIMIT))
                if matrix is not None:
                    yield one.filename.removesuffix(".npy"), matrix


def _array(content: bytes) -> Array | None:
    """A 4 x 4 array of numbers; None of other arrays, which are not read.

    Raises:
        ValueError: the start is no header of an array, or numbers are missing.

    Source: NumPy's "NEP 1, a simple file format"; what it says of Python's syntax is more than numbers need.
    """
    if not content.startswith(MAGIC) or len(content) < 12:
        raise ValueError("it does not start as an array does")
    width = 2 if content[6] == 1 else 4
    start = 8 + width
    end = start + int.from_bytes(content[8:start], "little")
    header = content[start : min(end, ARRAY_LIMIT)].decode("latin-1")
    shape, kind = SHAPE.search(header), KIND.search(header)
    if shape is None or kind is None:
        return None
    sizes = [int(size) for size in re.findall(r"\d{1,9}", shape[1])]
    if sizes[-2:] != [4, 4] or any(size != 1 for size in sizes[:-2]):
        return None
    dtype = np.dtype(kind[1])
    if len(content) < end + 16 * dtype.itemsize:
        raise ValueError("numbers are missing")
    numbers = np.frombuffer(content, dtype, 16, end).astype(float).reshape(4, 4)
    return numbers.T if FORTRAN.search(header) else numbers


def _sniff(head: Head) -> bool:
    first = head.content[30:300]  # of an archive: the name of the first file in it
    return head.content.startswith(MAGIC) or (head.content.startswith(ZIP) and b".npy" in first)


FORMAT = Format(
    name="4 x 4 matrix of NumPy",
    kind="matrix",
    suffixes=(".npy", ".npz"),
    sniff=_sniff,
    read=read_numpy,
    holds="a 4 x 4 array; of several in an `.npz` the one that `--transform` names",
)
