"""Do image and tracker belong to the same instant?"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.uncertainty import NORMAL_95
from sonocal.setup_checks.evidence import Evidence
from sonocal.setup_checks.motion import FEWEST_FRAMES, Motion, motion_of, ridged

__all__ = ["check_latency", "deviation_of", "latency_findings", "latency_of", "speed_of"]

BLOCKS = 12
LATENCY_SIGNIFICANT = 4.0
LEAST_LAG_MM = 0.3


def check_latency(evidence: Evidence) -> Iterator[Diagnostic]:
    """Do residuals follow the needle's speed, as they do when image and tracker are not of one instant?

        r_i = J_i d + latency P_i v_i        v_i: the needle's velocity in the probe's frame where it was seen

    Time is the extra column ``time_s`` where there is one, else the frame's number. The deviation is that of
    the estimate over stretches of the scan left out in turn, because residuals of neighbours go together.
    """
    motion = motion_of(evidence)
    if motion is not None:
        yield from latency_findings(motion, latency_of(motion))


def latency_of(motion: Motion) -> float:
    """The latency that explains most of the residuals; 0 where too few velocities are known."""
    if np.count_nonzero(motion.usable) < FEWEST_FRAMES:
        return 0.0
    size = motion.parameters + 2
    summed = motion.usable.astype(float) @ motion.moments.reshape(-1, size * size)
    return float(_solved(summed.reshape(1, size, size))[0])


def latency_findings(motion: Motion, latency: float) -> Iterator[Diagnostic]:
    """The finding of a latency that is large enough to matter and surer than chance."""
    speed = speed_of(motion)
    if not abs(latency) * speed > LEAST_LAG_MM:
        return
    deviation = deviation_of(motion)
    if not abs(latency) > LATENCY_SIGNIFICANT * deviation:
        return
    late = "tracker" if latency > 0 else "image"
    factor, name = (1e3, "ms") if motion.unit == "s" else (1.0, "frames")
    yield Diagnostic(
        code="latency",
        severity="warning",
        message=(
            f"residuals follow the needle's speed: the {late} is late by {abs(latency) * factor:.3g} {name} "
            f"(+-{NORMAL_95 * deviation * factor:.2g}), which moves the needle by {abs(latency) * speed:.1f} mm at its "
            f"usual speed of {speed:.0f} mm/{motion.unit.removesuffix('s') or 's'}"
        ),
        advice=f"shift the {late}'s stamps by that much, or scan slowly and hold still for each frame",
    )


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


def _solved(moments: Array) -> Array:
    """The latency (M,) of some sums (M, k + 2, k + 2) of moments: least squares, with the motions fitted too."""
    information, pull = moments[:, :-1, :-1], moments[:, :-1, -1]
    scale = 1.0 / np.sqrt(np.maximum(np.einsum("mkk->mk", information), np.finfo(float).tiny))
    scaled = ridged(information * scale[:, :, None] * scale[:, None, :])
    return np.asarray(np.linalg.solve(scaled, (pull * scale)[..., None])[:, -1, 0] * scale[:, -1])
