"""A recording that grows an item at a time: images wait in a file, so that memory is bounded."""

from __future__ import annotations

import tempfile
import threading
import weakref
from bisect import bisect_left
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError, require
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.recording.frames import Frames, Image, as_frame, check_frame_size, no_frames
from sonocal.recording.model import ImageGeometry, Provenance, Recording
from sonocal.recording.poses import Poses, by_name

__all__ = ["Item", "RecordingStream"]


@dataclass(frozen=True, eq=False)
class Item:
    """What a scanner and a tracker gave for one time.

    Attributes:
        time_s: in the recorder's clock.
        poses: (4, 4) by (source, target), such as ``("Probe", "Tracker")``; None, or no entry, where a tool is lost:
            the pose before is never used again.
        image: (rows, columns) or (slices, rows, columns); None where there is none.
    """

    time_s: float
    poses: Mapping[tuple[str, str], Array | None] = field(default_factory=dict)
    image: NDArray[Any] | None = None

    __repr__ = brief


class RecordingStream:
    """Items one after the other, seen as a recording whenever one asks; one thread may add while others ask.

    Args:
        name: what messages call it.
        form: where it comes from, in words.
        images: a new file that keeps the images, one after the other; without one they go with the process.
    """

    def __init__(self, name: str = "live", form: str = "memory", images: Path | None = None) -> None:
        self._provenance = Provenance(name, form, () if images is None else (str(images),))
        self._images = images
        self._lock = threading.Lock()
        self._times: list[float] = []
        self._poses: dict[tuple[str, str], dict[int, Array]] = {}
        self._stored: list[int] = []
        self._spool: _Spool | None = None

    def __len__(self) -> int:
        return len(self._times)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self._provenance.name[:40]!r}: {len(self)} items>"

    def add(self, item: Item) -> None:
        """Add an item.

        Raises:
            InputError: its time is no number, a pose has another shape, or its image is unlike those before; nothing of
                it is kept then.
        """
        require("item", item, Item)
        where = f"{self._provenance.name}, item {len(self)}"
        if not np.isfinite(item.time_s):
            raise InputError(f"{where}: its time must be a number of seconds; got {item.time_s}")
        poses = {key: np.array(pose, dtype=float) for key, pose in item.poses.items() if pose is not None}
        for (source, target), pose in poses.items():
            if pose.shape != (4, 4):
                raise InputError(f"{where}: {source}To{target} must have shape (4, 4); got {pose.shape}")
        if item.image is not None:
            self._store(item.image, where)
        with self._lock:
            for key in item.poses:
                self._poses.setdefault(key, {})
            for key, pose in poses.items():
                self._poses[key][len(self)] = pose
            if item.image is not None:
                self._stored.append(len(self))
            self._times.append(float(item.time_s))

    @property
    def name(self) -> str:
        """What messages call it."""
        return self._provenance.name

    @property
    def stored(self) -> int:
        """How many items have an image."""
        return len(self._stored)

    def time_s(self, index: int) -> float:
        """When an item was taken."""
        return self._times[index]

    def image_item(self, number: int) -> int:
        """Of the items that have an image, the index of one."""
        return self._stored[number]

    def image(self, number: int) -> tuple[int, Image]:
        """Of the items that have an image, the index of one and its image."""
        assert self._spool is not None
        index, spool = self._stored[number], self._spool
        return index, as_frame(self.name, index, spool.read(index), spool.shape, spool.dtype)

    def item(self, index: int) -> Item:
        """An item as it was added."""
        with self._lock:
            poses = {names: found.get(index) for names, found in self._poses.items()}
            place = bisect_left(self._stored, index)
            stored = self._stored[place : place + 1] == [index]
            time_s = self._times[index]
        return Item(time_s, poses, self.image(place)[1] if stored else None)

    def recording(self, since: int = 0) -> Recording:
        """All items so far, or those from one on; those that come later do not change it.

        Raises:
            InputError: two tools' names differ in spelling alone.
        """
        with self._lock:
            times, end = np.array(self._times[since:]), len(self)
            poses = [_column(*names, since, end, found) for names, found in self._poses.items()]
            valid = np.zeros(end - since, dtype=bool)
            valid[np.array(self._stored[bisect_left(self._stored, since) :], dtype=int) - since] = True
        frames, image = no_frames(), None
        if valid.any():
            assert self._spool is not None
            frames = _Spooled(self._spool, valid, since)
            image = ImageGeometry.of(frames, len(self._spool.shape), "MF")
        by = by_name(poses, self._provenance.name)
        return Recording(times, frames, by, image, valid, provenance=self._provenance)

    def close(self) -> None:
        """Give the images' room back: recordings of the stream cannot be read any more."""
        if self._spool is not None:
            self._spool.close()

    def _store(self, image: NDArray[Any], where: str) -> None:
        if self._spool is None:
            check_frame_size(where, image.shape, image.dtype)
            if image.ndim not in (2, 3):
                raise InputError(f"{where}: an image must be (rows, columns) or a volume; got {image.shape}")
            self._spool = _Spool(image, self._images)
        if (image.shape, image.dtype) != (self._spool.shape, self._spool.dtype):
            raise InputError(
                f"{where}: its image is {image.shape} {image.dtype} where those before were {self._spool.shape} "
                f"{self._spool.dtype}; leave the scanner's depth and format as they are, or begin again"
            )
        self._spool.add(len(self), image)


