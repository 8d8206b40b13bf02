"""The model against others, in words: always told, and a finding where the rows contradict it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from sonocal.calibration.held_out import FAR
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.model_test import ModelTest
from sonocal.registration.uncertainty import scale_95

if TYPE_CHECKING:
    from sonocal.calibration.result import Calibration

__all__ = ["CHECK_SCALE", "model_findings", "model_in_words", "scale_in_words", "scale_known"]

# Axis scales that differ by less than this cannot be told from a similarity in practice (0.5 mm at 50 mm).
LEAST_ANISOTROPY = 0.01
CHECK_SCALE = (
    "check the number, and that it is of this depth setting and of images that were not resampled; leave --scale out "
    "to have the scale found"
)
"""What to do about a known scale that the rows contradict."""
# A scale is told in digits that make up this much of it.
LEAST_OF_KNOWN = 0.001
# Depth is time times the speed that the scanner assumes; tissue and baths are within this of it.
ASSUMED_M_S, WATER_M_S, SPEEDS = 1540.0, 1482.0, 0.06


def model_findings(calibration: Calibration) -> Iterator[Diagnostic]:
    """Where the rows contradict a known scale or one scale for all axes, and where they cannot tell of a known one."""
    for test in calibration.models:
        if test.narrower == "rigid":
            yield from _of_known_scale(test, calibration.accepted)
        elif calibration.model != "anisotropic":
            yield from _of_one_scale(test, calibration.accepted)


def _of_known_scale(test: ModelTest, accepted: tuple[Array, float, str]) -> Iterator[Diagnostic]:
    known, free = test.narrower_mm_per_px, test.wider_mm_per_px[0]
    _, tolerance_mm, area_name = accepted
    if test.contradicts and abs(test.apart) > LEAST_OF_KNOWN:
        yield Diagnostic(
            code="known-scale-disagrees",
            severity="warning",
            message=(
                f"the rows contradict the scale that was given: they have {free:.5f} mm/px "
                f"(+-{100 * test.apart_95:.2g} %) and {known:.5f} were given, {_percent(test.apart)} apart "
                f"({_statistics(test)}); with their own the corners of the {area_name} lie up to "
                f"{test.apart_mm:.1f} mm elsewhere"
            ),
            advice=CHECK_SCALE,
        )
        yield from _far_off("known-scale-far-off", "with the rows' own scale", test, accepted)
    elif (far := test.apart_mm + test.unsure_mm) > tolerance_mm:
        yield Diagnostic(
            code="known-scale-unchecked",
            severity="warning",
            message=(
                f"the rows tell the scale to +-{100 * test.apart_95:.2g} % only ({free:.5f} mm/px where {known:.5f} "
                f"were given) and cannot check it: as far as they say, the corners of the {area_name} may lie "
                f"{far:.1f} mm elsewhere, and the predicted errors take the scale for right"
            ),
            advice=(
                "make sure of the number with the ruler on the scanner, or add sightings with other tilts and places"
            ),
        )


def _of_one_scale(test: ModelTest, accepted: tuple[Array, float, str]) -> Iterator[Diagnostic]:
    logs = np.log(test.wider_mm_per_px)
    if not (test.contradicts and np.ptp(logs) > LEAST_ANISOTROPY):
        return
    yield _unequal_pixels(test) if len(logs) == 2 else _unequal_voxels(test)
    what = "with a scale of its own along every axis"
    yield from _far_off("anisotropic-scale-far-off", what, test, accepted)


def _far_off(
    code: str, what: str, test: ModelTest, accepted: tuple[Array, float, str]
) -> Iterator[Diagnostic]:
    """The finding that an answer is not to be used: the wider model's is another one."""
    _, tolerance_mm, area_name = accepted
    if test.apart_mm <= FAR * tolerance_mm:
        return
    advice = (
        "do not use one scale for these images; make their pixels square, or calibrate with the wider model"
        if code == "anisotropic-scale-far-off"
        else "do not use this calibration; leave --scale out, and compare the scale found with the scanner's ruler"
    )
    yield Diagnostic(
        code=code,
        severity="warning",
        message=(
            f"{what} the corners of the {area_name} lie up to {test.apart_mm:.1f} mm elsewhere, over {FAR:g} times the "
            f"{tolerance_mm:g} mm accepted"
        ),
        advice=advice,
    )


