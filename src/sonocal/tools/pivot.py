"""Where the tip of a tool is in its marker's frame, from turning the tool about its resting tip.

    R_i tip + t_i = pivot        i = 1..N, [R_i t_i] = tracker_from_tool

Linear in (tip, pivot): least squares on the poses that agree (least median of squares over minimal
triples), reweighted to rest. The small residual that pivot calibrations report says little: a tool that
is hardly tilted, or turned about one axis only, fits any tip along that axis. What is refused and warned
of here is that.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sonocal.errors import DegenerateGeometryError, NoConsensusError
from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.recording.mistaken_poses import CHANGES
from sonocal.tools import pivot_fit as fit
from sonocal.tools.poses import (
    LEAST_POSES,
    checked_poses,
    refuse_little_tilt,
    refuse_still,
    rotation_spread_deg,
)

__all__ = ["PivotCalibration", "calibrate_pivot"]

# Rms spread of the tool's directions about the axis it turned least about, below which the tip's error is large.
GOOD_SPREAD_DEG = 10.0
GOOD_RMS_MM = 1.0
GOOD_INLIERS = 0.7
# A tip that half of the poses miss by more than this did not rest anywhere.
LOOSEST_MM = 5.0
REST = "rest the tip in one divot throughout"
# Of poses that were meant as something else, share a tip as that.
MOST_SHARE = 0.8
PARTS = 3


@dataclass(frozen=True, eq=False)
class PivotCalibration:
    """The tip of a tool, and how far to trust it.

    Attributes:
        tip_mm: (3,), in the tool marker's frame.
        pivot_mm: (3,), where the tip rested, in the tracker's frame.
        covariance: (6, 6) of (tip, pivot), mm^2; counts that neighbouring poses share their error.
        rms_mm, max_mm: distances of the tip from the pivot over the agreeing poses.
        inlier: (N,): the poses that agree; of those that are equal to the last digit the first.
        spread_deg: rms angle of the tool about the axis it turned least about.
        diagnostics: what to know before use.
    """

    tip_mm: Array
    pivot_mm: Array
    covariance: Array
    rms_mm: float
    max_mm: float
    inlier: NDArray[np.bool_]
    spread_deg: float
    diagnostics: tuple[Diagnostic, ...]

    __repr__ = brief

    @property
    def tip_deviation_mm(self) -> float:
        """Standard deviation of the tip's place, mm."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3])))

    @property
    def tip_95_mm(self) -> float:
        """How far the tip may be off along the direction in which it is known least, mm, in 95 of 100 cases."""
        return float(1.96 * np.sqrt(np.linalg.eigvalsh(self.covariance[:3, :3])[-1]))


def calibrate_pivot(
    tracker_from_tool: ArrayLike, valid: ArrayLike | None = None, seed: int = 0, source: str = "poses"
) -> PivotCalibration:
    """The tip of a tool that was turned about it.

    Args:
        tracker_from_tool: (N, 4, 4), in the order recorded.
        valid: (N,) which of them to use; default: all that are finite.
        seed: of the random triples.
        source: what messages call the recording.

    Raises:
        InputError: too few distinct poses, or one is not rigid.
        DegenerateGeometryError: the tool was still ("still") or hardly tilted ("little-tilt").
        NoConsensusError: less than half of the poses share a tip.
    """
    poses, used, repeats = checked_poses(tracker_from_tool, valid, source)
    rotations, places = poses[used, :3, :3], poses[used, :3, 3]
    refuse_still(rotations, source)
    start = fit.least_median(rotations, places, np.random.default_rng(seed), source)
    solution, agrees = fit.settled(rotations, places, *fit.reweighted(rotations, places, start))
    residuals = fit.residuals(rotations, places, solution)
    distance = np.linalg.norm(residuals, axis=1)
    _refuse_discord(distance, poses[used], source)
    spread = rotation_spread_deg(rotations[agrees])
    refuse_little_tilt(rotations[agrees], spread, source)
    inlier = np.zeros(len(poses), dtype=bool)
    inlier[np.flatnonzero(used)[agrees]] = True
    rms = float(np.sqrt(np.mean(distance[agrees] ** 2)))
    covariance = fit.covariance(rotations[agrees], residuals[agrees])
    tip, pivot = solution[:3], solution[3:]
    findings = _findings(
        rotations[agrees],
        residuals[agrees],
        rms=rms,
        agreeing=float(agrees.mean()),
        spread=spread,
        covariance=covariance,
    )
    return PivotCalibration(
        tip, pivot, covariance, rms, float(distance[agrees].max()), inlier, spread, (*repeats, *findings)
    )


