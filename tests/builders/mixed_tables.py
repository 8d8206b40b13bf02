"""Tables of sightings of points, lines and planes."""

from __future__ import annotations

from typing import Any

import numpy as np

from sonocal.geometry import Similarity
from sonocal.observations import Observations
from tests.builders.spanned_scenes import scene

KINDS_2D = ("point", "point on line", "line on plane")
KINDS_3D = ("point", "line", "plane")


def mixed_table(
    seed: int = 1, count: int = 12, *, flat: bool = True, **columns: Any
) -> tuple[Similarity, Observations]:
    """So many sightings of each kind that a 2D or 3D probe sees, each a target of its own."""
    truth, rows = scene(KINDS_2D if flat else KINDS_3D, count, seed, px=1.0, mm=0.3, flat=flat)
    of_row = np.repeat(np.arange(len(rows)), np.diff(rows.first))
    spanning = np.where(np.arange(3)[None, :, None] < rows.spans[:, None, None], rows.spanning, np.nan)
    table = Observations.of_targets(
        rows.points[:, : 2 if flat else 3],
        spanning[of_row],
        frame=of_row,
        target=np.array([f"target {sighting}" for sighting in of_row]),
        **columns,
    )
    return truth, table
