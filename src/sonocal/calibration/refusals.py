"""A refusal that leads with what explains it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from sonocal.calibration.mixed import table_of
from sonocal.calibration.models import CHECK_SCALE
from sonocal.calibration.options import Options
from sonocal.errors import DegenerateGeometryError, MirroredVolumeError, NoConsensusError
from sonocal.findings import DECISIVE, Diagnostic
from sonocal.observations import Observations
from sonocal.registration.degeneracy import refuse_degenerate_lines
from sonocal.registration.fit_targets import fit_targets
from sonocal.registration.free_scale import freely_scaled
from sonocal.registration.refusals import refuse_free
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.setup_checks.refused import Refused, refusal_findings
from sonocal.setup_checks.units import units_as_they_stand

__all__ = ["explained", "leading_with"]

# Where the noise would have told, and there is no fit to tell it from.
THRESHOLD_MM = 5.0


@contextmanager
def explained(rows: Observations, options: Options) -> Iterator[None]:
    """Within it, a refusal of these rows runs the set-up checks, carries what they find and leads with it."""
    try:
        yield
    except (NoConsensusError, DegenerateGeometryError) as error:
        table = table_of(rows)
        if isinstance(error, MirroredVolumeError) or _is_degenerate(table):
            # These say themselves what they come from, unless units made them so.
            found = tuple(units_as_they_stand(rows, table))
        else:
            found = _findings(rows, table, options, error)
        if found:
            error.explained((*found, *error.diagnostics), leading_with(found, str(error)))
        raise


def _findings(
    rows: Observations,
    table: PointLineRows | TargetRows,
    options: Options,
    error: NoConsensusError | DegenerateGeometryError,
) -> tuple[Diagnostic, ...]:
    threshold = options.threshold_mm
    found = refusal_findings(
        Refused(
            observations=rows,
            table=table,
            model=options.model,
            threshold_mm=THRESHOLD_MM if threshold == "auto" else threshold,
            agreeing=error.best_count if isinstance(error, NoConsensusError) else None,
        )
    )
    return (*_of_scale(table, options, error), *found)


# What a refusal is led by, wherever it was found.
EXPLAINING = {*DECISIVE, "threshold-below-noise"}


def leading_with(findings: tuple[Diagnostic, ...], refusal: str) -> str:
    """The sentence of a refusal, led by the finding that explains it, if one does.

    Of the refusal its fact stays, and not what to do: the finding knows better.
    """
    first = next((one for one in findings if one.code in EXPLAINING), None)
    fact = refusal.partition(";")[0]
    if first is None:
        return refusal
    if first.code == "wrong-tool-frame":  # which says of the rows what the refusal says
        return f"{fact}; {first.advice}"
    return f"{first.message}; {first.advice} (refused as it stands: {fact})"


def _of_scale(
    table: PointLineRows | TargetRows, options: Options, refusal: NoConsensusError | DegenerateGeometryError
) -> Iterator[Diagnostic]:
    """The finding that more rows agree where the scale is free, of a refusal under a known one."""
    if options.model != "rigid":
        return
    fit = freely_scaled(table, options, _agreeing(table, options, refusal))
    if fit is not None:
        yield Diagnostic(
            code="known-scale-disagrees",
            severity="warning",
            message=(
                f"the rows contradict the scale that was given: {int(fit.inlier.sum())} of {len(table)} agree at "
                f"{fit.transform.scales[0]:.5f} mm/px, and {options.scale_mm_per_px:.5f} were given"
            ),
            advice=CHECK_SCALE,
        )


def _agreeing(
    table: PointLineRows | TargetRows, options: Options, refusal: NoConsensusError | DegenerateGeometryError
) -> int:
    """How many rows agreed before they were refused, which a refusal of what leaves a motion free does not say."""
    if isinstance(refusal, NoConsensusError):
        return refusal.best_count
    try:
        if isinstance(table, TargetRows):
            return int(np.count_nonzero(fit_targets(table, options).inlier))
        return int(np.count_nonzero(fit_point_lines(table, options).inlier))
    except NoConsensusError as none:
        return none.best_count
    except DegenerateGeometryError:  # whatever the scale is
        return len(table)


def _is_degenerate(table: PointLineRows | TargetRows) -> bool:
    try:
        if isinstance(table, TargetRows):
            refuse_free(table.constraints)
        else:
            refuse_degenerate_lines(table)
    except DegenerateGeometryError:
        return True
    return False
