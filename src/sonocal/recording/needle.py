"""A needle's segment in its marker's frame: from tip and axis, from two pivots, or from two digitised points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sonocal.errors import DegenerateGeometryError, InputError
from sonocal.geometry import Array
from sonocal.recording.findings import Diagnostic
from sonocal.recording.lines import Line
from sonocal.recording.pivot import PivotCalibration
from sonocal.recording.poses import OnInvalid, Poses
from sonocal.recording.spin import SpinCalibration

__all__ = ["DigitisedPoint", "NeedleCalibration", "digitise_point", "needle_from_axis", "needle_from_points"]

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


@dataclass(frozen=True, eq=False)
class DigitisedPoint:
    """A point of a tool, touched with a calibrated stylus.

    Attributes:
        point_mm: (3,), in the tool marker's frame.
        covariance: (3, 3), mm^2, of a single sample: samples of one touch share their error.
        samples: how many frames took part.
    """

    point_mm: Array
    covariance: Array
    samples: int


def needle_from_axis(
    pivot: PivotCalibration,
    spin: SpinCalibration,
    length_mm: float,
    name: str = "needle",
    frame: str = "Needle",
) -> NeedleCalibration:
    """The needle from its tip (pivot) and axis (spin), which runs from the tip back to the marker.

    Args:
        pivot: the tip.
        spin: the axis.
        length_mm: of the shaft, from the tip.
        name: of the line.
        frame: of the line.

    Raises:
        InputError: the length is not positive.
    """
    if not 0 < length_mm < np.inf:
        raise InputError(f"the needle's length must be positive, mm; got {length_mm}")
    tip = pivot.tip_mm
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
    deviation = float(np.degrees(np.sqrt(np.trace(spin.covariance) / 2)))
    return NeedleCalibration(
        Line(name, frame, np.array([tip, tip + length_mm * back])), deviation, tuple(findings)
    )


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
        InputError: too few valid poses.
        DegenerateGeometryError: the stylus did not rest ("moving").
    """
    usable = tool_from_stylus.usable(tool_from_stylus.plus_name, on_invalid)
    matrices = usable.matrices[usable.valid]
    if len(matrices) < LEAST_SAMPLES:
        raise InputError(
            f"{usable.plus_name}: has {len(matrices)} valid poses of the touch; {LEAST_SAMPLES} are needed"
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
    return DigitisedPoint(middle, np.cov(points.T), len(points))
