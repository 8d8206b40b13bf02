"""What a calibration that finds its targets' places says of itself, and of the motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.calibration.area import corner_of
from sonocal.calibration.diagnostics import describe_motion, diagnose_fit
from sonocal.calibration.found_targets import target_findings
from sonocal.calibration.result import Calibration
from sonocal.findings import Diagnostic
from sonocal.geometry import area_places
from sonocal.registration.uncertainty import weakest_motion
from sonocal.registration.unplaced import Placed

__all__ = ["placed_findings"]

HOW_TO_MOVE = (
    "tilt the probe by 30 to 40 deg to both sides about two axes, and turn it about the vertical, seeing the target "
    "all over the image"
)


def placed_findings(calibration: Calibration, answer: Placed) -> Iterator[Diagnostic]:
    """What the fit says of itself, and of the targets."""
    yield from diagnose_fit(answer.inlier, calibration.threshold_mm, converged=True, what="targets")
    yield from _rival(calibration, answer)
    yield from _weakness(calibration)
    yield from target_findings(calibration.targets)


def _rival(calibration: Calibration, answer: Placed) -> Iterator[Diagnostic]:
    corners = area_places(calibration.area_px)[:-1]
    here = calibration.probe_from_image @ corners
    apart = [np.linalg.norm(other @ corners - here, axis=1).max() for other in answer.alternatives]
    if not apart or max(apart) < 0.5 * calibration.options.tolerance_mm:
        return
    yield Diagnostic(
        code="two-answers",
        severity="warning",
        message=(
            f"a second answer, with another place of the target, fits the same rows about as well and is up to "
            f"{max(apart):.1f} mm away in the image"
        ),
        advice=HOW_TO_MOVE,
    )


def _weakness(calibration: Calibration) -> Iterator[Diagnostic]:
    if calibration.covariance is None:
        return
    worst, accepted = calibration.predicted_errors()[2][:-1].max(), calibration.options.tolerance_mm
    if worst <= accepted:
        return
    motion = weakest_motion(
        calibration.probe_from_image, calibration.covariance, area_places(calibration.area_px)[:-1]
    )
    yield Diagnostic(
        code="weak-motion",
        severity="warning",
        message=(
            f"the predicted error reaches {worst:.1f} mm (95 %) at {corner_of(calibration.area_name)}, more than the "
            f"{accepted:g} mm accepted; loosest is {describe_motion(motion, calibration.noise.freedom)}: the motion "
            "tells the calibration from the target's place too little"
        ),
        advice=HOW_TO_MOVE,
    )
