"""Why rows were refused: the checks that run where there is no calibration to look at."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from sonocal.findings import DECISIVE, Diagnostic, warnings_first
from sonocal.geometry.shown import brief
from sonocal.observations import Observations
from sonocal.registration.mirrored import mirrored_finding
from sonocal.registration.near_degeneracy import nearly_degenerate
from sonocal.registration.options import Model
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.setup_checks.lag_search import find_lag
from sonocal.setup_checks.late import lag_finding
from sonocal.setup_checks.latency import LEAST_LAG_MM
from sonocal.setup_checks.placement import GOOD_SHARE, POOR_SHARE, USUAL_MM, quick_fit, wrong_frame
from sonocal.setup_checks.rows_in_time import RowsInTime
from sonocal.setup_checks.threshold import (
    ENOUGH_DEVIATIONS,
    agreeing_further,
    noise_of_middle,
    threshold_too_small,
)
from sonocal.setup_checks.units import units_as_they_stand

__all__ = ["CHECKS", "Refused", "refusal_findings"]


@dataclass(frozen=True, eq=False)
class Refused:
    """Rows that no calibration was found for.

    Attributes:
        observations: as the user has them.
        table: the same as registration takes them.
        model: one scale, or one along u and one along v.
        threshold_mm: rows within this distance would have agreed.
        agreeing: rows that agree with the best that was found, as the refusal says; None where it says nothing of it.
    """

    observations: Observations
    table: PointLineRows | TargetRows
    model: Model
    threshold_mm: float
    agreeing: int | None = None

    __repr__ = brief


Check = Callable[[Refused], Iterable[Diagnostic]]


def check_refused_units(refused: Refused) -> Iterator[Diagnostic]:
    """Rows whose numbers are not in mm or px, as they themselves say."""
    yield from units_as_they_stand(refused.observations, refused.table)


def check_late(refused: Refused) -> Iterator[Diagnostic]:
    """Rows that agree once their lines are taken from another moment."""
    rows = RowsInTime.of(refused.observations, refused.table)
    lag = find_lag(rows, refused.threshold_mm, refused.model)
    if lag is not None and lag.moved_mm > LEAST_LAG_MM:
        yield lag_finding(lag)


def check_mirrored(refused: Refused) -> Iterator[Diagnostic]:
    """A volume that fits once it is mirrored; where it fits nothing as it stands, the refusal says so itself."""
    table = refused.table
    if table.dimension != 3 or nearly_degenerate(table) is not None:
        return
    fit = quick_fit(table.mirrored(), refused.threshold_mm)
    if fit is not None and np.mean(fit.inlier) > GOOD_SHARE:
        yield mirrored_finding(int(np.count_nonzero(fit.inlier)), len(fit.inlier))


# Checks whose finding explains a refusal, those first that leave least doubt. Each gets what was refused and gives
# findings; one that looks at something else is a line here.
CHECKS: list[Check] = [check_refused_units, check_late, check_mirrored]


def refusal_findings(refused: Refused) -> tuple[Diagnostic, ...]:
    """What explains that rows were refused, as far as they themselves can tell: what is decisive first.

    Where nothing else does and few rows agree, they are in no common frame.
    """
    found = [finding for check in CHECKS for finding in check(refused)]
    few = refused.agreeing is not None and refused.agreeing < POOR_SHARE * len(refused.table)
    if few and not found and (further := _agree_further(refused)) is not None:
        found.append(further)
    elif few and not any(finding.code in DECISIVE for finding in found):
        found.append(
            wrong_frame(f"only {refused.agreeing} of {len(refused.table)} rows agree with any calibration")
        )
    return warnings_first(found)


def _agree_further(refused: Refused) -> Diagnostic | None:
    """Where the threshold is less than what is usual and most rows agree within that: they are merely noisy."""
    fit = quick_fit(refused.table, USUAL_MM) if refused.threshold_mm < USUAL_MM else None
    if fit is None:
        return None
    share = agreeing_further(
        fit.residuals_mm, fit.transform.apply(refused.table.points), refused.threshold_mm
    )
    if share <= GOOD_SHARE:
        return None
    noise_mm = noise_of_middle(float(np.median(fit.residuals_mm)))
    return threshold_too_small(
        f"only {refused.agreeing} of {len(refused.table)} rows agree within the threshold of "
        f"{refused.threshold_mm:.3g} mm, and {100 * share:.0f} % with a noise of {noise_mm:.2g} mm per axis",
        ENOUGH_DEVIATIONS * noise_mm,
    )
