"""A recording that grows an item at a time: images wait in a file of this process, so that memory is bounded."""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Mapping
from dataclasses import dataclass, field
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
        poses: (4, 4) by (source, target), such as ``("Probe", "Tracker")``; None, or no entry, where a tool is lost: no
            pose is used again.
        image: (rows, columns) or (slices, rows, columns); None where there is none.
    """

    time_s: float
    poses: Mapping[tuple[str, str], Array | None] = field(default_factory=dict)
    image: NDArray[Any] | None = None

    __repr__ = brief


class RecordingStream:
    """Items one after the other, seen as a recording whenever one asks.

    Args:
        name: what messages call it.
        form: where it comes from, in words.
    """

    def __init__(self, name: str = "live", form: str = "memory") -> None:
        self._provenance = Provenance(name, form)
        self._times: list[float] = []
        self._poses: dict[tuple[str, str], dict[int, Array]] = {}
        self._stored: list[int] = []
        self._spool: _Spool | None = None

    def __len__(self) -> int:
        return len(self._times)

    def __repr__(self) -> str:
        return f"<RecordingStream {self._provenance.name[:40]!r}: {len(self)} items>"

    @property
    def name(self) -> str:
        """What messages call it."""
        return self._provenance.name

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
        for key in item.poses:
            self._poses.setdefault(key, {})
        for key, pose in poses.items():
            self._poses[key][len(self)] = pose
        self._times.append(float(item.time_s))

    def recording(self) -> Recording:
        """All items so far; those that come later do not change it.

        Raises:
            InputError: two tools' names differ in spelling alone.
        """
        count, frames = len(self), no_frames()
        valid = np.zeros(count, dtype=bool)
        image = None
        if self._spool is not None:
            valid[self._stored] = True
            frames = _Spooled(self._spool, count, self._stored)
            image = ImageGeometry.of(frames, len(self._spool.shape), "MF")
        poses = [_column(source, target, count, found) for (source, target), found in self._poses.items()]
        return Recording(
            np.array(self._times),
            frames,
            by_name(poses, self._provenance.name),
            image,
            valid,
            provenance=self._provenance,
        )

    def close(self) -> None:
        """Give the images' room back: recordings of the stream cannot be read any more."""
        if self._spool is not None:
            self._spool.close()

    def _store(self, image: NDArray[Any], where: str) -> None:
        if self._spool is None:
            check_frame_size(where, image.shape, image.dtype)
            if image.ndim not in (2, 3):
                raise InputError(f"{where}: an image must be (rows, columns) or a volume; got {image.shape}")
            self._spool = _Spool(image)
        if (image.shape, image.dtype) != (self._spool.shape, self._spool.dtype):
            raise InputError(
                f"{where}: its image is {image.shape} {image.dtype} where those before were {self._spool.shape} "
                f"{self._spool.dtype}; leave the scanner's depth and format as they are, or begin again"
            )
        self._spool.add(image)
        self._stored.append(len(self))


class _Spool:
    """Images of one shape in a file without a name, which goes with the process."""

    def __init__(self, first: NDArray[Any]) -> None:
        self.shape, self.dtype, self._bytes = first.shape, first.dtype, first.nbytes
        self._file = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the stream
        self._lock = threading.Lock()

    def add(self, image: NDArray[Any]) -> None:
        with self._lock:
            self._file.seek(0, 2)
            self._file.write(np.ascontiguousarray(image).data)

    def read(self, index: int) -> bytes:
        with self._lock:
            self._file.seek(index * self._bytes)
            return self._file.read(self._bytes)

    def close(self) -> None:
        self._file.close()


class _Spooled(Frames):
    """The images of the first `count` items; black where an item has none, which is marked invalid."""

    def __init__(self, spool: _Spool, count: int, stored: list[int]) -> None:
        self._spool, self._count = spool, count
        self._place = {item: place for place, item in enumerate(stored)}
        self.shape, self.dtype = spool.shape, spool.dtype

    def __len__(self) -> int:
        return self._count

    def read(self, index: int) -> Image:
        """Image `index`."""
        if index not in self._place:
            return np.zeros(self.shape, self.dtype)
        return as_frame("live", index, self._spool.read(self._place[index]), self.shape, self.dtype)


def _column(source: str, target: str, count: int, found: Mapping[int, Array]) -> Poses:
    matrices = np.full((count, 4, 4), np.nan)
    for index, pose in found.items():
        matrices[index] = pose
    return Poses.of(source, target, matrices)
