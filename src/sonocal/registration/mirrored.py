"""Volumes and targets that are mirrored: they fit no similarity, and fit one once they are mirrored back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sonocal import _core
from sonocal.errors import DegenerateGeometryError, MirroredVolumeError, NoConsensusError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.constraints import Rows
from sonocal.registration.fit import Fit
from sonocal.registration.options import Options
from sonocal.registration.rows import PointLineRows

__all__ = [
    "far_more",
    "mirrored_finding",
    "refuse_mirrored_target",
    "refuse_mirrored_volume",
]

# Taken otherwise, this many times as many rows must agree as do as they stand: where most of all rows do, and where a
# part does, as of several candidates for one needle.
GAIN_OF_MOST, GAIN_OF_PART = 1.25, 2.0
# Of correspondences that nothing else is wrong with.
MOST_OF_TARGET = 0.8
# Of seven correspondences of which a fifth are wrong, so many samples find one without any but once in 100 000 times.
MIRRORED_SAMPLES = 50
# Of squared lengths: thinner than that, points are those of an image.
FLAT = 1e-12


def refuse_mirrored_volume(
    rows: PointLineRows,
    options: Options,
    best_count: int,
    fit: Callable[[PointLineRows, Options], Fit],
    *,
    least: int = 0,
) -> None:
    """Name the mirror where it is why rows of a volume were refused.

    Args:
        rows: points of a volume and their lines, which were refused.
        options: how they were to be fitted.
        best_count: how many of them agreed.
        fit: of rows, or a refusal.
        least: fewer rows than this prove nothing.

    Raises:
        MirroredVolumeError: mirrored, far more of the rows agree with one transform.
    """
    # Where rows fit nothing, their noise does not tell what agreeing is: any threshold would be wide enough.
    within_mm = Options().threshold_mm if options.threshold_mm == "auto" else options.threshold_mm
    try:
        other = fit(rows.mirrored(), replace(options, threshold_mm=within_mm))
    except (NoConsensusError, DegenerateGeometryError):
        return
    agreeing, count = int(np.count_nonzero(other.inlier)), len(rows)
    if agreeing < least or not far_more(agreeing, best_count, count):
        return
    found = mirrored_finding(agreeing, count, f"no more than {best_count} as they stand")
    raise MirroredVolumeError(f"{found.message}; {found.advice}", best_count=best_count).explained((found,))


def far_more(agreeing: int, before: int, count: int) -> bool:
    """Whether so many more of `count` rows agree, taken otherwise, than did before that they are to be taken so."""
    return agreeing > (GAIN_OF_MOST if 2 * agreeing > count else GAIN_OF_PART) * before


def refuse_mirrored_target(rows: Rows, options: Options, agreeing: int) -> None:
    """Name the mirror where few correspondences agree, and nearly all would when mirrored.

    Of a mirrored volume those agree that lie near a plane, or by chance: as many as of a set with many outliers.

    Args:
        rows: the correspondences.
        options: how they were fitted.
        agreeing: how many of them agree as they stand.

    Raises:
        MirroredVolumeError: mirrored, most of them do, and far more than as they stand.
    """
    count = len(rows.first) - 1
    if GAIN_OF_MOST * agreeing >= count or options.threshold_mm == "auto" or _is_flat(rows.points):
        return
    points = np.ascontiguousarray(rows.points * [1.0, 1.0, -1.0])
    table = _core.Table.of_planes(points, rows.planes, rows.first)
    few = replace(options, max_samples=MIRRORED_SAMPLES).to_core(0, 0)
    other = _core.estimate_correspondences(table, few, refine=True)
    if not other.found:
        return
    mirrored = int(np.count_nonzero(other.residuals_mm <= options.threshold_mm))
    if mirrored < MOST_OF_TARGET * count or not far_more(mirrored, agreeing, count):
        return
    raise MirroredVolumeError(
        f"the correspondences fit when one of the two sides is mirrored: {mirrored} of {count} agree then, and no more "
        f"than {agreeing} as they stand; one side is left-handed: turn one of its axes round",
        best_count=agreeing,
    )


def _is_flat(points: Array) -> bool:
    """Whether points (N, 3) are those of an image, which is its own mirror."""
    away = points - points.mean(axis=0)
    least, middle, _ = np.linalg.eigvalsh(away.T @ away / len(points))
    return bool(least <= FLAT * middle)


def mirrored_finding(agreeing: int, count: int, otherwise: str = "") -> Diagnostic:
    """The finding that a volume is mirrored.

    Args:
        agreeing: rows that agree when it is mirrored back.
        count: of how many.
        otherwise: how many do as they stand, in words.
    """
    beside = otherwise and f", and {otherwise}"
    return Diagnostic(
        code="flipped-image",
        severity="warning",
        message=(
            f"the volume fits when it is mirrored along one axis: {agreeing} of {count} rows agree then{beside}"
        ),
        advice="one axis of the volume runs the wrong way; check the order and the direction of u, v and w",
    )
