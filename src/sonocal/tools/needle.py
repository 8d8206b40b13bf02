"""A needle's segment in its marker's frame: from tip and axis, from two pivots, or from two digitised points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sonocal.errors import DegenerateGeometryError, InputError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.recording import Poses
from sonocal.recording.poses import OnInvalid
from sonocal.targets import Line
from sonocal.tools.pivot import PivotCalibration
from sonocal.tools.poses import counted, distinct_poses
from sonocal.tools.spin import SpinCalibration

__all__ = [
    "DigitisedPoint",
    "NeedleCalibration",
    "digitise_point",
    "needle_from_axis",
    "needle_from_points",
    "needle_from_spin",
]

FAR_FROM_AXIS_MM = 1.0
LEAST_LENGTH_MM = 20.0
STEADY_MM = 1.0
LEAST_SAMPLES = 5


@dataclass(frozen=True, eq=False)
class NeedleCalibration:
    """A needle, and what to know before its use.

    Attributes:
        line: the segment, ready for `write_lines`.
        direction_deviation_deg: standard deviation of its direction.
        diagnostics: what to know before use.
    """

    line: Line
    direction_deviation_deg: float
    diagnostics: tuple[Diagnostic, ...]

    __repr__ = brief


@dataclass(frozen=True, eq=False)
class DigitisedPoint:
    """A point of a tool, touched with a calibrated stylus.

    Attributes:
        point_mm: (3,), in the tool marker's frame.
        covariance: (3, 3), mm^2, of a single sample: samples of one touch share their error.
        samples: how many frames took part; of poses that are equal to the last digit one.
        diagnostics: what to know before use.
    """

    point_mm: Array
    covariance: Array
    samples: int
    diagnostics: tuple[Diagnostic, ...] = ()

    __repr__ = brief


def needle_from_axis(
    pivot: PivotCalibration,
    spin: SpinCalibration,
    length_mm: float | None = None,
    name: str = "needle",
    frame: str = "Needle",
) -> NeedleCalibration:
    """The needle from its tip (pivot) and axis (spin), which runs from the tip back to the marker.

    Args:
        pivot: the tip.
        spin: the axis.
        length_mm: of the shaft, from the tip; default: to the place of the axis beside the marker's origin.
        name: of the line.
        frame: of the line.

    Raises:
        InputError: the length is not positive, or the marker is beside the tip and tells no length.
    """
    tip = pivot.tip_mm
    if length_mm is None:
        length_mm = float(abs(spin.direction @ (spin.point_mm - tip)))
        if length_mm < LEAST_LENGTH_MM:
            raise InputError(
                f"the marker's origin lies {length_mm:.1f} mm behind the tip, which tells nothing of the shaft's "
                "length; give it with --length"
            )
    _check_length(length_mm)
    across = tip - spin.point_mm - spin.direction * (spin.direction @ (tip - spin.point_mm))
    off = float(np.linalg.norm(across))
    # The shaft leads from the tip towards the marker that it carries.
    back = spin.direction * (1.0 if spin.direction @ (spin.point_mm - tip) > 0 else -1.0)
    findings = [*pivot.diagnostics, *spin.diagnostics]
    if off > max(FAR_FROM_AXIS_MM, 3 * pivot.tip_deviation_mm):
        findings.append(
            Diagnostic(
                code="tip-off-axis",
                severity="warning",
                message=f"the pivot's tip lies {off:.2f} mm beside the spin's axis, where a straight needle has it",
                advice="repeat the one with the larger residual; check that the needle is straight and the marker fast",
            )
        )
    line = Line(name, frame, np.array([tip, tip + length_mm * back]))
    return NeedleCalibration(line, _deviation_deg(spin), tuple(findings))


def needle_from_spin(
    spin: SpinCalibration, length_mm: float, name: str = "needle", frame: str = "Needle"
) -> NeedleCalibration:
    """The needle's line from its axis alone, which says nothing of its ends: centred beside the marker's origin.

    Raises:
        InputError: the length is not positive.
    """
    _check_length(length_mm)
    half = length_mm / 2 * spin.direction
    line = Line(name, frame, np.array([spin.point_mm - half, spin.point_mm + half]))
    ends = Diagnostic(
        code="ends-unknown",
        severity="info",
        message="a spin tells where the shaft is and not where it ends; the segment is centred beside the marker",
        advice="pivot the tool too, if its tip matters; a calibration needs the line alone",
    )
    return NeedleCalibration(line, _deviation_deg(spin), (*spin.diagnostics, ends))


def needle_from_points(
    first_mm: ArrayLike,
    second_mm: ArrayLike,
    covariances: tuple[ArrayLike, ArrayLike] | None = None,
    name: str = "needle",
    frame: str = "Needle",
) -> NeedleCalibration:
    """The needle through two points of it: the tips of two pivots, or two digitised points.

    Args:
        first_mm: (3,), in the needle marker's frame.
        second_mm: (3,), in the same frame.
        covariances: (3, 3) of each, mm^2.
        name: of the line.
        frame: of the line.

    Raises:
        DegenerateGeometryError: the points are so close that their direction says nothing.
    """
    segment = np.array([first_mm, second_mm], dtype=float)
    if segment.shape != (2, 3) or not np.isfinite(segment).all():
        raise InputError(f"a needle needs two points of three finite numbers, mm; got shape {segment.shape}")
    length = float(np.linalg.norm(segment[1] - segment[0]))
    spread = 0.0
    if covariances is not None:
        spread = float(np.sqrt(sum(np.linalg.eigvalsh(np.asarray(c, dtype=float))[-1] for c in covariances)))
    if length <= max(3 * spread, 1e-6):
        raise DegenerateGeometryError(
            f"the needle's two points are {length:.2f} mm apart and known to {spread:.2f} mm: its direction is "
            "free; take points as far apart as the shaft allows",
            "points-too-close",
        )
    findings = []
    if length < LEAST_LENGTH_MM:
        findings.append(
            Diagnostic(
                code="short-needle",
                severity="warning",
                message=f"the two points of the needle are only {length:.1f} mm apart",
                advice="take points as far apart as the shaft allows",
            )
        )
    return NeedleCalibration(Line(name, frame, segment), float(np.degrees(spread / length)), tuple(findings))


def _check_length(length_mm: float) -> None:
    if not 0 < length_mm < np.inf:
        raise InputError(f"the needle's length must be positive, mm; got {length_mm}")


def _deviation_deg(spin: SpinCalibration) -> float:
    return float(np.degrees(np.sqrt(np.trace(spin.covariance) / 2)))


def digitise_point(
    tool_from_stylus: Poses, tip_mm: ArrayLike, on_invalid: OnInvalid = "raise"
) -> DigitisedPoint:
    """A point of a tool touched with the tip of a stylus, from the frames of one touch.

        point = tool_from_stylus @ tip

    Args:
        tool_from_stylus: `Recording.between(tool, stylus)`, the frames of the touch.
        tip_mm: (3,) of the stylus, in its marker's frame.
        on_invalid: what to do with poses that are not rigid.

    Raises:
        InputError: too few valid, distinct poses.
        DegenerateGeometryError: the stylus did not rest ("moving").
    """
    usable = tool_from_stylus.usable(tool_from_stylus.plus_name, on_invalid)
    used, repeats = distinct_poses(usable.matrices, usable.valid, usable.plus_name)
    matrices = usable.matrices[used]
    if len(matrices) < LEAST_SAMPLES:
        raise InputError(
            f"{usable.plus_name}: the touch has {counted(used, usable.valid)}; {LEAST_SAMPLES} are needed"
        )
    points = matrices[:, :3, :3] @ np.asarray(tip_mm, dtype=float) + matrices[:, :3, 3]
    middle = np.median(points, axis=0)
    spread = float(np.median(np.linalg.norm(points - middle, axis=1)))
    if spread > STEADY_MM:
        raise DegenerateGeometryError(
            f"{usable.plus_name}: the stylus tip moved by {spread:.2f} mm (median) during the touch, where it should "
            "rest; record again, or give the frames of the touch alone",
            "moving",
        )
    return DigitisedPoint(middle, np.cov(points.T), len(points), repeats)
