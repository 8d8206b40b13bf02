"""How often two scans of one probe are said to differ: 5 % is what the test promises.

python -m benchmarks.comparison [--pairs 400] [--first 0] [--counts 6 8 10 20 50]
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.validation import compare

SCALE, IMAGE = 0.24, 500.0
COUNTS = (6, 8, 10, 20, 50)
# A shift of this much, in the differing pairs: what a test must find where it can.
SHIFT_MM = 5.0


def needle_scan(rng: np.random.Generator, truth: tuple, dimension: int, count: int) -> sc.Observations:
    """Needles at random places and tilts up to some 45 degrees; 1 px on points, 1 mm on both ends, no two rows alike.

    Args:
        rng: of everything random.
        truth: rotation (3, 3) and translation (3,), mm, of the probe.
        dimension: 2 or 3, of the image.
        count: sightings.
    """
    rotation, translation = truth
    seen = np.zeros((count, 3))
    seen[:, :dimension] = rng.uniform(0, IMAGE * SCALE, (count, dimension))
    along = np.concatenate([rng.normal(scale=0.6, size=(count, 2)), np.ones((count, 1))], axis=1)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    if dimension == 3:
        along = along @ Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    before = rng.uniform(60, 140, (count, 1))
    ends = np.stack([seen - before * along, seen + (200 - before) * along], axis=1)
    segments = ends @ rotation.T + translation + rng.normal(size=(count, 2, 3))
    points = seen[:, None] + np.array([0.0, 40.0])[: dimension - 1, None] * along[:, None]
    pixels = (points / SCALE + rng.normal(size=points.shape))[..., :dimension]
    frame = np.repeat(np.arange(count), dimension - 1)
    return sc.Observations(pixels.reshape(-1, dimension), segments[frame], frame=frame)


def pair(seed: int, dimension: int, counts: tuple[int, int], shift_mm: float = 0.0) -> float:
    """The p-value of two scans of one probe, whose marker moved by so much in between."""
    rng = np.random.default_rng([seed, dimension, *counts])
    rotation, translation = Rotation.random(random_state=seed).as_matrix(), rng.uniform(-100, 100, 3)
    truths = ((rotation, translation), (rotation, translation + shift_mm * rotation[:, 0]))
    size = (int(IMAGE),) * dimension
    found = [
        sc.calibrate(needle_scan(rng, truth, dimension, count), image_size_px=size, seed=seed)
        for truth, count in zip(truths, counts, strict=True)
    ]
    return compare(*found).p_value


def shares(seeds: range, dimension: int, counts: tuple[int, int], shift_mm: float = 0.0) -> tuple[float, int]:
    """The share of pairs that differ, and how many pairs there were: few sightings may be refused."""
    values = []
    for seed in seeds:
        try:
            values.append(pair(seed, dimension, counts, shift_mm))
        except sc.SonocalError:
            continue
    return float(np.mean(np.array(values) < 0.05)), len(values)


def main() -> None:
    """Print a line for each number of sightings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=400)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--counts", type=int, nargs="*", default=COUNTS)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.pairs)
    print(f"{'':4} {'sightings':>10} {'pairs':>6} {'differ':>8} {f'moved {SHIFT_MM:g} mm':>14}")
    for dimension in (2, 3):
        for counts in [(n, n) for n in arguments.counts] + [(8, 50)]:
            false, pairs = shares(seeds, dimension, counts)
            found, _ = shares(seeds[: len(seeds) // 4], dimension, counts, SHIFT_MM)
            print(
                f"{dimension}D {counts[0]:6} + {counts[1]:3} {pairs:6} {100 * false:6.1f} % {100 * found:12.0f} %"
            )


if __name__ == "__main__":
    main()
