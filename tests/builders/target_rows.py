"""Rows of any mix, from sightings or from rows on lines."""

from __future__ import annotations

import numpy as np

from sonocal.calibration.mixed import table_of
from sonocal.observations import Observations
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows


def as_targets(rows: PointLineRows) -> TargetRows:
    """Rows on lines, as rows of a mix that happens to have nothing else."""
    count = len(rows)
    sightings = np.arange(count) if rows.sightings is None else rows.sightings
    codes = [np.zeros(count) if one is None else one for one in (rows.frame, rows.target)]
    return TargetRows(
        points=rows.points,
        spanning_mm=np.concatenate([rows.segments_mm, rows.segments_mm[:, :1]], axis=1),
        spans=np.full(count, 2, dtype=np.int32),
        dimension=rows.dimension,
        sightings=sightings.astype(np.int32),
        frame=codes[0].astype(np.int32),
        target=codes[1].astype(np.int32),
        sigma_px=rows.sigma_px,
        sigma_mm=rows.sigma_mm,
    )


def of_observations(observations: Observations) -> TargetRows:
    """Rows of a table with points or planes."""
    rows = table_of(observations)
    assert isinstance(rows, TargetRows)
    return rows
