"""Scans at and near the configurations that leave a motion free (paper section 7), with noise and known truth.

Shares no code with what is judged by them: rotations, transforms and noise are NumPy's.
"""

from __future__ import annotations

import dataclasses

import numpy as np

import sonocal as sc

IMAGE_PX, SCALE = 500.0, 0.24
# Degenerate in exact arithmetic; those of a volume need neither its plane nor its line.
DEGENERATE = {
    2: ("one-plane", "one-port", "one-direction", "one-image-line"),
    3: ("one-port", "one-direction"),
}


@dataclasses.dataclass
class Scan:
    """A table, and the 4 x 4 matrix, mm from px, that it was made with."""

    observations: sc.Observations
    truth: np.ndarray


def rotation_of(rng):
    """Uniformly distributed, by the polar way from normal numbers."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def tilted(rng, count, low_deg, high_deg):
    """Unit vectors so far from the third axis, to either side of it."""
    tilt, turn = np.radians(rng.uniform(low_deg, high_deg, count)), rng.uniform(0, 2 * np.pi, count)
    return np.column_stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])


def in_port(rng, count, crossing, spread_mm, away_mm):
    """Directions of needles through a port: its places are normal about it, rms from needle to port `spread_mm`."""
    middle = 0.5 * IMAGE_PX * SCALE
    port = np.array([middle + rng.uniform(-30, 30), middle + rng.uniform(-30, 30), away_mm])
    if crossing[:, 2].any():
        port[2] += IMAGE_PX * SCALE
    along = unit(port - crossing)
    aside = rng.normal(size=(count, 3)) * spread_mm / np.sqrt(2)
    return unit(port + aside - np.sum(aside * along, axis=1, keepdims=True) * along - crossing)


def ends_of(rng, crossing, along):
    """Tip and hub of needles that pass `crossing`: the tip 5 to 30 mm beyond it, 150 to 300 mm of needle."""
    beyond = rng.uniform(5, 30, (len(crossing), 1))
    length = rng.uniform(150, 300, (len(crossing), 1))
    return np.stack([crossing - beyond * along, crossing + (length - beyond) * along], axis=1)


def scan(seed, kind="sound", *, dimension=2, count=100, sigma_px=1.0, sigma_mm=0.5, spread=0.0, away_mm=60.0):
    """A scan of one kind.

    Args:
        seed: of everything random.
        kind: one of `DEGENERATE`, or "sound": tilts of 15 to 50 deg to all sides, places all over the image.
        dimension: 2 or 3, of the image.
        count: needles; in 3D two rows each.
        sigma_px: noise of a point along each axis.
        sigma_mm: noise of a segment's end along each axis.
        spread: how far from the configuration, rms: mm of the needles from the port or from the plane, degrees from
            the one direction, px of the image points from their line.
        away_mm: of the port from the image.
    """
    rng = np.random.default_rng(seed)
    crossing = np.zeros((count, 3))
    crossing[:, :dimension] = rng.uniform(0, IMAGE_PX * SCALE, (count, dimension))
    along = tilted(rng, count, 15, 50)
    if kind == "one-port":
        along = in_port(rng, count, crossing, spread, away_mm)
    elif kind == "one-direction":
        common = tilted(rng, 1, 0, 50)
        along = unit(common + np.radians(spread) / np.sqrt(2) * rng.normal(size=(count, 3)))
    elif kind in ("one-plane", "one-image-line"):
        crossing, along = flat(rng, kind, crossing, along, spread)
    segments = ends_of(rng, crossing, along)
    seen = crossing[:, None]
    if dimension == 3:
        seen = (
            crossing[:, None]
            + np.array([-1.0, 1.0])[:, None] * rng.uniform(10, 40, (count, 1, 1)) * along[:, None]
        )
    return observed(rng, dimension, seen, segments, (sigma_px, sigma_mm))


def flat(rng, kind, crossing, along, spread):
    """Places on one line of the image, at any angle; needles in the plane that stands on it, or free."""
    turn = rng.uniform(0, np.pi)
    line, across = np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
    middle = rng.uniform(0.2, 0.8, 2) * IMAGE_PX * SCALE
    offset = spread * (SCALE if kind == "one-image-line" else 1) * rng.normal(size=(len(crossing), 1))
    crossing = np.r_[middle, 0] + rng.uniform(-50, 50, (len(crossing), 1)) * line + offset * across
    if kind == "one-plane":
        lean = np.radians(rng.uniform(-30, 30))  # the plane may lean over the image
        upright = np.cos(lean) * np.array([0, 0, 1]) + np.sin(lean) * across
        tilt = np.radians(rng.uniform(-50, 50, (len(crossing), 1)))
        along = np.sin(tilt) * line + np.cos(tilt) * upright
    return crossing, along


def observed(rng, dimension, seen, segments, noise):
    """From places (N, P, 3) and segments (N, 2, 3) in the image, mm, to a table with noise, (px, mm)."""
    sigma_px, sigma_mm = noise
    turn, shift = rotation_of(rng), rng.uniform(-100, 100, 3)
    truth = np.eye(4)
    truth[:3, :3], truth[:3, 3] = SCALE * turn, shift
    count, per_needle = seen.shape[:2]
    points = seen[..., :dimension] / SCALE + sigma_px * rng.normal(size=(count, per_needle, dimension))
    ends = segments @ turn.T + shift + sigma_mm * rng.normal(size=segments.shape)
    frame = np.repeat(np.arange(count), per_needle)
    observations = sc.Observations(points.reshape(-1, dimension), ends[frame], frame=frame, source="scan")
    return Scan(observations, truth)


def corner_errors(found, truth, dimension):
    """(2^d,), mm: how far the corners of the true image are off."""
    corners = np.zeros((2**dimension, 4))
    corners[:, :dimension] = np.indices((2,) * dimension).reshape(dimension, -1).T * (IMAGE_PX - 1)
    corners[:, 3] = 1
    return np.linalg.norm((corners @ (found - truth).T)[:, :3], axis=1)
