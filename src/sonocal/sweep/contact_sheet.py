"""A contact sheet: small images with what was found in them, as a PNG that needs no further package."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.detection import Candidates, LineCandidates, as_grey
from sonocal.errors import InputError
from sonocal.files.png import Pixels
from sonocal.geometry import Array
from sonocal.recording import Recording

__all__ = [
    "contact_sheet",
]


COLUMNS = 4
TILE_PX = 320
DOTS_PX = 4
OTHER, FIRST, CHOSEN = (255, 170, 0), (255, 230, 90), (60, 230, 90)


def contact_sheet(
    recording: Recording,
    candidates: Candidates | LineCandidates,
    chosen: tuple[NDArray[np.int64], Array] | None = None,
    tiles: int = 12,
) -> Pixels:
    """Images spread over a recording with candidates marked: orange, yellow the best, green the chosen one.

    A volume shows as the brightest voxels seen from the front, along w, and from the side, along u, with its lines
    dotted.

    Args:
        recording: images.
        candidates: of its images.
        chosen: frames (M,) and points (M, 2) px that a calibration rests on; in volumes points (M, 3), two of each
            line one after the other.
        tiles: how many images.

    Returns:
        (rows, columns, 3) uint8.

    Raises:
        InputError: the recording has no images.
    """
    if len(recording.frames) == 0:
        raise InputError(f"{recording.name}: has no images to show")
    wanted = np.unique(
        np.linspace(0, len(recording.frames) - 1, min(tiles, len(recording.frames))).astype(int)
    )
    pictures = [
        _views(recording, candidates, chosen, int(i))
        if isinstance(candidates, LineCandidates)
        else _tile(recording, candidates, chosen, int(i))
        for i in wanted
    ]
    pictures += [np.zeros_like(pictures[0])] * (-len(pictures) % COLUMNS)
    rows = [np.hstack(pictures[i : i + COLUMNS]) for i in range(0, len(pictures), COLUMNS)]
    return np.asarray(np.vstack(rows))


def _tile(
    recording: Recording, candidates: Candidates, chosen: tuple[NDArray[np.int64], Array] | None, index: int
) -> Pixels:
    grey = as_grey(recording.frames[index], 2, f"{recording.name}, frame {index}")
    step = max(grey.shape) / TILE_PX
    tile = _small(grey, step)
    here = np.flatnonzero(candidates.frame == index)
    for rank, row in reversed(list(enumerate(here))):
        _cross(tile, candidates.points_px[row] / step, FIRST if rank == 0 else OTHER)
    if chosen is not None:
        for row in np.flatnonzero(chosen[0] == index):
            _cross(tile, chosen[1][row] / step, CHOSEN)
    tile[-1], tile[:, -1] = 60, 60
    return tile


def _views(
    recording: Recording,
    candidates: LineCandidates,
    chosen: tuple[NDArray[np.int64], Array] | None,
    index: int,
) -> Pixels:
    grey = as_grey(recording.frames[index], 3, f"{recording.name}, frame {index}")
    step = max(grey.shape) / (TILE_PX // 2)
    views = []
    # (axis that is looked along, image axes right and down)
    for along, axes in ((0, [0, 1]), (2, [2, 1])):
        flat = grey.max(axis=along)
        view = _small(flat if along == 0 else flat.T, step)
        for row in np.flatnonzero(candidates.frame == index)[::-1]:
            colour = FIRST if candidates.rank[row] == 0 else OTHER
            _dots(view, candidates.lines[row].ends_px[:, axes] / step, colour)
        if chosen is not None:
            for ends in chosen[1][chosen[0] == index].reshape(-1, 2, 3):
                _dots(view, ends[:, axes] / step, CHOSEN)
        view[-1], view[:, -1] = 60, 60
        views.append(view)
    return np.hstack(
        [np.pad(v, ((0, max(x.shape[0] for x in views) - v.shape[0]), (0, 0), (0, 0))) for v in views]
    )


def _small(grey: NDArray[np.float32], step: float) -> Pixels:
    """Every so many pixels of an image, in colour."""
    v, u = (np.arange(max(1, int(n / step))) * step for n in grey.shape)
    levels = grey.clip(0, 255).astype(np.uint8)
    return np.repeat(levels[v.astype(int)[:, None], u.astype(int), None], 3, axis=2)


def _dots(tile: Pixels, ends: Array, colour: tuple[int, int, int]) -> None:
    """A line of dots, between which what they lie on stays visible."""
    count = max(2, int(np.linalg.norm(ends[1] - ends[0]) / DOTS_PX))
    for u, v in np.rint(ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0])).astype(int):
        if 0 <= v < tile.shape[0] and 0 <= u < tile.shape[1]:
            tile[v, u] = colour


def _cross(tile: Pixels, place: Array, colour: tuple[int, int, int]) -> None:
    """Four strokes around a place, which itself stays visible."""
    u, v = (round(float(x)) for x in place)
    for reach in range(4, 9):
        for du, dv in ((reach, 0), (-reach, 0), (0, reach), (0, -reach)):
            if 0 <= v + dv < tile.shape[0] and 0 <= u + du < tile.shape[1]:
                tile[v + dv, u + du] = colour
