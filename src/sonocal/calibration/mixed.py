"""A table of points, lines and planes as registration takes it."""

from __future__ import annotations

import numpy as np

from sonocal.calibration.options import Options
from sonocal.calibration.rows import point_line_rows, require_placed
from sonocal.errors import InputError, UnsupportedError
from sonocal.geometry import Array, AxisScaled, homogeneous_points
from sonocal.observations import Observations, group_codes
from sonocal.registration.mapped import Mapped, mapped_rows
from sonocal.registration.noise import residual_vectors
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = ["check_mixed", "mapped_of", "table_of", "target_distances", "target_vectors"]


def table_of(observations: Observations) -> PointLineRows | TargetRows:
    """A table as registration takes it: points and lines, or whatever targets."""
    if observations.lines_only:
        return point_line_rows(observations)
    require_placed(observations)
    spanning = observations.spanning_mm
    assert spanning is not None
    return TargetRows(
        points=np.ascontiguousarray(homogeneous_points(observations.points_px)),
        spanning_mm=np.where(np.isnan(spanning), spanning[:, :1], spanning),
        spans=observations.spans,
        dimension=observations.dimension,
        sightings=observations.sightings.astype(np.int32),
        frame=group_codes(observations.split, observations.frame).astype(np.int32),
        target=group_codes(observations.target).astype(np.int32),
        sigma_px=observations.sigma_px,
        sigma_mm=observations.sigma_mm,
    )


def mapped_of(probe_from_image: AxisScaled, rows: Observations) -> Mapped:
    """The rows of a table under a calibration."""
    return mapped_rows(probe_from_image, table_of(rows))


def target_vectors(probe_from_image: AxisScaled, rows: Observations) -> Array:
    """(N, 3), mm: from each point, line or plane to its mapped point; of any matrix, as others make them."""
    if rows.lines_only:
        return residual_vectors(probe_from_image, homogeneous_points(rows.points_px), rows.segments_mm)
    return mapped_of(probe_from_image, rows).residuals


def target_distances(probe_from_image: AxisScaled, rows: Observations) -> Array:
    """(N,), mm: of each mapped point from its point, line or plane."""
    return np.asarray(np.linalg.norm(target_vectors(probe_from_image, rows), axis=1))


def check_mixed(rows: Observations, options: Options) -> None:
    """Refuse what points and planes cannot have.

    Raises:
        InputError: there is no row, or rows of one sighting differ in their target.
        UnsupportedError: a threshold from the noise.
    """
    if not len(rows):
        raise InputError(f"{rows.source}: has no row to fit; see ten sightings or more, of several targets")
    if options.threshold_mm == "auto":
        raise UnsupportedError(
            f"{rows.source}: holds points or planes, and these need a threshold in mm; give one"
        )
    assert rows.spanning_mm is not None
    order = np.argsort(rows.sightings, kind="stable")
    spanning, sighting = np.nan_to_num(rows.spanning_mm[order]), rows.sightings[order]
    wrong = (sighting[1:] == sighting[:-1]) & np.any(spanning[1:] != spanning[:-1], axis=(1, 2))
    if wrong.any():
        first, second = order[np.argmax(wrong) + np.arange(2)]
        raise InputError(
            f"{rows.where(int(second))}: has another target than {rows.where(int(first))} of the same frame and "
            "target; points of one sighting share what they lie on, other targets need another name"
        )
