"""Where a volume is put, piece by piece: into memory, or into a file that appears under its name when it is whole."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError
from sonocal.reconstruction.files import mapped, of_file, volume_header
from sonocal.reconstruction.grid import Grid
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.placed import Placed
from sonocal.reconstruction.volume import Volume

__all__ = ["Store", "beside_volume", "in_file", "in_memory"]

Place = tuple[slice, slice, slice]
MOST_COUNTED = 65535
MOST_IN_MEMORY = 1 << 32


class Store:
    """Arrays [z, y, x] that pieces are put into.

    Args:
        values: of the voxels.
        coverage: values that each was given, where that is wanted.
        grid: where the voxels lie.
        placed: the images.
    """

    def __init__(
        self, values: NDArray[Any], coverage: NDArray[np.uint16] | None, grid: Grid, placed: Placed
    ) -> None:
        self.values, self.coverage = values, coverage
        self._grid, self._placed = grid, placed
        self.read: Callable[[], tuple[NDArray[Any], NDArray[np.uint16] | None]] = lambda: (values, coverage)
        self.written: Callable[[], None] = lambda: None

    def put(self, place: Place, values: NDArray[Any], counts: NDArray[Any]) -> None:
        """Put a piece where it belongs."""
        self.values[place] = values
        if self.coverage is not None:
            self.coverage[place] = np.minimum(counts, MOST_COUNTED)
        self.written()

    def volume(self, images: int, left_out: int, filled: int) -> Volume:
        """What was put in."""
        values, coverage = self.read()
        return Volume(
            values,
            self._grid,
            self._placed.reference,
            images,
            left_out,
            filled,
            coverage,
            source=self._placed.name,
        )


@contextmanager
def in_memory(grid: Grid, placed: Placed, options: Options) -> Iterator[Store]:
    """Arrays.

    Raises:
        InputError: the volume is too large for that.
    """
    if grid.voxels * placed.dtype.itemsize > MOST_IN_MEMORY:
        raise InputError(
            f"{placed.name}: a volume of {grid.voxels} voxels is written to a file and not kept in memory; name one "
            "with path, or give a larger spacing"
        )
    coverage = np.zeros(grid.shape, dtype=np.uint16) if options.coverage else None
    yield Store(np.zeros(grid.shape, dtype=placed.dtype), coverage, grid, placed)


def beside_volume(path: Path, what: str) -> Path:
    """Where a channel of a volume is written: ``volume-coverage.mha`` beside ``volume.mha``."""
    return path.with_name(f"{path.stem}-{what}{path.suffix}")


def in_file(path: Path) -> Callable[[Grid, Placed, Options], AbstractContextManager[Store]]:
    """The store of a file; its coverage stands in a file beside it.

    Raises:
        InputError: it has the name of no format that volumes are written in, or cannot be written.
    """

    @contextmanager
    def store(grid: Grid, placed: Placed, options: Options) -> Iterator[Store]:
        with ExitStack() as stack:
            header = volume_header(path, grid, placed.dtype, placed.reference, options.axes)
            values, flush = stack.enter_context(mapped(path, header, grid.shape, placed.dtype))
            coverage, second = None, beside_volume(path, "coverage")
            flushes = [flush]
            counts = np.dtype(np.uint16)
            head = volume_header(second, grid, counts, placed.reference, options.axes)
            if options.coverage:
                coverage, further = stack.enter_context(mapped(second, head, grid.shape, counts))
                flushes.append(further)
            into = Store(values, coverage, grid, placed)
            into.written = lambda: _each(flushes)
            into.read = lambda: (
                of_file(path, header, grid.shape, placed.dtype),
                of_file(second, head, grid.shape, counts) if options.coverage else None,
            )
            yield into
            del values, coverage
            into.values, into.coverage = np.empty(0), None  # the files are closed

    return store


def _each(calls: list[Callable[[], None]]) -> None:
    for call in calls:
        call()
