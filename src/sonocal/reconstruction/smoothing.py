"""Poses of a moving probe, smoothed: a hand moves steadily, and what jumps from pose to pose is the tracker's noise.

    x = (place, speed),   x_k+1 = F x_k + noise of the hand,   pose_k = place_k + noise of the tracker

The hand's noise is that of a force that changes at random; how strong it is comes from the poses themselves, by the
greatest likelihood. Source: Rauch, Tung and Striebel, "Maximum likelihood estimates of linear dynamic systems", 1965.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sonocal.geometry import Array, AxisScaled
from sonocal.recording import Poses
from sonocal.recording.poses import poses_from_quaternions

__all__ = ["smoothed_poses"]

# Of the hand's noise, relative to the tracker's, from a probe that glides to one that shakes.
STRENGTHS = 10.0 ** np.arange(-6.0, 9.1, 0.5)
LEAST_POSES = 4


def smoothed_poses(poses: Poses, times: Array, noise_mm: float, noise_deg: float) -> Poses:
    """Poses with as much of the tracker's noise taken out as their steadiness allows; those not valid stay so.

    Args:
        poses: N of them, in the order of their times.
        times: (N,) s; of a recording without stamps poses count as one a second.
        noise_mm: the tracker's own, rms along each axis.
        noise_deg: the same about each axis.
    """
    rows = np.flatnonzero(poses.valid)
    if len(rows) < LEAST_POSES or (noise_mm == 0 and noise_deg == 0):
        return poses
    stamps = times[rows] if _increase(times[rows]) else rows.astype(float)
    matrices = poses.matrices[rows]
    places = _smoothed(matrices[:, :3, 3], stamps, noise_mm)
    # Of a small turn each part of the quaternion is half its angle; signs are such that neighbours are near.
    turns = _smoothed(_quaternions(matrices[:, :3, :3]), stamps, np.radians(noise_deg) / 2)
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    smooth = poses_from_quaternions(turns, places, poses.source, poses.target, "smoothed poses")
    changed = poses.matrices.copy()
    changed[rows] = smooth.matrices
    return Poses(poses.source, poses.target, changed, poses.valid, poses.status)


def _increase(times: Array) -> bool:
    return bool(np.isfinite(times).all() and (np.diff(times) > 0).all())


def _quaternions(rotations: Array) -> Array:
    quaternions = np.array([AxisScaled(r, np.zeros(3), np.ones(3)).quaternion_wxyz for r in rotations])
    turned = np.sign(np.sum(quaternions[1:] * quaternions[:-1], axis=1))
    quaternions[1:] *= np.cumprod(np.where(turned == 0, 1.0, turned))[:, None]
    return quaternions


@dataclass(frozen=True, eq=False)
class _Steps:
    """Of n poses, the way from each to the next.

    Attributes:
        forward: (n - 1, 2, 2), of place and speed.
        hand: (n - 1, 2, 2), covariance of what a hand of strength 1 adds.
    """

    forward: Array
    hand: Array

    @classmethod
    def of(cls, stamps: Array) -> _Steps:
        dt = np.diff(stamps)
        forward = np.tile(np.eye(2), (len(dt), 1, 1))
        forward[:, 0, 1] = dt
        hand = np.stack([dt**3 / 3, dt**2 / 2, dt**2 / 2, dt], axis=1).reshape(-1, 2, 2)
        return cls(forward, hand)


def _smoothed(values: Array, stamps: Array, sigma: float) -> Array:
    """Columns (n, d) that share their noise, smoothed by the hand that makes them likeliest."""
    if sigma == 0:
        return values.copy()
    typical = float(np.median(np.diff(stamps)))
    steps = _Steps.of((stamps - stamps[0]) / typical)
    likelihoods = [_filtered(values, steps, sigma, s * sigma**2)[0] for s in STRENGTHS]
    strength = STRENGTHS[int(np.argmax(likelihoods))] * sigma**2
    return _backward(steps, *_filtered(values, steps, sigma, strength)[1:])


def _filtered(
    values: Array, steps: _Steps, sigma: float, strength: float
) -> tuple[float, Array, Array, Array, Array]:
    """The log likelihood, and what is known before and after each pose: states (n, 2, d), covariances (n, 2, 2)."""
    n, d = values.shape
    before, after = np.zeros((n, 2, d)), np.zeros((n, 2, d))
    covariances, left = np.zeros((n, 2, 2)), np.zeros((n, 2, 2))
    spread = float(np.ptp(values, axis=0).max()) + sigma
    before[0, 0], covariances[0] = values[0], np.diag([spread**2, spread**2])
    likelihood = 0.0
    for k in range(n):
        if k:
            f = steps.forward[k - 1]
            before[k] = f @ after[k - 1]
            covariances[k] = f @ left[k - 1] @ f.T + strength * steps.hand[k - 1]
        total = covariances[k, 0, 0] + sigma**2
        off = values[k] - before[k, 0]
        gain = covariances[k, :, 0] / total
        after[k] = before[k] + gain[:, None] * off
        left[k] = covariances[k] - np.outer(gain, covariances[k, 0])
        if k > 1:  # place and speed are not known before
            likelihood -= 0.5 * (d * np.log(total) + float(off @ off) / total)
    return likelihood, before, after, covariances, left


def _backward(steps: _Steps, before: Array, after: Array, covariances: Array, left: Array) -> Array:
    """The places (n, d), by all poses before and after each."""
    states = after.copy()
    for k in range(len(after) - 2, -1, -1):
        gain = left[k] @ steps.forward[k].T @ np.linalg.inv(covariances[k + 1])
        states[k] += gain @ (states[k + 1] - before[k + 1])
    return np.asarray(states[:, 0])
