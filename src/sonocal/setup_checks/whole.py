"""All checks that what is known allows, in one call."""

from __future__ import annotations

from typing import Any

from sonocal.calibration import Calibration
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.observations import Observations
from sonocal.setup_checks.over_time import check_latency, check_slip
from sonocal.setup_checks.placement import check_flip, check_needle_end, check_scale, check_tool_frame

__all__ = ["check_setup", "checked"]


def check_setup(
    calibration: Calibration,
    observations: Observations,
    *,
    scanner_mm_per_px: float | tuple[float, float] | None = None,
    expected: Array | None = None,
    marker_above_image: bool = False,
    tracker_from_probe: Array | None = None,
    seed: int = 0,
) -> tuple[Diagnostic, ...]:
    """Look for what is often wrong with a set-up.

    Args:
        calibration: the calibration.
        observations: the rows it was fitted to, outliers included.
        scanner_mm_per_px: what the scanner says, one number or one along u and one along v.
        expected: (3, 3): roughly, the directions of u, v and their normal in the marker's frame.
        marker_above_image: the marker is fixed to the handle, beyond the upper half of the image.
        tracker_from_probe: (N, 4, 4): the probe's pose at each row.
        seed: of the random orders that a slip is compared with.

    Returns:
        The findings; anisotropy is among those of the calibration itself.
    """
    findings = [
        *check_flip(calibration, observations, expected=expected, marker_above_image=marker_above_image),
        *check_needle_end(calibration, observations),
        *check_latency(calibration, observations),
    ]
    # A latency leaves an order in time that a slip can be mistaken for, and not the other way round.
    if not any(finding.code == "latency" for finding in findings):
        findings += check_slip(calibration, observations, seed=seed)
    if scanner_mm_per_px is not None:
        findings += check_scale(calibration, scanner_mm_per_px)
    options = calibration.provenance.get("options", {})
    if tracker_from_probe is not None or calibration.fit.inliers < 0.5 * calibration.fit.observations:
        findings += check_tool_frame(
            observations,
            tracker_from_probe=tracker_from_probe,
            threshold_mm=float(options.get("threshold_mm", 5.0)),
        )
    return tuple(findings)


def checked(calibration: Calibration, rows: Observations, **known: Any) -> Calibration:
    """The calibration with what the set-up checks found among its findings, warnings first."""
    from dataclasses import replace

    from sonocal.setup_checks.whole import check_setup
    from sonocal.validation.whole import fitted_rows

    fitted = fitted_rows(calibration, rows)
    known = {name: value for name, value in known.items() if value is not None}
    findings = check_setup(calibration, rows if fitted is None else fitted, **known)
    kept = [d for d in calibration.diagnostics if d.code not in {f.code for f in findings}]
    merged = sorted([*kept, *findings], key=lambda finding: finding.severity != "warning")
    return replace(calibration, diagnostics=tuple(merged))
