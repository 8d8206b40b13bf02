"""The axis of a tool in its marker's frame, from spinning the tool about it.

    R_i a = d                               a: axis in the tool's frame, d: in the tracker's
    (I - d d^T)(R_i c + t_i - q) = 0        c: a point of the axis, q: where it is in the tracker's frame

The mean rotation M has its largest singular value (1 for a perfect spin) along the axis: M a = d.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import DegenerateGeometryError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.tools.poses import checked_poses

__all__ = ["SpinCalibration", "calibrate_spin"]

LEAST_TURN_DEG = 10.0
GOOD_TURN_DEG = 60.0
LARGE_WOBBLE_DEG = 2.0
CUT = 4.0
FLOOR_RAD = 1e-9


@dataclass(frozen=True, eq=False)
class SpinCalibration:
    """The axis about which a tool was spun, and how far to trust it.

    Attributes:
        direction: (3,) unit, in the tool marker's frame; its sign has no meaning.
        point_mm: (3,) the point of the axis nearest the marker's origin.
        covariance: (3, 3) of the direction, rad^2; zero along it.
        wobble_deg: rms angle between the axis and where the poses put it.
        wobble_mm: rms distance of the axis' point from the line it should stay on.
        turn_deg: rms turn about the axis.
        inlier: (N,): the poses that agree; of those that are equal to the last digit the first.
        diagnostics: what to know before use.
    """

    direction: Array
    point_mm: Array
    covariance: Array
    wobble_deg: float
    wobble_mm: float
    turn_deg: float
    inlier: NDArray[np.bool_]
    diagnostics: tuple[Diagnostic, ...]

    __repr__ = brief


def calibrate_spin(
    tracker_from_tool: ArrayLike, valid: ArrayLike | None = None, source: str = "poses"
) -> SpinCalibration:
    """The axis of a tool that was spun about it, the axis at rest.

    Args:
        tracker_from_tool: (N, 4, 4).
        valid: (N,) which of them to use; default: all that are finite.
        source: what messages call the recording.

    Raises:
        InputError: too few distinct poses, or one is not rigid.
        DegenerateGeometryError: the tool hardly turned ("still"), or turned about more than one axis
            ("not-a-spin").
    """
    poses, used, repeats = checked_poses(tracker_from_tool, valid, source)
    rotations, places = poses[used, :3, :3], poses[used, :3, 3]
    axis, direction, agrees = _robust_axis(rotations)
    values = np.linalg.svd(rotations[agrees].mean(axis=0), compute_uv=False)
    turn = float(np.degrees(np.sqrt(max(1 - values[1] ** 2, 0.0))))
    wobble = np.linalg.norm(rotations[agrees] @ axis - direction, axis=1)
    wobble_deg = float(np.degrees(np.sqrt(np.mean(wobble**2))))
    _refuse(turn, wobble_deg, source)
    point, wobble_mm = _point(rotations[agrees], places[agrees], axis, direction)
    inlier = np.zeros(len(poses), dtype=bool)
    inlier[np.flatnonzero(used)[agrees]] = True
    covariance = _covariance(rotations[agrees], axis, direction)
    findings = (*repeats, *_findings(turn, wobble_deg, float(agrees.mean())))
    return SpinCalibration(axis, point, covariance, wobble_deg, wobble_mm, turn, inlier, findings)


def _robust_axis(rotations: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Axis in the tool's and tracker's frames, and the poses that agree; cut until the set is at rest."""
    agrees = np.ones(len(rotations), dtype=bool)
    axis = direction = np.zeros(3)
    for _ in range(30):
        u, _, vt = np.linalg.svd(rotations[agrees].mean(axis=0))
        axis, direction = vt[0], u[:, 0]
        error = np.linalg.norm(rotations @ axis - direction, axis=1)
        # Median of a Rayleigh distribution: 1.177 deviations.
        cut = max(CUT * float(np.median(error)) / 1.177, FLOOR_RAD)
        before, agrees = agrees, error <= cut
        if np.array_equal(before, agrees):
            break
    return axis, direction, agrees


def _refuse(turn: float, wobble_deg: float, source: str) -> None:
    if turn < LEAST_TURN_DEG:
        raise DegenerateGeometryError(
            f"{source}: the tool hardly turned ({turn:.1f} deg rms), so its axis is free; "
            "spin it by half a turn or more about its shaft",
            "still",
        )
    if wobble_deg > turn / 3:
        raise DegenerateGeometryError(
            f"{source}: the tool turned about more than one axis ({turn:.0f} deg rms about the best one, "
            f"{wobble_deg:.0f} deg across it); spin it about its shaft alone, the shaft in a guide",
            "not-a-spin",
        )


def _point(rotations: Array, places: Array, axis: Array, direction: Array) -> tuple[Array, float]:
    """The axis' point nearest the marker's origin, and the rms distance it moves across the axis."""
    across = np.eye(3) - np.outer(direction, direction)
    system = np.concatenate([across @ rotations, np.broadcast_to(-across, rotations.shape)], axis=2).reshape(
        -1, 6
    )
    target = -(places @ across.T).reshape(-1)
    # The shift along the axis is free; the least-norm solution has none of it in the point.
    solution = np.linalg.lstsq(system, target, rcond=1e-6)[0]
    left = (system @ solution - target).reshape(-1, 3)
    point = solution[:3] - axis * (axis @ solution[:3])
    return point, float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def _covariance(rotations: Array, axis: Array, direction: Array) -> Array:
    """(3, 3) of the axis: the wobble's spread over its information ``I - M^T M`` across the axis."""
    wobble = rotations @ axis - direction
    mean = rotations.mean(axis=0)
    information = np.eye(3) - mean.T @ mean
    n = len(rotations)
    sigma2 = float(np.sum(wobble**2)) / max(2 * n - 4, 1)
    values, vectors = np.linalg.eigh(information)
    inverse = (vectors[:, 1:] / values[1:]) @ vectors[:, 1:].T  # the first is the axis itself
    return np.asarray(sigma2 / n * inverse)


def _findings(turn: float, wobble_deg: float, agreeing: float) -> Iterator[Diagnostic]:
    if turn < GOOD_TURN_DEG / 2:
        yield Diagnostic(
            code="little-turn",
            severity="warning",
            message=f"the tool turned by {turn:.0f} deg rms only about its axis",
            advice="spin it by half a turn or more",
        )
    if wobble_deg > LARGE_WOBBLE_DEG:
        yield Diagnostic(
            code="wobbling-axis",
            severity="warning",
            message=f"the axis wobbles by {wobble_deg:.1f} deg rms while the tool spins",
            advice="hold the shaft in a guide while it spins",
        )
    if agreeing < 0.7:
        yield Diagnostic(
            code="many-outliers",
            severity="warning",
            message=f"{100 * (1 - agreeing):.0f} % of the poses do not share the axis and were left out",
            advice="leave out the stretch in which the shaft itself moved",
        )
