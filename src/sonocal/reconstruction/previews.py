"""Cuts through a volume and its projection, laid out as radiologists look at them.

Head up, the patient's left on the right, and from the side the face on the left; what is left and what is front is said
by how the axes are read, as in `files`.
"""

from __future__ import annotations

import mmap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import InputError, require
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.reconstruction.files import SIGNS, Axes
from sonocal.reconstruction.grid import Grid
from sonocal.reconstruction.volume import Volume

__all__ = ["Picture", "picture_of", "preview"]

NAMES = "xyz"
TOWARDS = {"lps": "LPS", "ras": "RAS"}
OPPOSITE = {"L": "R", "R": "L", "P": "A", "A": "P", "S": "I"}
LAID_OUT = {2: (0, 1, +1), 1: (0, 2, -1), 0: (1, 2, -1)}
"""By the axis that is looked along, of left, posterior, superior: which runs right, which runs down, or (-1) up."""
RELEASED_BYTES = 64 << 20
"""Of a file that is gone through: what was looked at is given back so often."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A cut through a volume, or what is brightest along an axis.

    Attributes:
        image: (rows, columns), of the volume's grey levels.
        along: the axis that is looked along: "x", "y" or "z".
        at_mm: where it is cut; None of a projection.
        across, upright: the axes of a row and of a column.
        edges_mm: (4,): left, right, bottom and top edge, along those axes.
        letters: what lies to the left, right, bottom and top of a patient: "R", "L", "P", "A", and so on.
    """

    image: NDArray[Any]
    along: str
    at_mm: float | None
    across: str
    upright: str
    edges_mm: Array
    letters: str

    __repr__ = brief


def preview(volume: Volume, axes: Axes = "lps") -> tuple[Picture, ...]:
    """Cuts at right angles to z, y and x, in the middle of what is filled, and the projection along the shortest side.

    A volume in a file is gone through layer by layer and never whole in memory.

    Args:
        volume: such as `reconstruct` returns.
        axes: how its frame's axes are read: "lps" or "ras".

    Raises:
        InputError: axes are neither.
    """
    require("volume", volume, Volume)
    if axes not in SIGNS:
        raise InputError(f"axes must be lps or ras; got {axes!r}"[:200])
    grid = volume.grid
    shortest = int(np.argmin(grid.spacing_mm * grid.size))
    x, y, z = grid.size
    counts = [np.zeros(n, dtype=np.int64) for n in (x, y, z)]
    brightest: Any = []
    for k, layer in _layers(volume.values):
        there = layer > 0
        counts[0] += np.count_nonzero(there, axis=0)
        counts[1] += np.count_nonzero(there, axis=1)
        counts[2][k] = np.count_nonzero(there)
        if shortest == 2:
            brightest = layer.copy() if k == 0 else np.maximum(brightest, layer)
        else:
            brightest.append(layer.max(axis=1 - shortest))
    i, j, k = (_middle(count) for count in counts)
    from_side = [(layer[:, i].copy(), layer[j].copy()) for _, layer in _layers(volume.values)]
    cuts = [
        (2, k, volume.values[k]),
        (1, j, [row for _, row in from_side]),
        (0, i, [col for col, _ in from_side]),
    ]
    places = grid.origin_mm + grid.spacing_mm * (i, j, k)
    pictures = [
        picture_of(np.asarray(cut), grid, along, float(places[along]), axes) for along, _, cut in cuts
    ]
    return (*pictures, picture_of(np.asarray(brightest), grid, shortest, None, axes))


def picture_of(cut: NDArray[Any], grid: Grid, along: int, at_mm: float | None, axes: Axes) -> Picture:
    """A picture of an array of voxels, of which the later axis is across.

    Args:
        cut: as `values[k]`, `values[:, j]` or `values[:, :, i]` of a volume's.
        grid: of the volume.
        along: 2, 1 or 0: the axis that was cut at right angles.
        at_mm: where; None of a projection.
        axes: how the frame's axes are read.
    """
    across, upright, down = LAID_OUT[along]
    low = grid.origin_mm - grid.spacing_mm / 2
    high = low + grid.spacing_mm * grid.size
    edges, letters, image = [], "", np.array(cut)
    for axis, runs, side in ((across, +1, 1), (upright, -down, 0)):
        # From left to right and from bottom to top; the image's rows are drawn from the top.
        forward = runs * SIGNS[axes][axis] > 0
        edges += [low[axis], high[axis]] if forward else [high[axis], low[axis]]
        towards = TOWARDS[axes][axis]
        letters += f"{OPPOSITE[towards]}{towards}" if forward else f"{towards}{OPPOSITE[towards]}"
        if forward == (side == 0):
            image = np.flip(image, axis=side)
    return Picture(
        np.ascontiguousarray(image),
        NAMES[along],
        at_mm,
        NAMES[across],
        NAMES[upright],
        np.array(edges),
        letters,
    )


def _middle(counts: NDArray[np.int64]) -> int:
    """Where as many filled voxels are before as behind."""
    return int(np.searchsorted(np.cumsum(counts), counts.sum() / 2))


def _layers(values: NDArray[Any]) -> Iterator[tuple[int, NDArray[Any]]]:
    """The layers [y, x] of an array; of one in a file pages are given back as it is gone through."""
    pages, seen = values.base, 0
    for k, layer in enumerate(values):
        yield k, np.asarray(layer)
        seen += layer.nbytes
        if seen > RELEASED_BYTES and isinstance(pages, mmap.mmap) and hasattr(pages, "madvise"):
            pages.madvise(mmap.MADV_DONTNEED)
            seen = 0
