"""What the thickness of a 2D image's slice does: dots of wires aslant to it, and how sure a calibration is."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sonocal.calibration import Calibration, point_line_rows
from sonocal.calibration.few_targets import ENOUGH_TARGETS
from sonocal.calibration.widened import widened
from sonocal.errors import DegenerateGeometryError, InputError, NoConsensusError
from sonocal.geometry import AxisScaled
from sonocal.observations import Observations
from sonocal.registration.mapped import MappedRows
from sonocal.registration.off_plane import off_plane_noise
from sonocal.sweep.candidates import Candidates, Mask

__all__ = ["ASLANT", "calibrated_across", "with_slice_noise"]

ASLANT = "a wire nearly along the image"
"""Why a sighting is left out."""
LEAST_MET_DEG = 30.0
"""A wire that meets the image at less leaves a streak of centimetres, in pieces. Of these the one that is nearest to
where the wire is expected is taken: a fit that is off finds itself confirmed."""
LEAST_LEFT = 0.5
"""Of the sightings: where fewer would be left, how the wires are held is no exception."""
MOST_LOOSER = 1.5
"""Times the predicted error: where it grows by more, those left out are needed."""
LEAST_SCORE = 2.0
"""Standard deviations: one in some twenty sound recordings reaches it, and is widened by a per cent."""


def calibrated_across(
    table: Candidates, chosen: Mask, transform: AxisScaled, calibrate: Callable[[Observations], Calibration]
) -> tuple[Calibration, Mask]:
    """The calibration of the chosen rows, of four wires or more in 2D images without those nearly along the image.

    Args:
        table: the candidates.
        chosen: (N,): the rows that agree.
        transform: with which.
        calibrate: rows to a calibration.

    Returns:
        The calibration, and the rows that it was fitted to.
    """
    every = calibrate(table.at(chosen))
    of_wires = table.may_be_of_any and table.rows.dimension == 2
    rest = chosen & ~_along_image(table.rows, transform) if of_wires else chosen
    if np.array_equal(rest, chosen) or not _enough(table, rest, chosen):
        return every, chosen
    try:
        across = calibrate(table.at(rest))
    except (DegenerateGeometryError, InputError, NoConsensusError):
        return every, chosen
    if _looser(across, every):
        return every, chosen
    return across, rest


def _enough(table: Candidates, rest: Mask, chosen: Mask) -> bool:
    wires = len(np.unique(table.rows.target[rest]))
    return wires >= ENOUGH_TARGETS and table.agreeing(rest) >= LEAST_LEFT * table.agreeing(chosen)


def _along_image(rows: Observations, transform: AxisScaled) -> Mask:
    along = rows.segments_mm[:, 1] - rows.segments_mm[:, 0]
    sine = np.abs(along @ transform.rotation[:, 2]) / np.linalg.norm(along, axis=1)
    return np.asarray(sine < np.sin(np.radians(LEAST_MET_DEG)))


def _looser(across: Calibration, every: Calibration) -> bool:
    if across.covariance is None or every.covariance is None:
        return across.covariance is not every.covariance
    return bool(across.predicted_errors()[2].max() > MOST_LOOSER * every.predicted_errors()[2].max())


def with_slice_noise(calibration: Calibration, rows: Observations) -> Calibration:
    """The calibration, as much wider as noise across the slice makes it, where its residuals show such.

    A dot of a wire that leans out of the slice's normal lies somewhere along the streak that the slice sees of it: its
    noise is that of the image along its normal, which in-plane noise of any size does not describe.

    Args:
        calibration: of the rows.
        rows: as it was fitted to them.
    """
    if calibration.covariance is None or rows.dimension == 3:
        return calibration
    noise = calibration.noise
    found = off_plane_noise(
        MappedRows(calibration.probe_from_image, point_line_rows(rows)),
        calibration.inlier,
        (noise.sigma_px or 0.0, noise.sigma_mm or 0.0),
        len(calibration.covariance),
    )
    if found is None or found.score < LEAST_SCORE:
        return calibration
    return widened(calibration, calibration.covariance + found.covariance, rows)
