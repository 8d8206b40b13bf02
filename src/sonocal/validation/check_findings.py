"""What to know of a check: what changed, what may have changed it, and what the sweep cannot show."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.calibration import Calibration
from sonocal.calibration.diagnostics import describe_motion
from sonocal.findings import Diagnostic
from sonocal.geometry import area_places
from sonocal.registration.uncertainty import weakest_motion
from sonocal.validation.check_result import Check
from sonocal.validation.other_scan import AGREE, other_scale

__all__ = ["check_findings"]


def check_findings(calibration: Calibration, check: Check) -> Iterator[Diagnostic]:
    """Findings of a check that has its verdict.

    Args:
        calibration: what was in doubt.
        check: the check.
    """
    own = check.by_itself
    depth = [*other_scale(calibration, own)] if own is not None and check.verdict == "changed" else []
    if check.verdict == "changed":
        yield _changed(check, known=bool(depth))
    elif check.verdict == "cannot tell":
        yield _too_weak(calibration, check)
    yield from depth
    if own is not None:
        share = own.fit.inliers / max(own.fit.observations, 1)
        if share < AGREE:
            yield Diagnostic(
                code="many-outliers",
                severity="warning",
                message=f"{100 * (1 - share):.0f} % of the sweep's sightings agree with nothing and were left out",
                advice="look at what else its images show; sweep again where the target is seen alone",
            )


def _changed(check: Check, *, known: bool) -> Diagnostic:
    parts = [f"{check.moved_mm:.2f} mm rms over the image", f"turned by {check.turned_deg:.2f} deg"]
    if abs(check.scale_change) > 1e-3:
        parts.append(f"mm/px changed by {100 * check.scale_change:+.1f} %")
    return Diagnostic(
        code="calibration-changed",
        severity="warning",
        message=(
            f"the sweep puts the image elsewhere than the calibration does: {', '.join(parts)}; a calibration that "
            f"holds shows as much in {100 * check.p_value:.2g} of 100 sweeps"
        ),
        advice=(
            "set the scanner's depth back, or calibrate for this one"
            if known
            else "calibrate again: the marker was knocked; or what was swept did: pivot the needle, touch the phantom"
        ),
    )


def _too_weak(calibration: Calibration, check: Check) -> Diagnostic:
    if check.same_rows:
        return Diagnostic(
            code="check-too-weak",
            severity="warning",
            message="the sweep is what the calibration was made of: it says nothing of what changed since",
            advice="sweep again today",
        )
    if check.rows == 0:
        return Diagnostic(
            code="check-too-weak",
            severity="warning",
            message=(
                "too few sightings lie where the calibration puts them, and they make none by themselves: the sweep "
                "tells nothing"
            ),
            advice="sweep again with the target in view; if it was, calibrate again",
        )
    motion = weakest_motion(calibration.probe_from_image, check.covariance, area_places(calibration.area_px))
    least = describe_motion(motion, max(int(check.freedom), 1))
    seen = f"those of {check.visible_mm:.1f} mm" if np.isfinite(check.visible_mm) else "none, however large"
    return Diagnostic(
        code="check-too-weak",
        severity="warning",
        message=(
            f"no change is seen, but of knocks of {check.tolerance_mm:g} mm this sweep would show "
            f"{100 * check.power_mean:.0f} %, and whichever way they go {seen}; least is known of the {least}"
        ),
        advice="sweep for longer, and tilt and turn the probe or the needle to all sides",
    )
