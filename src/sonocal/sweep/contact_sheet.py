"""A contact sheet: small images with what was found in them, as a PNG that needs no further package."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sonocal.detection import Detections, as_grey
from sonocal.errors import InputError, require
from sonocal.files.png import Pixels
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.recording import Recording
from sonocal.sweep.glyphs import written

__all__ = ["contact_sheet"]


COLUMNS = 4
TILE_PX = 320
DOTS_PX = 4
WALL_DOT_PX = 2
"""A wall is white, and a dot of one pixel is lost on it."""
OTHER, FIRST, CHOSEN = (255, 170, 0), (255, 230, 90), (60, 230, 90)
# By dimension, for each view: what is looked along (an axis of the array), and the image axes right and down.
VIEWS: dict[int, tuple[tuple[int | None, list[int]], ...]] = {
    2: ((None, [0, 1]),),
    3: ((0, [0, 1]), (2, [2, 1])),
}

# Words below, in the colours of what they name.
LEGEND = (("CHOSEN", CHOSEN), ("BEST", FIRST), ("OTHERS", OTHER))

BESIDE_PX = (5, 3)
"""From a wire's cross, right and down, to its number."""

Mark = tuple[Array, tuple[int, int, int], str]
"""Points (P, D) px, their colour, and the number that is written beside them."""


def contact_sheet(
    recording: Recording,
    detections: Detections | Sequence[Detections],
    chosen: Observations | None = None,
    tiles: int = 12,
) -> Pixels:
    """Images spread over a recording with detections marked: orange, yellow the best, green the chosen one.

    Each bears its frame's number, and a line below names the colours. Of several wires each chosen point bears its own
    number: 1 for the first of their names, and on. A volume shows as the brightest voxels seen from the front, along
    w, and from the side, along u, with its lines dotted. So are walls: from one of the points that were fitted to
    another.

    Args:
        recording: images.
        detections: of its images; of several kinds, each kind's.
        chosen: the rows that a calibration rests on; those of a line or plane one after the other.
        tiles: how many images.

    Returns:
        (rows, columns, 3) uint8.

    Raises:
        InputError: the recording has no images.
    """
    require("recording", recording, Recording)
    kinds = [detections] if isinstance(detections, Detections) else detections
    for one in kinds:
        require("detections", one, Detections)
    if len(recording.frames) == 0:
        raise InputError(f"{recording.name}: has no images to show")
    count = len(recording.frames)
    wanted = np.unique(np.linspace(0, count - 1, min(tiles, count)).astype(int)).tolist()
    pictures = [_tile(recording, _marks(kinds, chosen, i), i) for i in wanted]
    pictures += [np.zeros_like(pictures[0])] * (-len(pictures) % COLUMNS)
    rows = [np.hstack(pictures[i : i + COLUMNS]) for i in range(0, len(pictures), COLUMNS)]
    return np.asarray(np.vstack([*rows, _legend(rows[0].shape[1])]))


def _marks(kinds: Sequence[Detections], chosen: Observations | None, index: int) -> list[Mark]:
    """What to mark in an image, the best last."""
    marks: list[Mark] = []
    for detections in kinds:
        here = np.flatnonzero(detections.frame == index)
        here = here[np.argsort(-detections.rank[here], kind="stable")]
        marks += [
            (detections.points_px[row], FIRST if detections.rank[row] == 0 else OTHER, "") for row in here
        ]
    if chosen is not None:
        here = np.flatnonzero(chosen.frame == index)
        sightings, numbers = chosen.sightings[here], _numbers(chosen)[here]
        marks += [
            (chosen.points_px[here[sightings == one]], CHOSEN, str(numbers[sightings == one][0]))
            for one in dict.fromkeys(sightings.tolist())
        ]
    return marks


def _numbers(chosen: Observations) -> NDArray[np.str_]:
    """(N,): of each row's wire, where they are several."""
    names, wire = np.unique(chosen.target, return_inverse=True)
    return np.array([str(one + 1) if len(names) > 1 else "" for one in wire], dtype=np.str_)


