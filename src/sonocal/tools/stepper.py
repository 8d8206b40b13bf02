"""The axes of a stepper that turns a probe and moves it along: of a transrectal probe in its cradle.

    R_i a = d                               a: axis of rotation in the probe marker's frame, d: in the tracker's
    p_j = p_0 + s_j R b                     b: axis of translation in the probe marker's frame

All that a stepper does commutes with turns about its axis and, where that is parallel to the translation, with shifts
along it: no sweep of targets whose place is unknown tells these two motions of the image. They are named with the axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sonocal.errors import DegenerateGeometryError
from sonocal.findings import Diagnostic, warnings_first
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.tools.poses import checked_poses, turns_deg
from sonocal.tools.spin import calibrate_spin

__all__ = ["StepperCalibration", "calibrate_stepper"]

LEAST_TRAVEL_MM, GOOD_TRAVEL_MM = 5.0, 30.0
# Of a translation: off its line by more it is none, and turned by more.
MOST_OFF, MOST_TURN_DEG = 0.1, 2.0
# Axes that are said to be parallel: their angle beyond that, and beyond so many deviations.
PARALLEL_DEG, SURE = 0.5, 3.0


@dataclass(frozen=True, eq=False)
class StepperCalibration:
    """The axes of a stepper, in the frame of the probe's marker.

    Attributes:
        axis: (3,) unit: of rotation, to the side to which the probe is moved on.
        centre_mm: (3,): the point of that axis nearest the marker's origin.
        axis_covariance: (3, 3), rad^2, of the axis; zero along it.
        translation: (3,) unit: of the travel, from the first pose to the last.
        translation_covariance: (3, 3), rad^2, likewise.
        between_deg: angle between the two.
        between_sigma_deg: its standard deviation.
        turn_deg: rms turn about the axis.
        travel_mm: from one end of the travel to the other.
        wobble_deg: rms angle of the axis as the probe turned.
        wobble_mm: rms distance of the axis from one place.
        off_mm: rms distance of the travel from one line, along either side.
        free_motions: what no sweep with this stepper tells of the image, where targets' places are unknown.
        diagnostics: what to know before use.
    """

    axis: Array
    centre_mm: Array
    axis_covariance: Array
    translation: Array
    translation_covariance: Array
    between_deg: float
    between_sigma_deg: float
    turn_deg: float
    travel_mm: float
    wobble_deg: float
    wobble_mm: float
    off_mm: float
    free_motions: tuple[str, ...]
    diagnostics: tuple[Diagnostic, ...]

    __repr__ = brief


def calibrate_stepper(
    rotation: ArrayLike,
    translation: ArrayLike,
    *,
    rotation_valid: ArrayLike | None = None,
    translation_valid: ArrayLike | None = None,
    source: str = "poses",
) -> StepperCalibration:
    """The axes of a stepper, from two recordings of the probe's poses.

    Args:
        rotation: (N, 4, 4): tracker (or base) from the probe's marker, the stepper turning alone.
        translation: (M, 4, 4): likewise, the stepper moving along alone.
        rotation_valid: (N,): which of these to use; default: all that are finite.
        translation_valid: (M,): likewise.
        source: what messages call the recordings.

    Raises:
        InputError: too few distinct poses, or one is not rigid.
        DegenerateGeometryError: the probe hardly turned ("still") or turned about more than one axis ("not-a-spin");
            it hardly travelled ("stepper-still"), or on no line ("not-a-line").
    """
    spin = calibrate_spin(rotation, rotation_valid, f"{source}, rotation")
    poses, used, repeats = checked_poses(translation, translation_valid, f"{source}, translation")
    places, turned = poses[used, :3, 3], poses[used, :3, :3]
    middle = places.mean(axis=0)
    _, sizes, axes = np.linalg.svd(places - middle, full_matrices=False)
    along = (places - middle) @ axes[0]
    travel = float(np.ptp(along))
    off = float(np.sqrt(np.sum(sizes[1:] ** 2) / (2 * len(places))))
    _refuse(travel, off, float(turns_deg(turned)[2]), f"{source}, translation")
    u, _, vt = np.linalg.svd(turned.mean(axis=0))
    facing = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    way = axes[0] * (1.0 if along[-1] >= along[0] else -1.0)
    translation_axis = facing.T @ way
    # Of a slope: what the places are off by, over how far they spread; and the marker's own turns.
    spread = float(np.sum(along**2))
    slope = off**2 * len(places) / max(len(places) - 2, 1) / spread
    slope += float(np.radians(turns_deg(turned)[2])) ** 2 / len(places)
    covariance = slope * (np.eye(3) - np.outer(translation_axis, translation_axis))
    axis = spin.direction if spin.direction @ translation_axis >= 0 else -spin.direction
    across = np.cross(axis, translation_axis)
    between = float(np.arctan2(np.linalg.norm(across), axis @ translation_axis))
    sigma = float(np.sqrt(np.linalg.eigvalsh(spin.covariance + covariance)[-1]))
    found = StepperCalibration(
        axis=axis,
        centre_mm=spin.point_mm,
        axis_covariance=spin.covariance,
        translation=translation_axis,
        translation_covariance=covariance,
        between_deg=float(np.degrees(between)),
        between_sigma_deg=float(np.degrees(sigma)),
        turn_deg=spin.turn_deg,
        travel_mm=travel,
        wobble_deg=spin.wobble_deg,
        wobble_mm=spin.wobble_mm,
        off_mm=off,
        free_motions=(),
        diagnostics=(),
    )
    findings = (*spin.diagnostics, *repeats, *_findings(found))
    return replace(found, free_motions=_free(found), diagnostics=warnings_first(findings))


def _refuse(travel_mm: float, off_mm: float, turn_deg: float, source: str) -> None:
    if travel_mm < LEAST_TRAVEL_MM:
        raise DegenerateGeometryError(
            f"{source}: the probe travelled {travel_mm:.1f} mm only, so the axis of translation is free; move it "
            f"along by {GOOD_TRAVEL_MM:.0f} mm or more",
            "stepper-still",
        )
    if off_mm > MOST_OFF * travel_mm or turn_deg > MOST_TURN_DEG:
        raise DegenerateGeometryError(
            f"{source}: the probe went on no line ({off_mm:.1f} mm rms beside it, turned by {turn_deg:.1f} deg rms); "
            "move the stepper along without turning it, and give the rotation first and the translation second",
            "not-a-line",
        )


def _parallel(found: StepperCalibration) -> bool:
    return found.between_deg < max(PARALLEL_DEG, SURE * found.between_sigma_deg)


def _free(found: StepperCalibration) -> tuple[str, ...]:
    """Motions that commute with all that the stepper does."""
    axis, centre = (", ".join(f"{x:.{n}f}" for x in v) for v, n in ((found.axis, 3), (found.centre_mm, 1)))
    if _parallel(found):
        return (
            f"a turn about the axis along ({axis}) through ({centre}) mm of the marker",
            f"a shift along ({axis})",
        )
    return (f"a shift along ({axis}), but for what the tilted translation tells",)


def _findings(found: StepperCalibration) -> Iterator[Diagnostic]:
    if not _parallel(found):
        yield Diagnostic(
            code="stepper-tilted",
            severity="warning",
            message=(
                f"the axis of rotation is tilted by {found.between_deg:.2f} deg "
                f"(+-{1.96 * found.between_sigma_deg:.2f}) from the translation: over 100 mm of travel that is "
                f"{100 * np.tan(np.radians(found.between_deg)):.1f} mm"
            ),
            advice="give both axes to what uses them, and do not take them for one; or true the cradle",
        )
    if found.travel_mm < GOOD_TRAVEL_MM:
        yield Diagnostic(
            code="little-travel",
            severity="warning",
            message=f"the probe travelled {found.travel_mm:.0f} mm only",
            advice=f"move it along by {GOOD_TRAVEL_MM:.0f} mm or more",
        )
