"""One scale where the data show several: pixels or voxels that are not square, or sound of another speed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sonocal.calibration.groupings import Groupings
from sonocal.calibration.held_out import FAR
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, AxisScaled, area_places
from sonocal.registration.axis_scales import AxisScales, axis_scales
from sonocal.registration.best_fit import refined_fit
from sonocal.registration.fit import Fit
from sonocal.registration.noise import estimate_noise
from sonocal.registration.robust import MINIMAL_ROWS
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.registration.uncertainty import NORMAL_95, SIGNIFICANT

__all__ = ["anisotropy_findings", "diagnose_anisotropy", "diagnose_voxels"]

# Axis scales that differ by less than this cannot be told from a similarity in practice (0.5 mm at 50 mm).
LEAST_ANISOTROPY = 0.01
# What lies as far out as `SIGNIFICANT` standard deviations.
SURE = 0.0027
# Depth is time times the speed that the scanner assumes; tissue and baths are within this of it.
ASSUMED_M_S, WATER_M_S, SPEEDS = 1540.0, 1482.0, 0.06


def anisotropy_findings(
    table: PointLineRows | TargetRows, fit: Fit, groupings: Groupings, accepted: tuple[Array, float, str]
) -> Iterator[Diagnostic]:
    """Fits the wider model too, and tests whether its scales differ, and whether that is more than care can help.

    Args:
        table: the rows.
        fit: of one scale.
        groupings: what rows may share an error by.
        accepted: the area (2, d), the error that is accepted at its corners, mm, and what messages call the area.
    """
    if fit.model == "anisotropic" or fit.inlier.sum() <= MINIMAL_ROWS:
        return
    if table.dimension == 3:
        found = axis_scales(table, fit, groupings.labels)
        said = [] if found is None else [*diagnose_voxels(found)]
        yield from said
        if found is not None and said:
            yield from _beyond_tolerance(found.transform, fit, accepted)
        return
    wider = refined_fit(fit.transform, table, fit.inlier, replace(fit.levelled, model="anisotropic"))
    # Errors that rows share only widen the covariance: scales alike without them are alike with them.
    if any(diagnose_anisotropy(wider.transform.scales, wider.least_covariance)):
        noise = estimate_noise(table, wider, groupings.labels, time=groupings.time)
        # What few independent errors leave unknown is in a drift's covariance already, and the scan is warned of.
        significant = SIGNIFICANT if noise.drift is None else NORMAL_95
        if said := [*diagnose_anisotropy(wider.transform.scales, noise.covariance, significant)]:
            yield from said
            yield from _beyond_tolerance(wider.transform, fit, accepted)


def _beyond_tolerance(
    wider: AxisScaled, fit: Fit, accepted: tuple[Array, float, str]
) -> Iterator[Diagnostic]:
    """The finding that an answer is not to be used: with its own scale along every axis it is another one."""
    area, tolerance_mm, area_name = accepted
    corners = area_places(area)[:-1]
    apart = float(np.linalg.norm(wider @ corners - fit.transform @ corners, axis=-1).max())
    if apart > FAR * tolerance_mm:
        yield Diagnostic(
            code="anisotropic-scale-far-off",
            severity="warning",
            message=(
                f"with a scale of its own along every axis the corners of the {area_name} lie up to {apart:.1f} mm "
                f"elsewhere, over {FAR:g} times the {tolerance_mm:g} mm accepted"
            ),
            advice="do not use one scale for these images; make their pixels square, or calibrate with the wider model",
        )


def diagnose_anisotropy(
    scales: Array, covariance: Array, significant: float = SIGNIFICANT
) -> Iterator[Diagnostic]:
    """Different mm/px along u and v, where the data show it.

    Args:
        scales: (3,), mm per px, of an anisotropic fit.
        covariance: (8, 8), of its tangent.
        significant: standard deviations that are no chance.
    """
    ratio = float(np.log(scales[0] / scales[1]))
    variance = float(covariance[6, 6] + covariance[7, 7] - 2 * covariance[6, 7])
    deviation = float(np.sqrt(max(variance, 0.0)))
    if not abs(ratio) > max(significant * deviation, LEAST_ANISOTROPY):
        return
    yield Diagnostic(
        code="anisotropic-scale",
        severity="warning",
        message=(
            f"the residuals point to different mm/px in u and v: {scales[0]:.4f} and {scales[1]:.4f} mm/px, "
            f"{100 * np.expm1(abs(ratio)):.1f} % apart (+-{100 * NORMAL_95 * deviation:.1f} %), "
            "where the fitted model has one scale" + _speed_of_sound(-ratio)
        ),
        advice=(
            "for a linear probe or a resampled image, calibrate with the anisotropic model; for a curved probe, with "
            "its radius and the speed of sound (--probe-radius-mm, --sound-speed); else check the pixels' aspect ratio"
        ),
    )


def diagnose_voxels(found: AxisScales) -> Iterator[Diagnostic]:
    """Different mm/px along the axes of a volume, where the data show it; the odd axis is named.

    Args:
        found: the scales that fit best.
    """
    logs = np.log(found.scales)
    odd = int(np.argmax(np.abs(logs - logs.mean())))
    against = np.where(np.arange(3) == odd, 1.0, -0.5)
    ratio, deviation = float(against @ logs), float(np.sqrt(against @ found.covariance @ against))
    if not (np.ptp(logs) > LEAST_ANISOTROPY and found.p_value < SURE):
        return
    others = " and ".join(name for axis, name in enumerate("uvw") if axis != odd)
    yield Diagnostic(
        code="anisotropic-scale",
        severity="warning",
        message=(
            f"the residuals point to different mm/px in u, v and w: {found.scales[0]:.4f}, {found.scales[1]:.4f} and "
            f"{found.scales[2]:.4f} mm/px; {'uvw'[odd]} is {100 * np.expm1(ratio):+.1f} % "
            f"(+-{100 * NORMAL_95 * deviation:.1f} %) off {others}, where the fitted model has one scale"
            + (_speed_of_sound(ratio) if odd == 1 else "")
        ),
        advice=(
            "resample the volume to voxels that are as long along every axis, or check the spacing that its file "
            "states, then calibrate again; for a curved probe with its radius and the speed of sound "
            "(--probe-radius-mm, --sound-speed)"
        ),
    )


def _speed_of_sound(ratio: float) -> str:
    """What medium would stretch depth, v, by this logarithm against the width, where there are such media."""
    if abs(ratio) > SPEEDS:
        return ""
    speed = ASSUMED_M_S * np.exp(ratio)
    return (
        f"; sound of {speed:.0f} m/s where the scanner assumes {ASSUMED_M_S:.0f} would do that to depth along v "
        f"(water at 20 C: {WATER_M_S:.0f} m/s)"
    )
