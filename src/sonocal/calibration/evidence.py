"""Set-up checks of a calibration: what they look at, and what the options say of the set-up."""

from __future__ import annotations

from sonocal.calibration.mixed import mapped_of
from sonocal.calibration.result import Calibration
from sonocal.findings import Diagnostic
from sonocal.observations import Observations
from sonocal.registration.mapped import Mapped
from sonocal.setup_checks import Evidence, check_setup

__all__ = ["evidence_of", "set_up_findings"]


def evidence_of(
    calibration: Calibration, observations: Observations, mapped: Mapped | None = None
) -> Evidence:
    """What the set-up checks look at.

    Args:
        calibration: the calibration.
        observations: the rows it was fitted to, outliers included, or those of another scan.
        mapped: the same under the calibration, where they were mapped before.
    """
    if mapped is None:
        mapped = mapped_of(calibration.probe_from_image, observations)
    return Evidence(
        observations=observations,
        mapped=mapped,
        model=calibration.model,
        covariance=calibration.covariance,
        area_px=calibration.area_px,
        threshold_mm=calibration.threshold_mm,
        rms_mm=calibration.fit.rms_mm,
        tolerance_mm=calibration.options.tolerance_mm,
        area_name=calibration.area_name,
        sigma_px=calibration.noise.sigma_px or 0.0,
    )


def set_up_findings(
    calibration: Calibration, observations: Observations, mapped: Mapped
) -> tuple[Diagnostic, ...]:
    """What the checks find in the fitted rows, with what the calibration's options say of the set-up."""
    options = calibration.options
    return check_setup(
        evidence_of(calibration, observations, mapped),
        scanner_mm_per_px=options.scanner_mm_per_px,
        expected_rotation=options.expected_rotation,
        marker_above_image=options.marker_above_image,
        seed=options.seed,
    )
