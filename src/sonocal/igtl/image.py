"""IMAGE: an image or a volume, or a part of one."""

from __future__ import annotations

import math
import struct
import sys
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import FormatError, InputError
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.igtl.fields import Bytes, as_floats, floats, take

__all__ = ["Image"]

_HEAD = "HBBBB3H48x3H3H"
_HEAD_BYTES = struct.calcsize(">" + _HEAD)
_MATRIX_AT = 12
_SCALARS = {2: "i1", 3: "u1", 4: "i2", 5: "u2", 6: "i4", 7: "u4", 10: "f4", 11: "f8"}
_CODES = {np.dtype(name): code for code, name in _SCALARS.items()}
_BIG, _LITTLE = 1, 2
_NATIVE = _LITTLE if sys.byteorder == "little" else _BIG
MOST_SIDE = (1 << 16) - 1


@dataclass(frozen=True, eq=False)
class Image:
    """Pixels, and where they lie.

    Attributes:
        pixels: (slices, rows, columns[, channels]): those that the message carries.
        size_px: (u, v, w) of the whole image.
        offset_px: where the pixels begin in it.
        matrix: (3, 4), mm: steps of one px along u, v and w, and the place of the image's centre.
        coordinates: 1 for RAS, 2 for LPS.
        version: of the image's header.
    """

    kind: ClassVar[str] = "IMAGE"
    pixels: NDArray[Any]
    size_px: tuple[int, int, int]
    offset_px: tuple[int, int, int] = (0, 0, 0)
    matrix: Array | None = None
    coordinates: int = 1
    version: int = 1

    __repr__ = brief

    @classmethod
    def of(cls, pixels: NDArray[Any]) -> Self:
        """A whole image (rows, columns) or volume (slices, rows, columns), of numbers of one channel."""
        volume = pixels[None] if pixels.ndim == 2 else pixels
        if volume.ndim < 3 or max(volume.shape[:3]) > MOST_SIDE:
            raise InputError(
                f"an image to send must have 2 to 4 axes of at most {MOST_SIDE}; got {pixels.shape}"
            )
        w, v, u = volume.shape[:3]
        return cls(volume, (u, v, w))

    @classmethod
    def from_bytes(cls, body: Bytes, where: str) -> Self:
        """Decoded from the content of a message; its pixels are copied."""
        version, channels, scalar, endian, coordinates, *numbers = take(_HEAD, body, where)
        size, offset, part = numbers[:3], numbers[3:6], numbers[6:]
        if scalar not in _SCALARS or endian not in (_BIG, _LITTLE) or not channels:
            raise FormatError(
                f"{where}: an image of scalar type {scalar}, byte order {endian} and {channels} channels; "
                "the protocol has types 2 to 7, 10 and 11, orders 1 and 2, and at least one channel"
            )
        if any(begin + count > whole for begin, count, whole in zip(offset, part, size, strict=True)):
            raise FormatError(
                f"{where}: a part of {_sides(part)} px at {_sides(offset)} is beyond the image of {_sides(size)}; "
                "see what sends it"
            )
        stored = np.dtype((">" if endian == _BIG else "<") + _SCALARS[scalar])
        due = math.prod(part) * channels * stored.itemsize
        if len(body) != _HEAD_BYTES + due:
            raise FormatError(
                f"{where}: {_sides(part)} px of {channels} x {stored.name} take {due} bytes, "
                f"{len(body) - _HEAD_BYTES} arrived; see what sends it"
            )
        shape = (*part[::-1], *([channels] if channels > 1 else []))
        pixels = np.frombuffer(body, stored, offset=_HEAD_BYTES).reshape(shape)
        matrix = floats(body, 12, _MATRIX_AT).reshape(4, 3).T
        copied = pixels.astype(stored.newbyteorder("="), copy=True)
        return cls(copied, tuple(size), tuple(offset), matrix, coordinates, version)

    def as_bytes(self) -> tuple[Bytes, ...]:
        """The content of the message, in this machine's byte order: the pixels are not copied."""
        pixels = np.ascontiguousarray(self.pixels).view(self.pixels.dtype.newbyteorder("="))
        if pixels.dtype not in _CODES or pixels.ndim not in (3, 4):
            raise InputError(
                f"pixels to send must be whole numbers of 8 to 32 bits or floats, with 3 or 4 axes; got "
                f"{self.pixels.dtype} with {self.pixels.ndim}"
            )
        channels = pixels.shape[3] if pixels.ndim == 4 else 1
        if not 1 <= channels <= 255:
            raise InputError(f"an image to send must have 1 to 255 channels; got {channels}")
        matrix = np.eye(3, 4) if self.matrix is None else self.matrix
        about = self.version, channels, _CODES[pixels.dtype], _NATIVE, self.coordinates
        head = bytearray(
            struct.pack(">" + _HEAD, *about, *self.size_px, *self.offset_px, *pixels.shape[2::-1])
        )
        head[_MATRIX_AT : _MATRIX_AT + 48] = as_floats(matrix.T)
        return bytes(head), pixels.reshape(-1).view(np.uint8).data

    def placed_in(self, volume: NDArray[Any]) -> None:
        """Write the part that this message carries into the whole, an array (slices, rows, columns[, channels]).

        Raises:
            InputError: the whole is of another size, type or number of channels.
        """
        shape = (*self.size_px[::-1], *self.pixels.shape[3:])
        if volume.shape != shape or volume.dtype != self.pixels.dtype:
            raise InputError(
                f"the whole must be of {shape} {self.pixels.dtype}; got {volume.shape} {volume.dtype}"
            )
        part = tuple(
            slice(begin, begin + count)
            for begin, count in zip(self.offset_px[::-1], self.pixels.shape, strict=False)
        )
        volume[part] = self.pixels


def _sides(counts: list[int]) -> str:
    return " x ".join(map(str, counts))
