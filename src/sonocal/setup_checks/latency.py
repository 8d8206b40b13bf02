"""Do image and tracker belong to the same instant?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.noise import stretch_length
from sonocal.registration.uncertainty import NORMAL_95
from sonocal.setup_checks.evidence import Evidence
from sonocal.setup_checks.motion import FEWEST_FRAMES, Motion, motion_of, ridged

__all__ = [
    "LEAST_LAG_MM",
    "beyond_tolerance",
    "check_latency",
    "deviation_of",
    "gain_of",
    "in_words",
    "is_significant",
    "latency_finding",
    "latency_findings",
    "latency_of",
    "speed_of",
]

BLOCKS = 12
# Standard deviations of a lag that is no chance.
SIGNIFICANT_LAG = 4.0
# Where residuals go together over more frames than this without the lag, the tracker drifts, stretches are no more each
# other's witnesses, and twice the deviations are asked for.
TOGETHER_FRAMES, OF_A_DRIFT = 4, 2.0
LEAST_LAG_MM = 0.3


def check_latency(evidence: Evidence) -> Iterator[Diagnostic]:
    """Do residuals follow the needle's speed, as they do when image and tracker are not of one instant?

        r_i = J_i d + latency P_i v_i        v_i: the needle's velocity in the probe's frame where it was seen

    Time is the extra column ``time_s`` where there is one, else the frame's number. The deviation is that of
    the estimate over stretches of the scan left out in turn, because residuals of neighbours go together.
    """
    motion = motion_of(evidence)
    if motion is not None:
        yield from latency_findings(motion, latency_of(motion), evidence.tolerance_mm)


def latency_of(motion: Motion) -> float:
    """The latency that explains most of the residuals; 0 where too few velocities are known."""
    if np.count_nonzero(motion.usable) < FEWEST_FRAMES:
        return 0.0
    size = motion.parameters + 2
    summed = motion.usable.astype(float) @ motion.moments.reshape(-1, size * size)
    return float(_solved(summed.reshape(1, size, size))[0])


def latency_findings(motion: Motion, latency: float, tolerance_mm: float) -> Iterator[Diagnostic]:
    """The finding of a latency that is large enough to matter and surer than chance."""
    speed = speed_of(motion)
    if not abs(latency) * speed > LEAST_LAG_MM:
        return
    deviation = deviation_of(motion)
    left = motion.residuals - latency * motion.velocity
    if not is_significant(motion, latency, deviation, left):
        return
    words = in_words(latency, deviation, motion.unit, speed)
    yield latency_finding(f"residuals follow the needle's speed: {words}", latency, motion.unit)
    moved_mm = abs(latency) * speed
    if moved_mm > tolerance_mm:
        yield beyond_tolerance(f"the lag moves the needle by {moved_mm:.1f} mm", tolerance_mm)


def is_significant(
    motion: Motion, latency: float, deviation: float, left: Array, *, may_drift: bool = True
) -> bool:
    """Whether a latency is more than chance, given the residuals (N, 3) that it leaves."""
    drifts = may_drift and stretch_length(left[motion.usable], motion.frame[motion.usable]) > TOGETHER_FRAMES
    return abs(latency) > SIGNIFICANT_LAG * deviation * (OF_A_DRIFT if drifts else 1.0)


def speed_of(motion: Motion) -> float:
    """Root mean square, of the velocities that are known."""
    return float(
        np.sqrt(np.einsum("ni,ni->", motion.velocity, motion.velocity) / max(motion.usable.sum(), 1))
    )


def deviation_of(motion: Motion) -> float:
    """Of the latency, over stretches of the scan left out in turn."""
    blocks = motion.frame[motion.usable] * BLOCKS // motion.frames
    moments = motion.moments[motion.usable].reshape(len(blocks), -1)
    parts = (np.arange(BLOCKS)[:, None] == blocks).astype(float) @ moments
    size = motion.parameters + 2
    folds = _solved(((1.0 - np.eye(BLOCKS)) @ parts).reshape(BLOCKS, size, size))
    return float(np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((folds - folds.mean()) ** 2)))


def gain_of(motion: Motion, rows: NDArray[np.bool_]) -> float:
    """How many times a row's share of the squares a latency takes from the residuals of some rows (N,).

    What an F test of it would compare, were the residuals independent. Rows that were left out are no witnesses: few
    of them hide a slow hand's lag among their own errors.
    """
    chosen = rows & motion.usable
    size = motion.parameters + 2
    summed = motion.moments[chosen].sum(axis=0)
    freedom = 2 * int(np.count_nonzero(chosen)) - size + 1
    if freedom <= 0:
        return 0.0
    kept = np.delete(np.arange(size), -2)
    without, left = _left(summed[np.ix_(kept, kept)]), _left(summed)
    return (without - left) * freedom / max(left, float(np.finfo(float).tiny))


def _left(moments: Array) -> float:
    """Sum of the squares that least squares leave of the last column, by the others' (k + 1, k + 1) moments."""
    information, pull = moments[:-1, :-1], moments[:-1, -1]
    scale = 1.0 / np.sqrt(np.maximum(np.diagonal(information), np.finfo(float).tiny))
    scaled = ridged(information * scale[:, None] * scale)
    return float(moments[-1, -1] - (pull * scale) @ np.linalg.solve(scaled, pull * scale))


def _solved(moments: Array) -> Array:
    """The latency (M,) of some sums (M, k + 2, k + 2) of moments: least squares, with the motions fitted too."""
    information, pull = moments[:, :-1, :-1], moments[:, :-1, -1]
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("mkk->mk", information), np.finfo(float).tiny))
    scaled = ridged(information * scale[:, :, None] * scale[:, None, :])
    return np.asarray(np.linalg.solve(scaled, (pull * scale)[..., None])[:, -1, 0] * scale[:, -1])


def latency_finding(message: str, value: float, unit: str, known_s: float = 0.0) -> Diagnostic:
    """The finding of a latency, with how to undo it.

    Args:
        message: what was found.
        value: the latency, in units of time.
        unit: "s" or "frames".
        known_s: latency that was undone before: what is asked for is the whole.
    """
    what = (
        f"--latency {value + known_s:.3f}" if unit == "s" else "--latency, that many frames' time in seconds"
    )
    return Diagnostic(
        code="latency",
        severity="warning",
        message=message,
        advice=(
            f"calibrate the recording with {what} (a table: made anew, of poses so much later than their images), or "
            "scan slowly and hold still for each frame"
        ),
    )


def beyond_tolerance(what: str, tolerance_mm: float) -> Diagnostic:
    """The finding that makes an answer one not to be used."""
    return Diagnostic(
        code="latency-beyond-tolerance",
        severity="warning",
        message=f"{what}, more than the {tolerance_mm:g} mm accepted",
        advice="undo the lag and calibrate again",
    )


def in_words(value: float, deviation: float, unit: str, speed: float) -> str:
    """Which of the two is late, by how much, and what that does."""
    late = "tracker" if value > 0 else "image"
    factor, name = (1e3, "ms") if unit == "s" else (1.0, "frames")
    each = unit.removesuffix("s") or unit
    return (
        f"the {late} is late by {abs(value) * factor:.3g} {name} (+-{NORMAL_95 * deviation * factor:.2g}), which moves "
        f"the needle by {abs(value) * speed:.1f} mm at its usual speed of {speed:.2g} mm/{each}"
    )
