"""Targets that are too few to show by their residuals that they are not where they are said to be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.fit import Fit
from sonocal.registration.mapped import Mapped, MappedTargets
from sonocal.registration.noise import Noise
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.registration.unsure_places import unsure_places

__all__ = ["beside_unsure_places", "few_fixed_targets", "few_targets_finding"]

# An offset of each of three wires has six numbers that residuals can show, and a calibration takes up seven.
ENOUGH_TARGETS = 4
# Frames in which two are seen together, to say that they keep their places to one another; and how well they do: a
# tracker's noise leaves more than this of no phantom, and a hand moves two needles by more.
FEWEST_FRAMES, KEPT_MM, KEPT_RAD = 4, 0.5, 0.01


def few_fixed_targets(table: PointLineRows | TargetRows, inlier: NDArray[np.bool_]) -> int:
    """How many targets there are, if they are too few and keep their places to one another; else 0.

    A needle that is moved about is one target with as many places as it has poses: it never counts as few. What is
    unknown of the places of few planes is told by their rows (`beside_unsure_places`).

    Args:
        table: the fitted rows.
        inlier: (N,): those that agree.
    """
    if isinstance(table, TargetRows):
        return _few_of_mix(table, inlier)
    assert table.target is not None
    if table.target.max(initial=0) == 0:
        return 0
    used = np.unique(table.target[inlier])
    if not 1 < len(used) < ENOUGH_TARGETS:
        return 0
    others = (_kept_places(table, inlier, int(used[0]), int(other)) for other in used[1:])
    return len(used) if all(others) else 0


def few_targets_finding(count: int) -> Iterator[Diagnostic]:
    """The finding of so many targets that are too few, see `few_fixed_targets`; none of 0."""
    if not count:
        return
    yield Diagnostic(
        code="few-targets",
        severity="warning",
        message=(
            f"all rows are of {count} {'target' if count == 1 else 'targets that keep their places to one another'}: "
            "where what is scanned is not where the table says, the calibration takes it up and no residual shows it; "
            "no error can be predicted"
        ),
        advice=(
            f"scan {ENOUGH_TARGETS} targets or more, wires in different directions, each under a name of its own in "
            "the column target, or a needle that is moved about"
        ),
    )


def _few_of_mix(table: TargetRows, inlier: NDArray[np.bool_]) -> int:
    """As of lines; but targets that are not seen to move against one another count as fixed."""
    used = np.unique(table.target[inlier])
    if len(used) >= ENOUGH_TARGETS or _few_planes(table, inlier):
        return 0
    moves = any(_moved_apart(table, inlier, int(used[0]), int(other)) for other in used[1:])
    return 0 if moves else len(used)


def _few_planes(table: TargetRows, inlier: NDArray[np.bool_]) -> bool:
    few = len(np.unique(table.target[inlier])) < ENOUGH_TARGETS
    return bool(inlier.any() and few and np.all(table.spans[inlier] == 3))


def beside_unsure_places(noise: Noise, mapped: Mapped, fit: Fit) -> Noise:
    """The noise, with what few planes add to its covariance by not being where they are said to be.

    Args:
        noise: of the answer.
        mapped: the fitted rows under it.
        fit: the answer.
    """
    if not isinstance(mapped, MappedTargets) or not _few_planes(mapped.table, fit.inlier):
        return noise
    if not np.isfinite(noise.covariance).all():
        return noise
    return replace(noise, covariance=noise.covariance + unsure_places(mapped, fit))


def _moved_apart(table: TargetRows, inlier: NDArray[np.bool_], one: int, other: int) -> bool:
    """Whether what spans two targets comes nearer to or further from one another, in frames in which both are seen."""
    both = _together(table, inlier, one, other)
    if both is None:
        return False
    a, b = (spanning[:, 0] for spanning in both)
    return bool(np.ptp(np.linalg.norm(a - b, axis=1)) > KEPT_MM)


def _kept_places(table: PointLineRows, inlier: NDArray[np.bool_], one: int, other: int) -> bool:
    """Whether two targets have the same angle and distance in all frames in which both are seen."""
    both = _together(table, inlier, one, other)
    if both is None:
        return False
    angle, distance = _between(*both)
    return bool(np.ptp(angle) < KEPT_RAD and np.ptp(distance) < KEPT_MM)


def _together(
    table: PointLineRows | TargetRows, inlier: NDArray[np.bool_], one: int, other: int
) -> tuple[Array, Array] | None:
    """What spans two targets, (F, K, 3) each, in the frames in which both are seen; None where these are too few."""
    first, second = (_by_frame(table, inlier & (table.target == which)) for which in (one, other))
    frames = sorted(first.keys() & second.keys())
    if len(frames) < FEWEST_FRAMES:
        return None
    return (
        table.spanning_mm[[first[frame] for frame in frames]],
        table.spanning_mm[[second[frame] for frame in frames]],
    )


def _by_frame(table: PointLineRows | TargetRows, chosen: NDArray[np.bool_]) -> dict[int, int]:
    """A row of each frame."""
    assert table.frame is not None
    rows = np.flatnonzero(chosen)
    return dict(zip(table.frame[rows].tolist(), rows.tolist(), strict=True))


def _between(a: Array, b: Array) -> tuple[Array, Array]:
    """Angles (F,), rad, between segments (F, 2, 3), and distances (F,), mm, of one middle to the other line."""
    along_a, along_b = (x[:, 1] - x[:, 0] for x in (a, b))
    along_a, along_b = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (along_a, along_b))
    cosine = np.clip(np.abs(np.einsum("fi,fi->f", along_a, along_b)), 0.0, 1.0)
    apart = a.mean(axis=1) - b.mean(axis=1)
    across = apart - np.einsum("fi,fi->f", apart, along_b)[:, None] * along_b
    return np.arccos(cosine), np.linalg.norm(across, axis=1)