class _Spool:
    """Images of one shape in a file, each at its item's place; what lies between is a hole, and reads as black."""

    def __init__(self, first: NDArray[Any], path: Path | None) -> None:
        self.shape, self.dtype, self._bytes = first.shape, first.dtype, first.nbytes
        # Closed with the stream, or with the last that reads it; unbuffered: what was written outlives the process.
        if path is None:
            self._file: Any = tempfile.TemporaryFile(buffering=0)  # noqa: SIM115
        else:
            with _kept(path):
                self._file = path.open("x+b", buffering=0)
        weakref.finalize(self, self._file.close)
        self._lock = threading.Lock()

    def add(self, index: int, image: NDArray[Any]) -> None:
        left = np.ascontiguousarray(image).reshape(-1).view(np.uint8).data
        with self._lock, _kept(self._file.name):
            self._file.seek(index * self._bytes)
            while left:
                left = left[self._file.write(left) :]

    def read(self, index: int) -> bytes:
        pieces, missing = [], self._bytes
        with self._lock:
            self._file.seek(index * self._bytes)
            while missing and (piece := self._file.read(missing)):
                pieces.append(piece)
                missing -= len(piece)
        return b"".join(pieces)

    def close(self) -> None:
        self._file.close()


class _Spooled(Frames):
    """The images of some items (N,) in a row; black where an item has none, which is marked invalid."""

    def __init__(self, spool: _Spool, valid: NDArray[np.bool_], since: int) -> None:
        self._spool, self._valid, self._since = spool, valid, since
        self.shape, self.dtype = spool.shape, spool.dtype

    def __len__(self) -> int:
        return len(self._valid)

    def read(self, index: int) -> Image:
        """Image `index`."""
        if not self._valid[index]:
            return np.zeros(self.shape, self.dtype)
        return as_frame("live", index, self._spool.read(self._since + index), self.shape, self.dtype)


@contextmanager
def _kept(name: object) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{name}: an image cannot be written ({error.strerror}); make room, or write elsewhere"
        ) from None


def _column(source: str, target: str, since: int, end: int, found: Mapping[int, Array]) -> Poses:
    matrices = np.full((end - since, 4, 4), np.nan)
    for index in found if since == 0 else filter(found.__contains__, range(since, end)):
        matrices[index - since] = found[index]
    return Poses.of(source, target, matrices)
