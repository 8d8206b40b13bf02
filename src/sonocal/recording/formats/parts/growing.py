"""A PLUS sequence metafile that is whole at any time while it grows: ``.mhd``, its images in a ``.raw`` beside it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from sonocal.errors import InputError
from sonocal.recording.formats.parts.metaio_header import GROWN
from sonocal.recording.formats.parts.metaio_write import element_type
from sonocal.recording.formats.parts.sequence_fields import PREFIX
from sonocal.recording.stream import Item, RecordingStream

__all__ = ["GrowingSequence"]


class GrowingSequence(RecordingStream):
    """Items that are in a file as soon as they are added, whatever becomes of this process behind that.

    What says how many there are stands last in the header, behind the fields of the items, so that one write adds an
    item. A file begins with the first image; poses before it are written then.

    Args:
        path: of the header, ``.mhd``; it and the ``.raw`` must not be there.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.data = path, path.with_suffix(".raw")
        if path.suffix != ".mhd":
            raise InputError(f"{path}: a recording that grows is a .mhd with a .raw beside it; name it .mhd")
        for one in (self.path, self.data):
            if os.path.lexists(one):
                raise InputError(f"{one}: is there already; choose another place")
        super().__init__(path.name, "PLUS sequence metafile", self.data)
        self._before: list[Item] = []
        self._header: Any = None
        self._tail = b""
        self._end = 0

    def add(self, item: Item) -> None:
        """Add an item, to memory and to the file.

        Raises:
            InputError: as of a `RecordingStream`, or the file cannot be written.
        """
        super().add(item)
        if self._header is None and item.image is None:
            self._before.append(item)
            return
        try:
            begin = ""
            if self._header is None:
                assert item.image is not None
                begin = self._begin(item.image)
            elif item.image is None:
                os.truncate(self.data, len(self) * self._each)  # a hole, which reads as black
            waiting, self._before = [*self._before, item], []
            first = len(self) - len(waiting)
            lines = [line for i, one in enumerate(waiting, first) for line in _lines(i, one)]
            self._append("".join([begin, *lines]).encode())
        except OSError as error:
            raise InputError(
                f"{self.path}: cannot be written ({error.strerror}); make room, or write elsewhere"
            ) from None

    def close(self) -> None:
        """End the file."""
        super().close()
        if self._header is not None:
            self._header.close()

    def _begin(self, image: np.ndarray[Any, np.dtype[Any]]) -> str:
        self._each = image.nbytes
        sizes = " ".join(map(str, image.shape[::-1]))
        self._tail = f"DimSize = {sizes} %d\nElementDataFile = {self.data.name}\n".encode()
        fields = {
            "ObjectType": "Image",
            "NDims": str(image.ndim + 1),
            "BinaryData": "True",
            "BinaryDataByteOrderMSB": str(image.dtype.newbyteorder("=").str.startswith(">")),
            "CompressedData": "False",
            "Kinds": "domain " * image.ndim + "list",
            "ElementNumberOfChannels": "1",
            "ElementType": element_type(self.path.name, image.dtype),
            "UltrasoundImageOrientation": "MF" if image.ndim == 2 else "MFA",
            GROWN: "True",
        }
        self._header = self.path.open("xb", buffering=0)
        return "".join(f"{key} = {text}\n" for key, text in fields.items())

    def _append(self, lines: bytes) -> None:
        """In place of the tail: the lines, and the tail that counts one item more."""
        self._header.seek(self._end)
        self._header.write(lines + self._tail % len(self))
        self._end += len(lines)


def _lines(index: int, item: Item) -> Iterator[str]:
    prefix = f"{PREFIX}{index:04d}_"
    for (source, target), pose in item.poses.items():
        name = f"{prefix}{source}To{target}Transform"
        if pose is not None:
            yield f"{name} = {' '.join(map(repr, np.asarray(pose, dtype=float).ravel().tolist()))}\n"
        yield f"{name}Status = {'INVALID' if pose is None else 'OK'}\n"
    yield f"{prefix}Timestamp = {float(item.time_s)!r}\n"
    yield f"{prefix}ImageStatus = {'INVALID' if item.image is None else 'OK'}\n"
