"""What the poses of a tool can tell: enough of them, rigid, and turned enough about every axis."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import DegenerateGeometryError, InputError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.recording.poses import FROZEN_RUN, RIGID_TOLERANCE, longest_run, repeated, rigidity_error

__all__ = [
    "LEAST_POSES",
    "LEAST_SPREAD_DEG",
    "checked_poses",
    "counted",
    "distinct_poses",
    "refuse_little_tilt",
    "refuse_still",
    "rotation_spread_deg",
    "turns_deg",
]

LEAST_POSES = 10
# Spread of the tool's directions about the axis it turned most around, degrees rms. Below it the tip cannot be
# told from its neighbours along that axis.
LEAST_SPREAD_DEG = 2.0
STILL_DEG = 1.0


def checked_poses(
    poses: ArrayLike, valid: ArrayLike | None, source: str
) -> tuple[Array, NDArray[np.bool_], tuple[Diagnostic, ...]]:
    """The poses as an array, which of them to use, and what to know of the others.

    Refuses too few and those that are not rigid.
    """
    array = np.asarray(poses, dtype=float)
    if array.ndim != 3 or array.shape[1:] != (4, 4):
        raise InputError(f"{source}: poses must have shape (N, 4, 4); got {array.shape}")
    usable = np.isfinite(array).all(axis=(1, 2))
    if valid is not None:
        usable &= np.asarray(valid, dtype=bool)
    used, findings = distinct_poses(array, usable, source)
    if used.sum() < LEAST_POSES:
        raise InputError(
            f"{source}: has {counted(used, usable)}; a tool calibration needs {LEAST_POSES}, better 200"
        )
    bent = used & ~(rigidity_error(array) <= RIGID_TOLERANCE)
    if bent.any():
        i = int(np.flatnonzero(bent)[0])
        raise InputError(
            f"{source}, frame {i}: its pose is not rigid (det R = {np.linalg.det(array[i, :3, :3]):.3g}); "
            "drop such frames with --on-invalid skip"
        )
    return array, used, findings


def distinct_poses(
    matrices: Array, usable: NDArray[np.bool_], source: str
) -> tuple[NDArray[np.bool_], tuple[Diagnostic, ...]]:
    """Of the poses (N, 4, 4) to use those that count: of some that are equal to the last digit the first.

    Returns:
        (N,) which they are, and what to know of the others.
    """
    used = usable.copy()
    used[usable] = ~repeated(matrices[usable])
    return used, tuple(_repeats(used, usable, source))


def _repeats(used: NDArray[np.bool_], usable: NDArray[np.bool_], source: str) -> Iterator[Diagnostic]:
    count, run = int(usable.sum() - used.sum()), longest_run(~used[usable])
    if not count:
        return
    yield Diagnostic(
        code="frozen-poses" if run >= FROZEN_RUN else "repeated-poses",
        severity="warning" if run >= FROZEN_RUN else "info",
        message=(
            f"{source}: {count} of {usable.sum()} poses repeat one that came before to the last digit, up to {run} in "
            "a row; each was counted once"
        ),
        advice="the tracker or recorder stalled there, or is slower than the recording: such poses are no measurements",
    )


def counted(used: NDArray[np.bool_], usable: NDArray[np.bool_]) -> str:
    """How many poses there are, and how many of them count."""
    repeats = "" if used.sum() == usable.sum() else f", {used.sum()} of them distinct (the tracker stalled)"
    return f"{usable.sum()} valid poses{repeats}"


def rotation_spread_deg(rotations: Array) -> float:
    """Rms angle by which the tool's axes moved about the direction in which they moved least, degrees.

    Zero for a still tool, and for one that turned about a single axis only. It is the square root of the
    smallest eigenvalue of ``I - M^T M``, M the mean rotation: what the poses tell of the tip.
    """
    return float(np.degrees(np.sqrt(_tip_information(rotations)[0][0])))


def turns_deg(rotations: Array) -> tuple[float, float, float]:
    """Rms angles, degrees, by which directions of the tool moved: that which moved least, a middle one, the most.

    All are next to nothing of a tool at rest; the first alone of one that turned about a single axis.
    """
    least, middle, most = np.degrees(np.sqrt(_tip_information(rotations)[0]))
    return float(least), float(middle), float(most)


def refuse_still(rotations: Array, source: str) -> None:
    """Refuse a tool that did not turn, for which any tip fits."""
    turned = float(np.degrees(np.sqrt(_tip_information(rotations)[0][2])))
    if turned < STILL_DEG:
        raise DegenerateGeometryError(
            f"{source}: the tool hardly turned ({turned:.2f} deg rms), so any tip fits; "
            "rest the tip in a divot and tilt the tool by 30 deg or more, to all sides",
            "still",
        )


def refuse_little_tilt(rotations: Array, spread: float, source: str) -> None:
    """Refuse a tool that turned about one axis only, along which its tip is free."""
    if spread < LEAST_SPREAD_DEG:
        axis = ", ".join(f"{x:.2f}" for x in _tip_information(rotations)[1][:, 0])
        raise DegenerateGeometryError(
            f"{source}: the tool turned about one axis only ({spread:.2f} deg rms across it), so the tip is free along "
            f"({axis}) of its marker; tilt it by 30 deg or more, to all sides",
            "little-tilt",
        )


def _tip_information(rotations: Array) -> tuple[Array, Array]:
    mean = rotations.mean(axis=0)
    values, vectors = np.linalg.eigh(np.eye(3) - mean.T @ mean)
    return np.clip(values, 0.0, None), vectors
