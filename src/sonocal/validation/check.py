"""Whether a calibration still holds, by a short sweep: the change that the sweep shows, and what it could have shown.

    d ~ N(0, C_then + C_now)        d: the motion from the calibration to what the sweep says, with k numbers

Hotelling's test of d tells a change. That none is seen says little by itself: a sweep along one line sees no motion
along it. So what the test would have seen is told beside it (`Check.power`).
"""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from sonocal.calibration import Calibration, calibrate
from sonocal.errors import InputError, SonocalError, UnsupportedError, require
from sonocal.findings import warnings_first
from sonocal.geometry import Array, area_places
from sonocal.observations import Observations
from sonocal.registration.uncertainty import point_jacobian
from sonocal.validation.check_findings import check_findings
from sonocal.validation.check_result import LEVEL, Check
from sonocal.validation.check_rows import motion_of_rows
from sonocal.validation.comparison import motion_between

__all__ = ["check_calibration"]

# Of a turn or a shift known worse than that, a sweep says nothing: that motion is taken out of the test, mm.
UNSEEN_MM = 3.0
# Of the rows that agree with the sweep's own calibration, the share that must be near what is in doubt.
NEAR = 0.9


def check_calibration(
    calibration: Calibration,
    sweep: Observations,
    by_itself: Calibration | None = None,
    *,
    tolerance_mm: float = 1.0,
    same_rows: bool = False,
) -> Check:
    """Whether a calibration still holds, by a short sweep of a needle, of wires or of a thread.

    Args:
        calibration: what is in doubt.
        sweep: sightings of targets whose place in the probe marker's frame is known; of a recording those chosen.
        by_itself: the sweep's own calibration where there is one; default: it is made of the sightings.
        tolerance_mm: the change that matters, rms over the image's corners and centre.
        same_rows: the sweep is what the calibration was made of; of tables their digests tell.

    Raises:
        InputError: the sweep is of another dimension, or the tolerance is no positive number.
        UnsupportedError: the calibration says nothing of its own uncertainty.
    """
    require("calibration", calibration, Calibration)
    require("sweep", sweep, Observations)
    _refuse(calibration, sweep, tolerance_mm)
    own = by_itself if by_itself is not None else _by_itself(calibration, sweep)
    rows, tangent, covariance, freedom = _motion(calibration, sweep, own)
    jacobian = point_jacobian(calibration.probe_from_image, area_places(calibration.area_px), len(tangent))
    jacobian = jacobian.reshape(-1, len(tangent))
    found = Check(
        "cannot tell",
        rows,
        float(tolerance_mm),
        tangent,
        covariance,
        float(freedom),
        _seen(jacobian, covariance),
        jacobian,
        np.asarray(calibration.probe_from_image.translation),
        own,
        same_rows or bool(sweep.sha256 and sweep.sha256 == calibration.provenance.get("sha256")),
        (),
    )
    return _judged(calibration, found)


def _motion(
    calibration: Calibration, sweep: Observations, own: Calibration | None
) -> tuple[int, Array, Array, float]:
    """The rows that agree, the motion (k,) from the calibration to them, its covariance, and the freedom behind it."""
    assert calibration.covariance is not None
    if not sweep.lines_only:
        if own is None:
            raise UnsupportedError(
                f"{sweep.source}: leaves a motion of the image free, and of points and planes a check needs a sweep "
                "that a calibration can be made of; sweep for longer, and tilt and turn the probe"
            )
        between = motion_between(calibration, own)
        return own.fit.inliers, between.tangent, between.covariance, between.freedom
    found, begin = motion_of_rows(calibration, sweep), np.zeros(len(calibration.covariance))
    # From where it is, as long as what agrees with it is what agrees: a sweep that tells little has its own answer
    # anywhere. Far away, from that.
    if own is not None and found.rows < NEAR * own.fit.inliers:
        begin = motion_between(calibration, own).tangent
        found = motion_of_rows(calibration, sweep, own.probe_from_image)
    freedom = min(found.freedom, float(calibration.noise.freedom))
    return found.rows, begin + found.tangent, found.covariance + calibration.covariance, freedom


def _judged(calibration: Calibration, found: Check) -> Check:
    """The check with its verdict and what to know of it."""
    changed = found.p_value < LEVEL
    verdict: Literal["holds", "changed", "cannot tell"] = "holds"
    if changed:
        verdict = "changed"
    elif found.same_rows or not found.tells:
        verdict = "cannot tell"
    judged = replace(found, verdict=verdict)
    return replace(judged, diagnostics=warnings_first([*check_findings(calibration, judged)]))


def _refuse(calibration: Calibration, sweep: Observations, tolerance_mm: float) -> None:
    if not (np.isfinite(tolerance_mm) and tolerance_mm > 0):
        raise InputError(f"tolerance_mm must be a positive number of mm; got {tolerance_mm!r}")
    if sweep.dimension != calibration.dimension:
        raise InputError(
            f"{sweep.source}: is of a {sweep.dimension}D probe and the calibration of a {calibration.dimension}D one; "
            "check with a sweep of the calibrated probe"
        )
    if calibration.covariance is None:
        raise UnsupportedError(
            "the calibration predicts no error of its own, so that no sweep can tell whether it changed; calibrate "
            "with more sightings"
        )


def _by_itself(calibration: Calibration, sweep: Observations) -> Calibration | None:
    """The sweep's own calibration of the same model, where its sightings leave no motion free."""
    options = {"model": calibration.model}
    if calibration.model == "rigid":
        options["scale_mm_per_px"] = calibration.options.scale_mm_per_px  # type: ignore[assignment]
    try:
        own = calibrate(sweep, image_size_px=sweep.image_size_px, **options)  # type: ignore[arg-type]
    except SonocalError:
        return None
    return own if own.covariance is not None and np.isfinite(own.covariance).all() else None


def _seen(jacobian: Array, covariance: Array) -> Array:
    """(k, m): of motions that move the image by 1 mm, those known to `UNSEEN_MM`."""
    values, vectors = np.linalg.eigh(jacobian.T @ jacobian / (len(jacobian) / 3))
    root = vectors * np.sqrt(np.maximum(values, 1e-12))
    spread, ways = np.linalg.eigh(root.T @ covariance @ root)
    back = vectors / np.sqrt(np.maximum(values, 1e-12))
    return np.asarray((back @ ways)[:, spread < UNSEEN_MM**2])