def _unequal_pixels(test: ModelTest) -> Diagnostic:
    u, v = test.wider_mm_per_px
    return Diagnostic(
        code="anisotropic-scale",
        severity="warning",
        message=(
            f"the residuals point to different mm/px in u and v: {u:.4f} and {v:.4f} mm/px, "
            f"{100 * (max(u, v) / min(u, v) - 1.0):.1f} % apart (+-{100 * test.apart_95:.1f} %), "
            "where the fitted model has one scale" + _speed_of_sound(float(np.log(v / u)))
        ),
        advice=(
            "for a linear probe or a resampled image, calibrate with the anisotropic model; for a curved probe, with "
            "its radius and the speed of sound (--probe-radius-mm, --sound-speed); else check the pixels' aspect ratio"
        ),
    )


def _unequal_voxels(test: ModelTest) -> Diagnostic:
    odd, (u, v, w) = test.odd_axis, test.wider_mm_per_px
    others = " and ".join(name for axis, name in enumerate("uvw") if axis != odd)
    return Diagnostic(
        code="anisotropic-scale",
        severity="warning",
        message=(
            f"the residuals point to different mm/px in u, v and w: {u:.4f}, {v:.4f} and {w:.4f} mm/px; "
            f"{'uvw'[odd]} is {100 * test.apart:+.1f} % (+-{100 * test.apart_95:.1f} %) off {others}, where the fitted "
            "model has one scale" + (_speed_of_sound(float(np.log1p(test.apart))) if odd == 1 else "")
        ),
        advice=(
            "check the spacing that the volume's file states; where its voxels are as it says, calibrate with the "
            "anisotropic model, or resample the volume to cubes; for a curved probe, with its radius and the speed of "
            "sound (--probe-radius-mm, --sound-speed)"
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


def scale_known(calibration: Calibration) -> float:
    """To what share the mm/px are known (95 %); 0 where nothing says so, or they were told."""
    covariance = calibration.covariance
    return 0.0 if covariance is None else scale_95(covariance, calibration.noise.freedom)


def scale_in_words(calibration: Calibration) -> str:
    """The scale or scales, and how well they are known."""
    scales = calibration.scales_mm_per_px
    if calibration.model == "rigid":
        return f"{scales[0]:.5f} mm/px, as given"
    if len(scales) > 1:
        return ", ".join(
            f"{scale:.5f} mm/px along {axis}" for scale, axis in zip(scales, "uvw", strict=False)
        )
    if calibration.covariance is None:
        return f"{scales[0]:.5f} mm/px"
    return f"{scales[0]:.5f} mm/px +- {100 * scale_known(calibration):.2g} % (95 %)"


def model_in_words(test: ModelTest) -> str:
    """What a test of the model says, in one sentence with its numbers, whether or not it finds something."""
    scales = ", ".join(f"{scale:.5f}" for scale in test.wider_mm_per_px)
    if test.narrower == "rigid":
        said = "contradict" if test.contradicts else "agree with"
        return (
            f"The rows {said} the scale given: {scales} mm/px of their own against {test.narrower_mm_per_px:.5f}, "
            f"{_percent(test.apart)} apart (+-{100 * test.apart_95:.2g} %; {_statistics(test)})."
        )
    axes = ", ".join("uvw"[: len(test.wider_mm_per_px)])
    said = "one scale does not" if test.contradicts else "one scale does"
    return (
        f"One scale or {len(test.wider_mm_per_px)}: {said}; along {axes} the rows have {scales} mm/px, "
        f"{_percent(test.apart)} apart (+-{100 * test.apart_95:.2g} %; {_statistics(test)})."
    )


def _statistics(test: ModelTest) -> str:
    p = f"= {test.p_value:.2g}" if test.p_value >= 1e-6 else "< 1e-6"
    return f"F({test.contrasts}, {test.freedom:.0f}) = {test.f_statistic:.3g}, p {p}"


def _percent(share: float) -> str:
    return f"{100 * share:+.2g} %"