def _tile(recording: Recording, marks: list[Mark], index: int) -> Pixels:
    """An image, or a volume's views side by side, with its marks."""
    assert recording.image is not None  # it has images
    dimension = recording.image.dimension
    grey = as_grey(recording.frames[index], dimension, f"{recording.name}, frame {index}")
    step = max(grey.shape) * len(VIEWS[dimension]) / TILE_PX
    views = [_view(grey, marks, step, along, axes) for along, axes in VIEWS[dimension]]
    height = max(view.shape[0] for view in views)
    tile = np.hstack([np.pad(view, ((0, height - view.shape[0]), (0, 0), (0, 0))) for view in views])
    _number(tile, index)
    return tile


def _number(tile: Pixels, index: int) -> None:
    """The frame's number at the lower left, white on black; an image too small for it goes without."""
    mask = written(str(index))
    height, width = mask.shape
    if 2 * height <= tile.shape[0] and width <= tile.shape[1]:
        tile[-1 - height : -1, :width] = 255 * mask[:, :, None]


def _legend(width: int) -> Pixels:
    """A strip that names the colours; as many as there is room for."""
    words = [(written(word), colour) for word, colour in LEGEND]
    strip = np.zeros((words[0][0].shape[0], width, 3), dtype=np.uint8)
    left = 0
    for mask, colour in words:
        if left + mask.shape[1] <= width:
            strip[:, left : left + mask.shape[1]][mask] = colour
        left += 2 * mask.shape[0] + mask.shape[1]
    return strip


def _beside(view: Pixels, place: Array, number: str, colour: tuple[int, int, int]) -> None:
    """A wire's number right below its cross, or left above where that is out of the picture."""
    ink = written(number)
    corner = np.rint(place).astype(int) + BESIDE_PX
    over = corner + ink.shape[::-1] > (view.shape[1], view.shape[0])
    corner = np.where(over, np.rint(place).astype(int) - BESIDE_PX - ink.shape[::-1], corner)
    if (corner >= 0).all():
        part = view[corner[1] : corner[1] + ink.shape[0], corner[0] : corner[0] + ink.shape[1]]
        part[ink[: part.shape[0], : part.shape[1]]] = colour


def _view(
    grey: NDArray[np.float32], marks: list[Mark], step: float, along: int | None, axes: list[int]
) -> Pixels:
    flat = grey if along is None else grey.max(axis=along)
    view = _small(flat.T if axes == [2, 1] else flat, step)
    for points, colour, number in marks:
        place = points[:, axes] / step
        if len(place) == 1:
            _cross(view, place[0], colour)
        if len(place) == 1 and number:
            _beside(view, place[0], number, colour)
        for i in range(len(place) if len(place) > 2 else len(place) - 1):
            size = 1 if along is not None and len(place) == 2 else WALL_DOT_PX
            _dots(view, place[[i, (i + 1) % len(place)]], colour, size)
    view[-1], view[:, -1] = 60, 60
    return view


def _small(grey: NDArray[np.float32], step: float) -> Pixels:
    """Every so many pixels of an image, in colour."""
    v, u = (np.arange(max(1, int(n / step))) * step for n in grey.shape)
    levels = grey.clip(0, 255).astype(np.uint8)
    return np.repeat(levels[v.astype(int)[:, None], u.astype(int), None], 3, axis=2)


def _dots(tile: Pixels, ends: Array, colour: tuple[int, int, int], size: int) -> None:
    """A line of dots, between which what they lie on stays visible."""
    count = max(2, int(np.linalg.norm(ends[1] - ends[0]) / DOTS_PX))
    for u, v in np.rint(ends[0] + np.linspace(0, 1, count)[:, None] * (ends[1] - ends[0])).astype(int):
        if 0 <= v < tile.shape[0] and 0 <= u < tile.shape[1]:
            tile[v : v + size, u : u + size] = colour


def _cross(tile: Pixels, place: Array, colour: tuple[int, int, int]) -> None:
    """Four strokes around a place, which itself stays visible."""
    u, v = (round(float(x)) for x in place)
    for reach in range(4, 9):
        for du, dv in ((reach, 0), (-reach, 0), (0, reach), (0, -reach)):
            if 0 <= v + dv < tile.shape[0] and 0 <= u + du < tile.shape[1]:
                tile[v + dv, u + du] = colour
