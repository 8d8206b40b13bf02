"""What a recording shows near where a calibration puts its lines: for sweeps that make no calibration of their own."""

from __future__ import annotations

import numpy as np

from sonocal.calibration import Calibration, line_distances
from sonocal.detection import Detections
from sonocal.observations import Observations, group_codes
from sonocal.sweep.calibrate import Sweep

__all__ = ["sightings_near"]


def sightings_near(sweep: Sweep, detections: Detections, calibration: Calibration) -> Observations:
    """Of every image and line the candidate that lies nearest, as the calibration in doubt has it.

    Args:
        sweep: the recording and its lines.
        detections: what was found in its images.
        calibration: by which the nearest is told.

    Raises:
        NoConsensusError: nothing was found.
        InputError: nothing is in a frame with valid poses, or it is of other images.
    """
    table = sweep.candidates(detections)
    away = line_distances(calibration.probe_from_image, table)
    candidate = table.sightings if table.dimension == 3 else np.arange(len(table))
    furthest = np.zeros(int(candidate.max(initial=-1)) + 1)
    np.maximum.at(furthest, candidate, away)  # of a line in a volume the further of its ends
    sighting = group_codes(table.frame, table.target)
    order = np.lexsort((furthest[candidate], sighting))
    first = np.ones(len(order), dtype=bool)
    first[1:] = sighting[order][1:] != sighting[order][:-1]
    best = np.isin(candidate, candidate[order[first]])
    return table.select(np.flatnonzero(best))
