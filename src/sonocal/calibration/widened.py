"""A calibration whose errors turn out to be larger than its rows alone show."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from sonocal.calibration.diagnostics import weakness_findings
from sonocal.calibration.result import Calibration
from sonocal.calibration.rows import point_line_rows
from sonocal.findings import Diagnostic, Findings
from sonocal.geometry import Array
from sonocal.observations import Observations

__all__ = ["widened"]


def widened(
    calibration: Calibration, covariance: Array, rows: Observations, found: Iterable[Diagnostic] = ()
) -> Calibration:
    """The calibration with that covariance, what it says of the error predicted, and what was found besides.

    Args:
        calibration: as it was fitted.
        covariance: (k, k), of its tangent.
        rows: as it was fitted to them.
        found: further findings.
    """
    noise = replace(calibration.noise, covariance=covariance)
    table, before = point_line_rows(rows), calibration.diagnostics
    findings = Findings(
        found,
        (
            lambda: [finding for finding in before if finding.code != "weak-motion"],
            lambda: weakness_findings(
                table, calibration.probe_from_image, calibration.inlier, noise, calibration.accepted
            ),
        ),
    )
    return replace(calibration, covariance=covariance, noise=noise, diagnostics=findings)
