"""The transform alone, from a table of sightings: for whoever asks again and again, and needs no statistics."""

from __future__ import annotations

from typing import NamedTuple

from sonocal.calibration.mixed import check_mixed, table_of
from sonocal.calibration.options import Options
from sonocal.calibration.rows import check_rows
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.registration.best_fit import best_fit
from sonocal.registration.fit import Fit
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = ["FittedRows", "fit_rows"]


class FittedRows(NamedTuple):
    """A fit and what it was fitted to.

    Attributes:
        table: the rows as registration takes them.
        fit: the transform that they agree with, and which of them do.
        mirrored: the other answer that a 2D image of nearly parallel lines has, or None.
    """

    table: PointLineRows | TargetRows
    fit: Fit
    mirrored: Fit | None

    def __repr__(self) -> str:
        return brief(self)


def fit_rows(rows: Observations, options: Options) -> FittedRows:
    """Fit all rows of a table: the transform that `calibrate` gives, without its covariance and its findings.

    Args:
        rows: the sightings to fit; the options' splits are not looked at.
        options: how to fit.

    Raises:
        InputError: rows are too few, or 3D sightings are no lines.
        DegenerateGeometryError: the sightings leave a motion free.
        NoConsensusError: no calibration agrees with enough rows.
        UnsupportedError: what points and planes cannot have.
    """
    if rows.lines_only:
        check_rows(rows, options.model)
    else:
        check_mixed(rows, options)
    table = table_of(rows)
    return FittedRows(table, *best_fit(table, options))