def _refuse_discord(distance: Array, poses: Array, source: str) -> None:
    close = int((distance <= LOOSEST_MM).sum())
    if 2 * close < len(distance):
        how = _mistaken(poses, source)
        remedy = f"they do when they are {how}: write them as they are meant" if how else REST
        raise NoConsensusError(
            f"{source}: only {close} of {len(distance)} poses share a tip within {LOOSEST_MM:g} mm; {remedy}",
            close,
        )


def _mistaken(poses: Array, source: str) -> str | None:
    """What poses that share no tip may be meant as, in words: what most of them share one as."""
    for how, change in CHANGES.items():
        changed = change(poses)
        rotations, places = changed[:, :3, :3], changed[:, :3, 3]
        try:
            tip = fit.least_median(rotations, places, np.random.default_rng(0), source)
        except DegenerateGeometryError:
            continue
        distance = np.linalg.norm(fit.residuals(rotations, places, tip), axis=1)
        if np.mean(distance <= LOOSEST_MM) > MOST_SHARE:
            return how
    return None


def _findings(
    rotations: Array, residuals: Array, *, rms: float, agreeing: float, spread: float, covariance: Array
) -> Iterator[Diagnostic]:
    if spread < GOOD_SPREAD_DEG:
        deviation = float(np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]))
        yield _warning(
            "little-tilt",
            f"the tool was tilted by {spread:.1f} deg rms only: along one direction the tip is known to "
            f"+-{1.96 * deviation:.2g} mm however small the residual of {rms:.2f} mm",
            "pivot again with tilts of 30 deg or more to all sides",
        )
    if rms > GOOD_RMS_MM:
        yield _warning(
            "large-residual",
            f"the tip moves by {rms:.2f} mm rms about the pivot",
            "use a divot that holds the tip, and check that the marker is rigid on the tool",
        )
    if agreeing < GOOD_INLIERS:
        yield _warning(
            "many-outliers",
            f"{100 * (1 - agreeing):.0f} % of the poses do not share the tip and were left out",
            "look at the stretch they come from; pivot again if it is not the start or the end",
        )
    yield from _slip(rotations, residuals)


def _slip(rotations: Array, residuals: Array) -> Iterator[Diagnostic]:
    """A tip that moved during the recording: the pivot of its parts differs by more than they can tell."""
    if len(residuals) < PARTS * LEAST_POSES:
        return
    parts = np.array_split(np.arange(len(residuals)), PARTS)
    means = np.array([residuals[p].mean(axis=0) for p in parts])
    spread_mm = float(np.sqrt(np.mean([residuals[p].var(axis=0).sum() for p in parts])))
    moved = max(float(np.linalg.norm(a - b)) for a in means for b in means)
    if moved > max(2 * spread_mm, 0.3):
        yield _warning(
            "slipped-tip",
            f"the pivot lies {moved:.2f} mm apart in different thirds of the recording, where each third holds it to "
            f"{spread_mm:.2f} mm: the tip slipped or the marker moved",
            "pivot again without letting the tip leave its divot",
        )


def _warning(code: str, message: str, advice: str) -> Diagnostic:
    return Diagnostic(code=code, severity="warning", message=message, advice=advice)
