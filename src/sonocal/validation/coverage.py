"""Where in the image and under which tilts the needle was seen, and what to scan next."""

from __future__ import annotations

from typing import Any

import numpy as np

from sonocal.calibration import Calibration, line_distances
from sonocal.geometry import Array, segment_directions
from sonocal.observations import Observations

__all__ = ["coverage_of"]

CELLS = 3
FEW_SHARE = 0.25
"""Of what a ninth of the image would have were all alike: fewer sightings are few."""
LEAST_TILT_DEG = 30.0
MOST_SENTENCES = 4
MOST_TILTS = 400
ROWS, COLUMNS = ("upper", "middle", "lower"), ("left", "centre", "right")


def coverage_of(found: Calibration, rows: Observations) -> dict[str, Any]:
    """Sightings in ninths of the area, tilts of the needle from the image's normal, and what to scan next.

    Args:
        found: the calibration.
        rows: that it was fitted to; lines alone.
    """
    agree = line_distances(found.probe_from_image, rows) <= found.threshold_mm
    some = rows.select(agree) if agree.any() else rows
    cells = _cells(found, some)
    tilt, around = _tilts(found, some)
    index = np.unique(np.linspace(0, len(tilt) - 1, min(len(tilt), MOST_TILTS)).astype(int))
    return {
        "cells": cells.tolist(),
        "tilt_deg": np.round(tilt[index], 1).tolist(),
        "around_deg": np.round(around[index], 1).tolist(),
        "next": [*_where(cells, found), *_which_way(tilt, around)][:MOST_SENTENCES],
    }


def _cells(found: Calibration, rows: Observations) -> Array:
    """(3, 3): sightings in each ninth, row by row of the image."""
    low, high = found.area_px[:, :2]
    share = (rows.points_px[:, :2] - low) / np.maximum(high - low, 1e-9)
    column, row = np.clip((share * CELLS).astype(int), 0, CELLS - 1).T
    counts = np.zeros((CELLS, CELLS), dtype=int)
    np.add.at(counts, (row, column), 1)
    return counts


def _tilts(found: Calibration, rows: Observations) -> tuple[Array, Array]:
    """Angles from the image's normal and about it (from +u to +v), degrees."""
    along = segment_directions(rows.segments_mm) @ found.probe_from_image.rotation
    along *= np.where(along[:, 2:] < 0, -1.0, 1.0)
    tilt = np.degrees(np.arccos(np.clip(along[:, 2], 0, 1)))
    return tilt, np.degrees(np.arctan2(along[:, 1], along[:, 0]))


def _where(cells: Array, found: Calibration) -> list[str]:
    """The emptiest corners: errors grow towards what was not seen."""
    usual = cells.sum() / CELLS**2
    few = [
        (int(cells[row, column]), row, column)
        for row in (0, 2)
        for column in (0, 2)
        if cells[row, column] < FEW_SHARE * usual
    ]
    name = "image" if found.area_is_image else "area seen"
    return [
        f"Hold the needle in the {ROWS[row]} {COLUMNS[column]} part of the {name}: "
        f"{count or 'no'} sighting{'s are' if count != 1 else ' is'} there."
        for count, row, column in sorted(few)[:2]
    ]


def _which_way(tilt: Array, around: Array) -> list[str]:
    """Tilts that are missing: a rotation about an axis is held by needles that lean across it."""
    sector = np.round(around / 90).astype(int) % 4
    widest = [float(np.quantile(tilt[sector == i], 0.9)) if (sector == i).any() else 0.0 for i in range(4)]
    pairs = [max(widest[0], widest[2]), max(widest[1], widest[3])]
    names = ("to the left and right", "to the top and bottom")
    return [
        f"Lean the needle {name} of the image by {LEAST_TILT_DEG:.0f} degrees or more: so far it leans by "
        f"{reached:.0f} at the most."
        for name, reached in zip(names, pairs, strict=True)
        if reached < LEAST_TILT_DEG
    ]
