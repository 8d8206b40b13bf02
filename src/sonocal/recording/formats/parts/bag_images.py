"""Images in the messages of bags: ``sensor_msgs/Image`` and ``CompressedImage``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sonocal.errors import FormatError, UnsupportedError
from sonocal.geometry import Array
from sonocal.recording.formats.parts.bag import Bag, Message
from sonocal.recording.formats.parts.pictures import Pictures
from sonocal.recording.frames import PICTURE_LIMIT, Frames, Image, check_frame_size

__all__ = ["BagFrames", "stamp_of"]


class Encoding(NamedTuple):
    """How pixels lie: the type of a value, values a pixel, and which of them are red, green, blue."""

    kind: str
    values: int = 1
    colours: tuple[int, ...] = ()


RGB, BGR = (0, 1, 2), (2, 1, 0)
ENCODINGS = {
    "mono8": Encoding("u1"),
    "8UC1": Encoding("u1"),
    "mono16": Encoding("u2"),
    "16UC1": Encoding("u2"),
    "32FC1": Encoding("f4"),
    "rgb8": Encoding("u1", 3, RGB),
    "bgr8": Encoding("u1", 3, BGR),
    "rgba8": Encoding("u1", 4, RGB),
    "bgra8": Encoding("u1", 4, BGR),
    "rgb16": Encoding("u2", 3, RGB),
    "bgr16": Encoding("u2", 3, BGR),
    "rgba16": Encoding("u2", 4, RGB),
    "bgra16": Encoding("u2", 4, BGR),
}
PICTURE_STARTS = (b"\xff\xd8\xff", b"\x89PNG")


class BagFrames(Frames):
    """The images of one topic, decoded when asked for.

    Reading in order costs one pass through the bag. Reading elsewhere starts at the time that the image was
    recorded at.

    Args:
        path: of the bag.
        topic: of the images.
        received: (N,) ns, when each was recorded, in the order of the bag.
    """

    def __init__(self, path: Path, topic: str, received: Array) -> None:
        self._path, self._topic, self._received = path, topic, received
        self._pictures: Pictures | None = None
        self._ahead: tuple[int, Iterator[Image]] | None = None
        with Bag(path) as bag:
            message = next(bag.messages([topic]), None)
            if message is None:
                raise FormatError(
                    f"{bag.name}: the images of {topic[:80]} are not where it says; copy it again"
                )
            first = self._image(message, 0)
        self.shape, self.dtype = first.shape, first.dtype

    def __len__(self) -> int:
        return len(self._received)

    def __iter__(self) -> Iterator[Image]:
        return self._from(0)

    def read(self, index: int) -> Image:
        """Frame `index`; the next one in order costs no search."""
        if self._ahead is None or self._ahead[0] != index:
            self._ahead = (index, self._from(index))
        frame = next(self._ahead[1], None)
        if frame is None:
            raise FormatError(f"{self._path.name}, frame {index}: is not in the bag any more; read it again")
        self._ahead = (index + 1, self._ahead[1])
        return frame

    def _from(self, index: int) -> Iterator[Image]:
        start = int(self._received[index])
        # Those of the same instant come in the order that they have in the bag.
        skipped = int((self._received[:index] >= start).sum())
        with Bag(self._path) as bag:
            for number, message in enumerate(bag.messages([self._topic], start)):
                if number >= skipped:
                    yield self._checked(message, index + number - skipped)

    def _checked(self, message: Message, index: int) -> Image:
        image = self._image(message, index)
        if image.shape != self.shape or image.dtype != self.dtype:
            raise FormatError(
                f"{self._path.name}, frame {index}: is {image.shape} {image.dtype} where the first of {self._topic} is "
                f"{self.shape} {self.dtype}"
            )
        image.flags.writeable = False
        return image

    def _image(self, message: Message, index: int) -> Image:
        where = f"{self._path.name}, frame {index}"
        if hasattr(message.content, "encoding"):
            return _raw(message.content, where, self._topic)
        return self._compressed(message.content, where)

    def _compressed(self, content: Any, where: str) -> Image:
        data = content.data.tobytes()
        if not data.startswith(PICTURE_STARTS):
            raise UnsupportedError(
                f"{where}: {self._topic} has images compressed as {content.format[:40]!r}; jpeg and png are read"
            )
        if self._pictures is None:
            self._pictures = Pictures(self._path, "compressed images need Pillow")
        return self._pictures.decode(data, where, self._pictures.look(data, where))


def stamp_of(header: Any) -> float:
    """The time of a message's header, s."""
    return float(header.stamp.sec) + 1e-9 * float(header.stamp.nanosec)


def _raw(content: Any, where: str, topic: str) -> Image:
    """The pixels of a ``sensor_msgs/Image``; opacity is left out."""
    encoding = ENCODINGS.get(content.encoding)
    if encoding is None:
        raise UnsupportedError(
            f"{where}: {topic} has images of encoding {content.encoding[:40]!r}; {', '.join(ENCODINGS)} are read"
        )
    stored = np.dtype(encoding.kind).newbyteorder(">" if content.is_bigendian else "<")
    rows, columns, step = content.height, content.width, content.step
    used = columns * encoding.values * stored.itemsize
    if not (rows and columns and step >= used and len(content.data) == rows * step):
        raise FormatError(
            f"{where}: states {columns} x {rows} px of {content.encoding} in rows of {step} bytes, and has "
            f"{len(content.data)} bytes; record it again"
        )
    check_frame_size(where, (rows, columns, encoding.values), stored, PICTURE_LIMIT)
    pixels = np.ascontiguousarray(content.data.reshape(rows, step)[:, :used]).view(stored)
    pixels = pixels.astype(stored.newbyteorder("="), copy=False)
    if not encoding.colours:
        return pixels
    return np.ascontiguousarray(pixels.reshape(rows, columns, encoding.values)[..., encoding.colours])
