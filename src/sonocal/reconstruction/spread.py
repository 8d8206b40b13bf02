"""Bricks filled by workers, such as a cluster's: each fills one alone, and sends its voxels back."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.files import read_at
from sonocal.reconstruction.batches import Crossing
from sonocal.reconstruction.pieces import Piece, boxes_of, new_piece
from sonocal.reconstruction.store import MOST_COUNTED, Store
from sonocal.reconstruction.sureness import Repeated
from sonocal.recording import Frames
from sonocal.recording.frames import as_frame

__all__ = ["Workforce", "crosses", "fill_by"]

TASKS_A_WORKER = 2
Report = Callable[[int, int], None]


class Workforce(Protocol):
    """Who fills bricks: an executor, and how many it has now; see `sonocal.studies.cluster`."""

    @property
    def executor(self) -> Executor:
        """Anything that behaves as `concurrent.futures.Executor`."""

    @property
    def count(self) -> Callable[[], int]:
        """How many workers there are now."""


class Stored(Frames):
    """Decoded images in a file that all workers see.

    Args:
        path: of the file.
        rows: (n,), which of the recording's images are in it, one after the other.
        shape: of an image.
        dtype: of its pixels.
    """

    def __init__(
        self, path: Path, rows: NDArray[np.int64], shape: tuple[int, int], dtype: np.dtype[Any]
    ) -> None:
        self._path, self._rows = path, rows
        self.shape, self.dtype = shape, dtype

    def __len__(self) -> int:
        return int(self._rows[-1]) + 1

    def read(self, index: int) -> NDArray[Any]:
        """Image `index` of the recording.

        Raises:
            InputError: this machine does not see the file.
        """
        place = int(np.searchsorted(self._rows, index))
        try:
            data = read_at(self._path, place * self.frame_bytes, self.frame_bytes)
        except InputError:
            raise InputError(
                f"{self._path.parent}: a worker sees no file there, and decoded images wait for it in one; write the "
                "volume into a folder that all machines share"
            ) from None
        return as_frame(self._path.name, index, data, self.shape, self.dtype)


@dataclass(frozen=True, eq=False)
class _Filled:
    """What a worker sends back."""

    piece_place: tuple[slice, slice, slice]
    values: NDArray[Any]
    counts: NDArray[np.uint16]
    filled: int


def fill_by(workers: Workforce, images: Crossing, into: Store, folder: Path, report: Report) -> int:
    """Fill the store; how many voxels were given something.

    Raises:
        InputError: decoded images cannot be kept in the folder, or a worker does not see them there.
    """
    boxes = list(boxes_of(images.grid, 1))
    filled = done = 0
    pending: set[Future[_Filled]] = set()
    with _seen_by_all(images, folder) as seen:
        try:
            while boxes or pending:
                while boxes and len(pending) < TASKS_A_WORKER * workers.count():
                    pending.add(workers.executor.submit(_fill, seen, boxes.pop(0)))
                ready, pending = wait(pending, return_when=FIRST_COMPLETED)
                for future in ready:
                    one = future.result()
                    into.put(one.piece_place, one.values, one.counts)
                    filled, done = filled + one.filled, done + 1
                report(done, done + len(boxes) + len(pending))
        finally:
            for future in pending:
                future.cancel()
    return filled


def crosses(images: Crossing, boxes: list[Any], start: int, stop: int) -> bool:
    """Whether one of the images start <= i < stop may reach a voxel of some boxes."""
    low = np.array([box[0] for box in boxes]).min(axis=0) - 2.0
    high = np.array([np.add(*box) for box in boxes]).max(axis=0) + 2.0
    # Between two images lies no more than the box around both.
    lows, highs = (corner[start:stop] for corner in images.boxes)
    return bool((highs.max(axis=0) >= low).all() and (lows.min(axis=0) <= high).all())


def _fill(images: Crossing, box: Any) -> _Filled:
    piece: Piece = new_piece(box, images.options)
    for start, stop in images.ranges():
        if crosses(images, [box], start, stop):
            piece.insert(images.batch(start, stop, np.stack(list(images.pixels(start, stop)))))
    values, counts = piece.settle(images.placed.dtype)
    filled = int(np.count_nonzero(counts))
    kept = np.minimum(counts, MOST_COUNTED) if images.options.coverage else counts[:0]
    return _Filled(piece.place, values, kept.astype(np.uint16), filled)


@contextmanager
def _seen_by_all(images: Crossing, folder: Path) -> Iterator[Crossing]:
    """The same images, decoded and averaged, in a file of a folder that all workers share."""
    placed = images.placed
    if isinstance(placed.frames, Repeated):
        yield images
        return
    try:
        handle, name = tempfile.mkstemp(".images", ".sonocal-", folder)
        try:
            with os.fdopen(handle, "wb") as file:
                for image in images.pixels(0, len(placed)):
                    file.write(np.ascontiguousarray(image).data)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise InputError(
            f"{folder}: decoded images cannot be kept there for the workers ({error.strerror}); make room, or write "
            "the volume elsewhere"
        ) from None
    stored = Stored(Path(name).resolve(), placed.rows, (placed.height, placed.width), placed.dtype)
    try:
        yield replace(
            images, placed=replace(placed, frames=stored), options=replace(images.options, speckle="kept")
        )
    finally:
        Path(name).unlink(missing_ok=True)
