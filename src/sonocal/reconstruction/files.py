"""Volumes in files, MetaIO (``.mha``) and NRRD (``.nrrd``), without compression: bricks are written where they belong.

A frame's x, y, z are read as the left, posterior and superior of a patient, as PLUS writes them ("lps"), or as right,
anterior and superior, as 3D Slicer shows what a tracker streams ("ras").
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.files import path_of, writing
from sonocal.reconstruction.grid import Grid

__all__ = ["SUFFIXES", "Axes", "mapped", "of_file", "volume_header", "write_array"]

Axes = Literal["lps", "ras"]
SUFFIXES = (".mha", ".nrrd")
METAIO_TYPES = {"uint8": "MET_UCHAR", "uint16": "MET_USHORT", "float32": "MET_FLOAT"}
NRRD_TYPES = {"uint8": "uint8", "uint16": "uint16", "float32": "float"}
SIGNS = {"lps": (1.0, 1.0, 1.0), "ras": (-1.0, -1.0, 1.0)}
ZEROS = 1 << 24
DIRTY_BYTES = 64 << 20
"""Smaller files may stay in memory until they are whole."""


def volume_header(path: Path, grid: Grid, dtype: np.dtype[Any], reference: str, axes: Axes = "lps") -> bytes:
    """The header of a volume's file.

    Raises:
        InputError: its name is of no format that volumes are written in.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: volumes are written as {' or '.join(SUFFIXES)}; choose one of these names")
    frame = " ".join(reference.split()) or "Reference"
    lines = (_metaio if suffix == ".mha" else _nrrd)(grid, dtype, frame, axes)
    return "".join(f"{line}\n" for line in lines).encode("utf-8", "replace")


def _metaio(grid: Grid, dtype: np.dtype[Any], frame: str, axes: Axes) -> list[str]:
    sign = SIGNS[axes]
    matrix = np.diag(sign).reshape(-1)
    return [
        "ObjectType = Image",
        "NDims = 3",
        "BinaryData = True",
        "BinaryDataByteOrderMSB = False",
        "CompressedData = False",
        f"TransformMatrix = {_numbers(matrix)}",
        f"Offset = {_numbers(sign * grid.origin_mm)}",
        "CenterOfRotation = 0 0 0",
        f"AnatomicalOrientation = {'RAI' if axes == 'lps' else 'LPI'}",
        f"ElementSpacing = {_numbers(grid.spacing_mm)}",
        f"DimSize = {_numbers(grid.size)}",
        "Kinds = domain domain domain",
        "UltrasoundImageOrientation = MFA",
        f"ReferenceCoordinateFrame = {frame}",
        f"ElementType = {METAIO_TYPES[dtype.name]}",
        "ElementDataFile = LOCAL",
    ]


def _nrrd(grid: Grid, dtype: np.dtype[Any], frame: str, axes: Axes) -> list[str]:
    vectors = " ".join(
        "(" + ",".join(repr(float(s)) if i == k else "0" for i in range(3)) + ")"
        for k, s in enumerate(grid.spacing_mm)
    )
    space = {"lps": "left-posterior-superior", "ras": "right-anterior-superior"}[axes]
    return [
        "NRRD0005",
        f"type: {NRRD_TYPES[dtype.name]}",
        "dimension: 3",
        f"space: {space}",
        f"sizes: {_numbers(grid.size)}",
        f"space directions: {vectors}",
        "kinds: domain domain domain",
        "endian: little",
        "encoding: raw",
        f"space origin: ({','.join(_numbers(grid.origin_mm).split())})",
        "ultrasound image orientation:=MFA",
        f"ReferenceCoordinateFrame:={frame}",
        "",
    ]


def _numbers(values: Any) -> str:
    return " ".join(f"{float(x):.17g}" if float(x) != 0 else "0" for x in values)


@contextmanager
def mapped(
    path: Path, header: bytes, shape: tuple[int, ...], dtype: np.dtype[Any]
) -> Iterator[tuple[NDArray[Any], Callable[[], None]]]:
    """An array that is a file: it appears under its name when all of it is written, or not at all.

    Room on the disk is taken before the first voxel is written, so that a full one is told in a sentence.

    Returns:
        The array, and what to call when a piece of it was written.

    Raises:
        InputError: it cannot be written, such as for want of room.
    """
    path = path_of(path)
    size = int(np.prod(shape, dtype=np.int64)) * dtype.itemsize
    with writing(path) as file:
        file.write(header)
        file.flush()
        _take_room(file.fileno(), len(header), size)
        pages = mmap.mmap(file.fileno(), len(header) + size)
        try:
            array = np.frombuffer(pages, dtype=dtype.newbyteorder("<"), offset=len(header)).reshape(shape)
            yield array, _release(pages, len(header) + size)
            pages.flush()
        finally:
            array = np.empty(0)
            with suppress(BufferError):  # of an array that a failure's traceback still holds
                pages.close()


def _take_room(handle: int, start: int, size: int) -> None:
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(handle, 0, start + size)
        return
    os.lseek(handle, start, os.SEEK_SET)
    for done in range(0, size, ZEROS):
        os.write(handle, b"\0" * min(ZEROS, size - done))


def _release(pages: mmap.mmap, size: int) -> Callable[[], None]:
    """What gives written pages to the system, so that a file larger than the memory may be written."""

    def release() -> None:
        if size > DIRTY_BYTES and hasattr(pages, "madvise"):
            pages.madvise(
                mmap.MADV_DONTNEED
            )  # of a file: its pages are the system's to write, and no longer ours

    return release


def of_file(path: Path, header: bytes, shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """The array of a file that was written, read as it is asked for."""
    return np.memmap(path, dtype=dtype.newbyteorder("<"), mode="r", offset=len(header), shape=shape)


def write_array(path: Path, array: NDArray[Any], grid: Grid, reference: str, axes: Axes = "lps") -> None:
    """Write an array [z, y, x] as a volume, whole or not at all.

    Raises:
        InputError: it cannot be written, or its name is of no format that volumes are written in.
    """
    header = volume_header(path, grid, array.dtype, reference, axes)
    with writing(path) as file:
        file.write(header)
        for layer in array:
            file.write(np.ascontiguousarray(layer, dtype=array.dtype.newbyteorder("<")).data)
