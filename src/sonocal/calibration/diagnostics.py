"""What a user should know before trusting a calibration, in words, with the numbers."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration.area import corner_of
from sonocal.calibration.bent import likeliest_of_needle
from sonocal.calibration.distortion import likeliest_of_image
from sonocal.calibration.few_targets import few_fixed_targets, few_targets_finding
from sonocal.calibration.groupings import Groupings
from sonocal.calibration.models import model_findings
from sonocal.calibration.result import Calibration
from sonocal.calibration.thickness import likeliest_of_slice
from sonocal.findings import Diagnostic
from sonocal.geometry import Array, AxisScaled, area_places
from sonocal.registration.ambiguity import Rival
from sonocal.registration.fit import Fit
from sonocal.registration.mapped import Mapped, MappedRows
from sonocal.registration.near_degeneracy import NearDegeneracy, near_degeneracy
from sonocal.registration.noise import Noise
from sonocal.registration.robust import MINIMAL_ROWS
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.registration.uncertainty import (
    WeakMotion,
    point_covariance,
    quantile_95,
    radius_95,
    weakest_motion,
)

__all__ = [
    "Diagnostic",
    "describe_motion",
    "diagnose_fit",
    "diagnose_image_plane",
    "diagnose_noise",
    "diagnose_rival",
    "diagnose_weakness",
    "fit_findings",
    "predicts",
]

MANY_OUTLIERS = 0.2
# Errors shared over stretches of frames that exceed the rows' own by this factor are worth a warning.
LARGE_DRIFT = 2.0
# With fewer independent errors their variance is known to no better than a third of itself.
ENOUGH_STRETCHES = 30.0
# A quarter of needles within 5 deg of the image is not chance: of random ones it is a twelfth.
FLAT_DEG, FLAT_SHARE = 5.0, 0.25


def diagnose_weakness(
    motion: WeakMotion,
    freedom: float,
    worst_mm: float,
    accepted: tuple[Array, float, str],
    near: NearDegeneracy | None,
) -> Iterator[Diagnostic]:
    """The motion that the data hold least, when the predicted error exceeds what the user accepts."""
    _, tolerance_mm, area = accepted
    if worst_mm <= tolerance_mm:
        return
    cause = near.cause if near else "the sightings hold it too loosely"
    yield Diagnostic(
        code="weak-motion",
        severity="warning",
        message=(
            f"the predicted error reaches {worst_mm:.1f} mm (95 %) at {corner_of(area)}, more than the "
            f"{tolerance_mm:g} mm accepted; loosest is {describe_motion(motion, freedom)}: {cause}"
        ),
        advice=near.advice
        if near
        else f"add sightings, above all near the corners of the {area} and with other tilts",
    )


def diagnose_rival(rival: Rival | None) -> Iterator[Diagnostic]:
    """A second answer that the data do not exclude."""
    if rival is None:
        return
    yield Diagnostic(
        code="two-answers",
        severity="warning",
        message=(
            f"a second answer fits the same rows with {rival.rms_mm:.3g} mm rms against {rival.own_rms_mm:.3g} and is "
            f"up to {rival.apart_mm:.1f} mm away in the image: the needles are too nearly parallel to tell an image "
            "from its mirror"
        ),
        advice="add sightings with the needle tilted by 30 deg or more, in two directions",
    )


def diagnose_image_plane(rotation: Array, directions: Array) -> Iterator[Diagnostic]:
    """Needles that lie in a 2D image, where it shows a line and no point of theirs is the one seen.

    Args:
        rotation: (3, 3), of the calibration.
        directions: (N, 3), of the needles in the probe marker's frame.
    """
    flat = int(np.count_nonzero(np.abs(directions @ rotation[:, 2]) < np.sin(np.radians(FLAT_DEG))))
    if flat <= FLAT_SHARE * len(directions):
        return
    yield Diagnostic(
        code="needle-in-image-plane",
        severity="warning",
        message=(
            f"{flat} of {len(directions)} needles lie within {FLAT_DEG:g} deg of the image plane, where the image "
            "shows a line and not a point"
        ),
        advice="hold the needle at 30 deg or more to the image plane",
    )


def describe_motion(motion: WeakMotion, freedom: float) -> str:
    """The motion in words, at 95 %: which turn, shift or growth, how well that is known, and what the motion does.

    Args:
        motion: the loosest.
        freedom: residuals to spare that its covariance rests on.
    """
    sure = quantile_95(freedom)
    parts = {
        motion.turn_rms_mm: (
            f"rotation about {_axis(motion.turn_rad)}, known to "
            f"+-{np.degrees(sure * motion.turn_deviation_rad):.2g} deg"
        ),
        motion.shift_rms_mm: (
            f"shift along {_axis(motion.shift_mm)}, known to +-{sure * motion.shift_deviation_mm:.2g} mm"
        ),
        motion.growth_rms_mm: f"scale, known to +-{100 * sure * motion.growth_deviation:.2g} %",
    }
    return f"{parts[max(parts)]} (it moves the corners by {sure * motion.rms_mm:.2g} mm)"


def diagnose_noise(noise: Noise) -> Iterator[Diagnostic]:
    """Errors that rows share: they do not average out, and say that something is systematically off."""
    yield from _diagnose_drift(noise)
    shared = {"target": "a needle or wire", "frame": "a frame"}
    for name, what in shared.items():
        if noise.shared_mm.get(name, 0.0) > 0.5 * noise.row_mm:
            yield Diagnostic(
                code=f"shared-{name}-error",
                severity="info",
                message=(
                    f"rows of {what} share an error of {noise.shared_mm[name]:.2f} mm beside the "
                    f"{noise.row_mm:.2f} mm of single rows; the predicted error counts it"
                ),
                advice="more rows of the same kind will not reduce it; more "
                + ("needles or wires" if name == "target" else "frames")
                + " will",
            )


def _diagnose_drift(noise: Noise) -> Iterator[Diagnostic]:
    """An error that wanders, if it is large, or if too few independent ones were seen to average it."""
    drift, size = noise.drift, noise.shared_mm.get("stretch", 0.0)
    if drift is None:
        return
    few = drift.stretches < ENOUGH_STRETCHES
    if not (few or size > LARGE_DRIFT * noise.row_mm):
        return
    many = round(drift.stretches)
    seen = "one independent stretch was" if many <= 1 else f"{many} independent stretches were"
    guess = f"; only about {seen} seen, so that the predicted error is a guess" if few else ""
    yield Diagnostic(
        code="drifting-residuals",
        severity="warning",
        message=(
            f"frames share an error of {size:.2f} mm that drifts over some {2 * drift.memory_frames:.0f} frames, "
            f"{size / max(noise.row_mm, 0.01 * size):.1f} times the {noise.row_mm:.2f} mm of single rows: "
            f"neighbouring frames repeat one another's error{guess}"
        ),
        advice=(
            "look for a time lag between image and tracker, a slipped marker, "
            "or lines that are not where the file says"
            + ("; scan longer, for more than thirty times as long as the error drifts over" if few else "")
        ),
    )


def diagnose_fit(
    inlier: NDArray[np.bool_], threshold_mm: float, *, converged: bool, what: str = "lines"
) -> Iterator[Diagnostic]:
    """Too few rows, too many that disagree, or a refinement that did not come to rest.

    Args:
        inlier: (N,): the rows that agree.
        threshold_mm: of their distances.
        converged: whether the refinement did.
        what: the rows lie on.
    """
    rows, agreeing = len(inlier), int(inlier.sum())
    if agreeing <= MINIMAL_ROWS:
        yield Diagnostic(
            code="no-redundancy",
            severity="warning",
            message=(
                f"{agreeing} rows determine the calibration and none is left to check it; "
                "no error can be predicted"
            ),
            advice="add sightings; ten well spread ones give a first idea of the error",
        )
    if rows - agreeing > MANY_OUTLIERS * rows:
        yield Diagnostic(
            code="many-outliers",
            severity="warning",
            message=(
                f"{rows - agreeing} of {rows} rows are further than {threshold_mm:.3g} mm from their {what} "
                "and were left out"
            ),
            advice="look at the rows marked as outliers; check the detections and which needle each row belongs to",
        )
    if not converged:
        yield Diagnostic(
            code="not-converged",
            severity="warning",
            message="the refinement did not come to rest; the answer may be off by more than predicted",
            advice="add sightings with other tilts and places",
        )


def _axis(vector: Array) -> str:
    names = ("the image's u axis", "the image's v axis", "the image's normal")
    unit = vector / np.linalg.norm(vector)
    strongest = int(np.argmax(np.abs(unit)))
    if abs(unit[strongest]) > 0.9:
        return names[strongest]
    return "the image axis (" + ", ".join(f"{x:.1f}" for x in unit) + ") in (u, v, normal)"


def fit_findings(
    found: Calibration, mapped: Mapped, fit: Fit, rival: Rival | None, groupings: Groupings
) -> Iterator[Diagnostic]:
    """What the fit says of itself.

    Args:
        found: the calibration, with the noise that errors are predicted by and what error is accepted.
        mapped: the fitted rows under the transform, outliers included.
        fit: the transform.
        rival: a second answer, or None.
        groupings: what rows may share an error by.
    """
    noise, accepted = found.noise, found.accepted
    yield from few_targets_finding(few_fixed_targets(mapped.table, fit.inlier))
    what = "lines" if isinstance(mapped, MappedRows) else "targets"
    yield from diagnose_fit(fit.inlier, fit.threshold_mm, converged=fit.converged, what=what)
    yield from diagnose_rival(rival)
    yield from weakness_findings(mapped.table, fit.transform, fit.inlier, noise, accepted)
    if isinstance(mapped, MappedRows) and mapped.table.dimension == 2:
        yield from diagnose_image_plane(fit.transform.rotation, mapped.directions[fit.inlier])
    yield from diagnose_noise(noise)
    told = [*model_findings(found)]
    yield from told
    if any(one.code != "known-scale-unchecked" for one in told):
        return
    if not isinstance(mapped, MappedRows):
        yield from _of_lines_alone()
        return
    area, _, area_name = accepted
    looks = (likeliest_of_image, likeliest_of_needle, likeliest_of_slice)
    likely = [one for look in looks if (one := look(mapped, fit, noise, groupings, (area, area_name)))]
    # What one of these leaves in the residuals may look like the other.
    if likely:
        yield min(likely, key=lambda one: one[0])[1]


def _of_lines_alone() -> Iterator[Diagnostic]:
    yield Diagnostic(
        code="unchecked-set-up",
        severity="info",
        message=(
            "the table holds points or planes: an image that is distorted, echoes of a thick slice, a bent needle and "
            "a second one are looked for in tables of lines alone"
        ),
        advice="where one of these is likely, calibrate a sweep of a needle too and compare the two",
    )


def predicts(noise: Noise) -> bool:
    """Whether the covariance is one: no row may be left over to tell, or a fit not have come to rest."""
    return bool(np.isfinite(noise.covariance).all() and noise.covariance.diagonal().min() >= 0)


def weakness_findings(
    table: PointLineRows | TargetRows,
    transform: AxisScaled,
    inlier: NDArray[np.bool_],
    noise: Noise,
    accepted: tuple[Array, float, str],
) -> Iterator[Diagnostic]:
    """The predicted error at the corners against what is accepted."""
    if not predicts(noise):
        return
    area, tolerance_mm, _ = accepted
    corners = area_places(area)[:-1]
    covariances = point_covariance(transform, noise.covariance, corners)
    worst = float(radius_95(covariances, noise.freedom).max())
    if worst <= tolerance_mm:
        return
    motion = weakest_motion(transform, noise.covariance, corners)
    near = near_degeneracy(table, inlier)
    yield from diagnose_weakness(motion, noise.freedom, worst, accepted, near)
