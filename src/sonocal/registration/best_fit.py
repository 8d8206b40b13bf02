"""The fit of rows of either form: what leaves a motion free is refused, and of mirrored answers the better is taken."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sonocal.errors import DegenerateGeometryError, NoConsensusError
from sonocal.geometry import AxisScaled
from sonocal.registration.ambiguity import better_of_mirrored
from sonocal.registration.degeneracy import (
    SUSPICIOUS_INFORMATION,
    refuse_degenerate_lines,
    refuse_free_motion,
)
from sonocal.registration.fit import Fit
from sonocal.registration.fit_targets import fit_targets, refine_targets
from sonocal.registration.mirrored import refuse_mirrored_volume
from sonocal.registration.near_degeneracy import (
    near_degeneracy,
    nearly_degenerate,
    refuse_nearly_degenerate,
)
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.robust import MINIMAL_ROWS, fit_point_lines
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows

__all__ = ["best_fit", "consensus_fit", "refined_fit"]


def consensus_fit(rows: PointLineRows | TargetRows, options: Options) -> Fit:
    """What most rows agree with: `fit_point_lines`, or `fit_targets` without the weights that take most of its time."""
    if isinstance(rows, TargetRows):
        return fit_targets(
            rows,
            Options(
                threshold_mm=options.threshold_mm, max_samples=options.max_samples, weighting="geometric"
            ),
        )
    return fit_point_lines(rows, options)


def refined_fit(
    start: AxisScaled, rows: PointLineRows | TargetRows, chosen: NDArray[np.bool_], options: Options
) -> Fit:
    """The best transform near a start on chosen rows (N,): `refine_point_lines` or `refine_targets`."""
    if isinstance(rows, TargetRows):
        return refine_targets(start, rows, chosen, options)
    return refine_point_lines(start, rows, chosen, options)


def best_fit(rows: PointLineRows | TargetRows, options: Options) -> tuple[Fit, Fit | None]:
    """The best transform that the rows agree with, and its mirrored answer; None where there is no other.

    Args:
        rows: points and lines, or whatever targets.
        options: how to fit.

    Raises:
        InputError: as of `fit_targets`, of such.
        DegenerateGeometryError: the rows, or those that agree, leave a motion free.
        NoConsensusError: no transform agrees with enough rows.
        MirroredVolumeError: one does when an axis of the volume is turned round.

    Source: paper sections 6 to 9.
    """
    if isinstance(rows, TargetRows):
        return _fit_targets(rows, options), None
    try:
        return _best_fit(rows, options)
    except (NoConsensusError, DegenerateGeometryError) as refusal:
        # Rows that hold a motion loosely fit a mirrored volume as well.
        if rows.dimension == 3 and nearly_degenerate(rows) is None:
            agreed = getattr(refusal, "best_count", 0)
            refuse_mirrored_volume(rows, options, agreed, lambda *other: _best_fit(*other)[0])
        raise


def _fit_targets(rows: TargetRows, options: Options) -> Fit:
    try:
        return fit_targets(rows, options)
    except NoConsensusError as error:
        refuse_nearly_degenerate(rows, str(error))
        raise


def _best_fit(rows: PointLineRows, options: Options) -> tuple[Fit, Fit | None]:
    """As `best_fit`, of rows as they stand."""
    # Rows that leave a motion free have no answer: refuse before fitting, and again once the outliers, which can
    # hide it, are known.
    refuse_degenerate_lines(rows)
    try:
        fit, mirrored = better_of_mirrored(rows, fit_point_lines(rows, options))
    except NoConsensusError as error:
        refuse_nearly_degenerate(rows, str(error))
        raise
    if not fit.inlier.any():
        _refuse_scattered(rows, fit)
    if fit.least_information < SUSPICIOUS_INFORMATION:
        refuse_degenerate_lines(rows, fit.inlier)
    refuse_free_motion(fit.least_information)
    if not fit.converged:
        refuse_nearly_degenerate(rows, "the refinement did not come to rest")
    if np.count_nonzero(fit.inlier) < min(MINIMAL_ROWS, len(rows)):
        _refuse_scattered(rows, fit)
    return fit, mirrored


def _refuse_scattered(rows: PointLineRows, fit: Fit) -> None:
    """Raise for rows that agreed with a minimal sample, and agree no more with what fits all of them best."""
    agreeing = f"{np.count_nonzero(fit.inlier)} of {len(rows)} rows are within {fit.threshold_mm:.3g} mm of their lines"
    refuse_nearly_degenerate(rows, f"only {agreeing} once refined")
    near = near_degeneracy(rows, np.ones(len(rows), dtype=bool))
    if near is not None:
        raise DegenerateGeometryError(
            f"only {agreeing} once refined; check which tool's transform carried the lines, which way it goes, "
            f"and that rows and poses are of the same instant; where they are: {near.cause}, and of such that "
            f"did so exactly {near.free}; {near.advice}",
            code=near.code,
        )
    raise NoConsensusError(
        f"only {agreeing} once refined; check that rows are matched to the right needle poses",
        best_count=int(np.count_nonzero(fit.inlier)),
    )
