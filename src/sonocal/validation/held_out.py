"""Errors of rows that were not fitted: held out by the user, or one frame or one target at a time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, line_distances, point_line_rows
from sonocal.calibration.held_out import independent_units
from sonocal.errors import DegenerateGeometryError, InputError, UnsupportedError, require
from sonocal.geometry import Array, AxisScaled
from sonocal.observations import Observations, group_codes
from sonocal.registration.degeneracy import FREE_INFORMATION, refuse_degenerate_lines
from sonocal.registration.options import Options, Weighting, unknowns
from sonocal.registration.refine import refine_point_lines
from sonocal.validation.quantity import Quantity, rms_quantity

__all__ = [
    "held_out",
    "leave_one_frame_out",
    "leave_one_target_out",
    "refitted",
]

# Every frame left out costs a fit; this many give the number to a few per cent.
MOST_FOLDS = 200


def held_out(calibration: Calibration, observations: Observations) -> Quantity:
    """Distance of mapped points to lines that were not fitted, root mean square over all rows.

    The true value that the interval is about: the same over endless sightings of the same kind, for this
    calibration.
    """
    require("calibration", calibration, Calibration)
    require("observations", observations, Observations)
    return rms_quantity(
        "held-out",
        "Held-out rows",
        "distance of a mapped image point to its line, rms over rows that were not fitted, outliers included",
        line_distances(calibration.probe_from_image, observations),
        independent_units(calibration.probe_from_image, observations),
    )


def leave_one_frame_out(calibration: Calibration, fitted: Observations) -> Quantity:
    """Error at a frame of the calibration fitted to all the others; see `leave_one_target_out`.

    Args:
        calibration: gives the model and the start.
        fitted: the rows to fit and to leave out, without the outliers.
    """
    frame = group_codes(fitted.split, fitted.frame)
    left_out = np.unique(frame)
    if len(left_out) > MOST_FOLDS:
        left_out = left_out[np.linspace(0, len(left_out) - 1, MOST_FOLDS).astype(int)]
    errors, rows = _folds(calibration, fitted, [frame == f for f in left_out])
    groups = independent_units(calibration.probe_from_image, fitted)
    return rms_quantity(
        "leave-one-frame-out",
        "Leave one frame out",
        "distance of a frame's mapped points to their lines under the calibration fitted to all other frames, rms",
        errors,
        groups[rows],
    )


def leave_one_target_out(calibration: Calibration, fitted: Observations) -> Quantity:
    """Error at a needle or wire of the calibration fitted to all the others.

    The true value that the interval is about: the rms distance of these calibrations, each missing one
    target, over endless sightings of new targets.

    Raises:
        UnsupportedError: there are fewer than three targets.
        DegenerateGeometryError: without one of them a motion is free.
    """
    target = group_codes(fitted.target)
    names = np.unique(target)
    if len(names) < 3:
        raise UnsupportedError(
            f"{fitted.source}: has {len(names)} target{'s' * (len(names) != 1)} and leaving one out needs three or "
            "more; name needles or wires apart in the column target"
        )
    errors, rows = _folds(calibration, fitted, [target == name for name in names])
    return rms_quantity(
        "leave-one-target-out",
        "Leave one needle or wire out",
        "distance of a target's mapped points to its line under the calibration fitted to all other targets, rms",
        errors,
        target[rows],
        unit="targets",
    )


def refitted(calibration: Calibration, rows: Observations, keep: NDArray[np.bool_]) -> AxisScaled:
    """The calibration of some of its rows, from where it stands.

    Raises:
        InputError: fewer rows are left than there are unknowns.
        DegenerateGeometryError: they leave a motion free.
    """
    if 2 * np.count_nonzero(keep) < unknowns(calibration.model, calibration.dimension):
        raise InputError(f"{rows.source}: {np.count_nonzero(keep)} rows are left, too few to fit")
    table = point_line_rows(rows)
    refuse_degenerate_lines(table, keep)
    weighting: Weighting = "geometric" if calibration.noise.sigma_px is None else "likelihood"
    told = float(calibration.probe_from_image.scales[0]) if calibration.model == "rigid" else None
    options = Options(model=calibration.model, weighting=weighting, scale_mm_per_px=told)
    fit = refine_point_lines(calibration.probe_from_image, table, keep, options)
    if not fit.least_information > FREE_INFORMATION:
        raise DegenerateGeometryError(
            f"{rows.source}: the {np.count_nonzero(keep)} rows that are left leave a motion of the image free; "
            "scan more tilts and places",
            code="free-motion",
        )
    return fit.transform


def _folds(
    calibration: Calibration, rows: Observations, left_out: list[NDArray[np.bool_]]
) -> tuple[Array, NDArray[np.int64]]:
    """Errors of the rows left out, fold after fold, and which rows they are."""
    errors = [line_distances(refitted(calibration, rows, ~mask), rows.select(mask)) for mask in left_out]
    return np.concatenate(errors), np.concatenate([np.flatnonzero(mask) for mask in left_out])
