"""All checks that what is known allows, in one call."""

from __future__ import annotations

from numpy.typing import ArrayLike

from sonocal.findings import DECISIVE, Diagnostic
from sonocal.geometry import Array
from sonocal.setup_checks.copies import check_copies
from sonocal.setup_checks.evidence import Evidence
from sonocal.setup_checks.late import lags_of
from sonocal.setup_checks.latency import latency_of
from sonocal.setup_checks.motion import motion_of
from sonocal.setup_checks.placement import check_flip, check_needle_end, check_tool_frame
from sonocal.setup_checks.scale import check_scale
from sonocal.setup_checks.slip import slip_findings
from sonocal.setup_checks.threshold import check_threshold, share_but_for_noise
from sonocal.setup_checks.two_markers import check_two_markers
from sonocal.setup_checks.units import check_units

__all__ = ["check_setup"]

PARTING = {*DECISIVE, "marker-slipped", "second-needle"}


def check_setup(
    evidence: Evidence,
    *,
    scanner_mm_per_px: float | tuple[float, float] | None = None,
    expected_rotation: ArrayLike | None = None,
    marker_above_image: bool = False,
    tracker_from_probe: Array | None = None,
    seed: int = 0,
) -> tuple[Diagnostic, ...]:
    """Look for what is often wrong with a set-up.

    Args:
        evidence: the calibration and the rows it was fitted to, outliers included.
        scanner_mm_per_px: what the scanner says, one number or one along u and one along v.
        expected_rotation: (3, 3): roughly, the directions of u, v and their normal in the marker's frame.
        marker_above_image: the marker is fixed to the handle, beyond the upper half of the image.
        tracker_from_probe: (N, 4, 4): the probe's pose at each row.
        seed: of the random orders that a slip is compared with.

    Returns:
        The findings; anisotropy is among those of the calibration itself.
    """
    findings = [
        *check_units(evidence),
        *check_flip(evidence, expected_rotation=expected_rotation, marker_above_image=marker_above_image),
        *check_needle_end(evidence),
        *check_copies(evidence),
        *_over_time(evidence, seed),
    ]
    # A slip, a lag or a second needle moves part of the rows, too.
    if not {one.code for one in findings} & PARTING:
        findings += [*check_two_markers(evidence)] or [*check_threshold(evidence)]
    if scanner_mm_per_px is not None:
        findings += check_scale(evidence, scanner_mm_per_px)
    explained = any(one.code in DECISIVE for one in findings)
    if tracker_from_probe is not None or not explained:
        findings += check_tool_frame(
            evidence.table,
            tracker_from_probe=tracker_from_probe,
            threshold_mm=evidence.threshold_mm,
            agreeing=share_but_for_noise(evidence),
        )
    return tuple(findings)


def _over_time(evidence: Evidence, seed: int) -> list[Diagnostic]:
    motion = motion_of(evidence)
    latency = 0.0 if motion is None else latency_of(motion)
    # A latency leaves an order in time that a slip can be mistaken for, and not the other way round.
    late = [*lags_of(evidence, motion, latency)]
    return late if late or motion is None else [*slip_findings(motion, latency, seed)]
