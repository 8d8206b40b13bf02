"""Did the marker slip during the scan?"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sonocal.findings import Diagnostic
from sonocal.geometry import Array
from sonocal.registration.noise import stretch_length
from sonocal.setup_checks.evidence import Evidence
from sonocal.setup_checks.latency import latency_of
from sonocal.setup_checks.motion import Motion, motion_of

__all__ = ["check_slip", "slip_findings"]

# Moments of the slip that are tried, and orders of the frames that chance is measured by.
SPLITS, ORDERS = 24, 399
LEAST_SLIP_MM = 1.0
# A slip taken away leaves most rows nearer to their lines, which a few outliers cannot feign.
LEAST_SHRINKING = 0.1
DRIFTING_FRAMES = 3
# How many orders are tried before a closer look at the step, which takes as long as four: without a slip one of
# them explains as much in two of three scans.
FIRST_BATCH = 2
IDENTITY = np.eye(9)
# Of the moments of all frames in one batch of orders: what bounds the memory of long scans.
MOST_NUMBERS = 4_000_000


@dataclass(frozen=True, eq=False)
class _Step:
    """A rigid step at each of some moments: the squares it explains beyond the fit, and its motion (S, 6)."""

    explained: Array
    motion: Array


def check_slip(evidence: Evidence, *, seed: int = 0) -> Iterator[Diagnostic]:
    """Did the marker move on the probe at some moment of the scan?

    After it, all lines are off by one rigid motion. For each of some moments the squares that such a motion
    explains, after the fit has taken its part, are compared with those of the same frames in random order: this
    allows for outliers, for errors that rows of a frame share, and for the choice of the best moment. What
    follows the needle's speed is taken off first: it is a latency's, and has its own order in time.

    Source: permutation test of a change point (Antoch and Huskova 2001).
    """
    motion = motion_of(evidence)
    if motion is not None:
        yield from slip_findings(motion, latency_of(motion), seed)


def slip_findings(motion: Motion, latency: float, seed: int) -> Iterator[Diagnostic]:
    """The finding of a step that is large, rigid, and larger than in any random order of the frames."""
    test = _ChangePoint(motion, latency)
    step = test.steps(None)
    best = int(np.argmax(step.explained))
    # What would come to nothing in any case needs no comparison with chance.
    if not _rms(motion.displaced[:, :, :6] @ step.motion[best]) > 0.99 * LEAST_SLIP_MM:
        return
    explained, by_chance = float(step.explained[best]), test.explained_by_chance(seed)
    if next(by_chance) >= explained:
        return
    split = int(test.splits[best])
    moved, share, drifts = _step(motion, latency, split)
    if drifts or moved < LEAST_SLIP_MM or share < LEAST_SHRINKING:
        return
    if any(more >= explained for more in by_chance):
        return
    yield Diagnostic(
        code="marker-slipped",
        severity="warning",
        message=(
            f"from about frame {motion.number[motion.frame == split][0]} on, all lines are off by one motion of "
            f"{moved:.1f} mm, without which the middle residual is {100 * share:.0f} % smaller"
        ),
        advice="fix the marker to the probe and scan again, or fit the frames before that one alone",
    )


class _ChangePoint:
    """The test's sums: J'J and J'r of each frame, (F, k (k + 1)), and what all frames have together."""

    def __init__(self, motion: Motion, latency: float) -> None:
        k, frames = motion.parameters, motion.frames
        # With the latency's share taken off the residuals: J'(r - latency v).
        pull = motion.moments[:, :k, k + 1] - latency * motion.moments[:, :k, k]
        packed = np.concatenate([motion.moments[:, :k, :k].reshape(-1, k * k), pull], axis=1)
        self._frames = motion.summed(packed, motion.frame)
        total = self._frames.sum(axis=0)
        diagonal = np.maximum(total[: k * k : k + 1], np.finfo(float).tiny)
        scale = 1.0 / np.sqrt(diagonal)
        self._frames = self._frames * np.concatenate([np.outer(scale, scale).ravel(), scale])
        self._k, self._scale, self._total = k, scale, self._frames.sum(axis=0)
        self._taken = _pseudo_inverse(self._total[: k * k].reshape(k, k))
        self.splits = _splits(frames)
        self._starts = np.concatenate([[0], self.splits])

    def steps(self, orders: NDArray[np.int64] | None) -> _Step:
        """The steps (..., S) in the frames' own order, or in each of some orders (M, F)."""
        k = self._k
        frames = self._frames if orders is None else self._frames[orders]
        parts = np.add.reduceat(frames, self._starts, axis=-2)
        after = self._total - np.cumsum(parts[..., :-1, :], axis=-2)
        n = after[..., : k * k].reshape(*after.shape[:-1], k, k)
        kept = IDENTITY[:6, :k] - n[..., :6, :] @ self._taken
        # g' (N - N H N)^-1 g over the frames after the split, of the first six motions.
        g = after[..., k * k : k * k + 6] - (n[..., :6, :] @ (self._taken @ self._total[k * k :]))
        left = kept @ n[..., :6]
        ridge = 1e-9 * np.trace(left, axis1=-2, axis2=-1)[..., None, None] + np.finfo(float).tiny
        motion = np.linalg.solve(left + ridge * IDENTITY[:6, :6], g[..., None])[..., 0]
        return _Step(np.einsum("...i,...i->...", g, motion), motion * self._scale[:6])

    def explained_by_chance(self, seed: int) -> Iterator[float]:
        """The most squares that any moment of any of some random orders explains, batch by batch.

        The batches grow: without a slip one of the first few orders explains as much as the frames' own.
        """
        rng, frames, done, size = np.random.default_rng(seed), len(self._frames), 0, FIRST_BATCH
        most = max(1, MOST_NUMBERS // self._frames.size)
        while done < ORDERS:
            size = min(size, most, ORDERS - done)
            orders = np.array([rng.permutation(frames) for _ in range(size)])
            yield float(self.steps(orders).explained.max())
            done, size = done + size, 2 * size


@lru_cache(maxsize=8)
def _splits(frames: int) -> NDArray[np.int64]:
    """The moments that are tried, as the numbers of frames before them."""
    return np.unique(np.linspace(0.15 * frames, 0.85 * frames, SPLITS).astype(np.int64))


def _pseudo_inverse(matrix: Array) -> Array:
    """Of a symmetric matrix (k, k) with a unit diagonal; motions that it leaves free count for nothing."""
    values, vectors = np.linalg.eigh(matrix)
    kept = values > 1e-10 * values[-1]
    return np.asarray((vectors[:, kept] / values[kept]) @ vectors[:, kept].T)


def _step(motion: Motion, latency: float, split: int) -> tuple[float, float, bool]:
    """The best rigid step at a split.

    Returns:
        How far, rms, it moves the places seen; by what share the median residual falls; whether neighbouring
        frames still repeat one another without it, as they do in a drift and not after a slip.
    """
    j, k = motion.jacobian, motion.parameters
    r = (motion.residuals - latency * motion.velocity).reshape(-1)
    late = (motion.frame >= split)[:, None, None]
    columns = np.concatenate([j, np.where(late, j[:, :, :6], 0.0)], axis=2).reshape(-1, k + 6)
    scale = 1.0 / np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)

    def solved(count: int) -> tuple[Array, Array]:
        part = columns[:, :count] * scale[:count]
        solution = np.linalg.lstsq(part, r, rcond=1e-6)[0]
        return solution * scale[:count], (r - part @ solution).reshape(-1, 3)

    before, (solution, after) = solved(k)[1], solved(k + 6)
    lengths = [stretch_length(left, motion.frame) for left in (before, after)]
    medians = [float(np.median(np.linalg.norm(left, axis=1))) for left in (before, after)]
    return (
        _rms(motion.displaced[:, :, :6] @ solution[k:]),
        1.0 - medians[1] / max(medians[0], np.finfo(float).tiny),
        lengths[1] > max(DRIFTING_FRAMES, lengths[0] / 2),
    )


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.einsum("ni,ni->", vectors, vectors) / len(vectors)))
