"""Ways to a tip from one real recording of a pivot, beside the reference that comes with it.

    python -m benchmarks.pivot

481 poses of LSQRRecipes (../shared/data/pivot). Its test holds two answers: one from three poses alone (the first, the
middle and the last), which the data folder names as the reference, and least squares over all of them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation, Slerp

from sonocal.tools import calibrate_pivot

DATA = Path(__file__).parent.parent.parent / "shared" / "data" / "pivot" / "tool_poses.txt"
THREE_POSES = np.array([-18.586, 1.98134, -157.439])
LEAST_SQUARES = np.array([-17.7799, 1.1113, -156.865])
OUTLIERS = 0.3


def poses():
    """The recording: (N, 4, 4)."""
    table = np.loadtxt(DATA)
    matrices = np.tile(np.eye(4), (len(table), 1, 1))
    matrices[:, :3, :3] = Rotation.from_quat(table[:, 3:]).as_matrix()
    matrices[:, :3, 3] = table[:, :3]
    return matrices


def solve(matrices, whitening=None):
    """Tip and pivot (6,) in least squares; `whitening` (N, 3, 3) or (N,) weighs the equations of each pose."""
    system = np.concatenate([matrices[:, :3, :3], np.tile(-np.eye(3), (len(matrices), 1, 1))], axis=2)
    target = -matrices[:, :3, 3, None]
    if whitening is not None:
        w = whitening if whitening.ndim == 3 else whitening[:, None, None] * np.eye(3)
        system, target = w @ system, w @ target
    return np.linalg.lstsq(system.reshape(-1, 6), target.reshape(-1), rcond=None)[0]


def distances(matrices, solution):
    """(N,) mm: of the tip from the pivot."""
    return np.linalg.norm(matrices[:, :3, :3] @ solution[:3] + matrices[:, :3, 3] - solution[3:], axis=1)


def least_absolute(matrices):
    """The least sum of distances, by reweighting."""
    solution = solve(matrices)
    for _ in range(200):
        solution = solve(matrices, 1 / np.sqrt(np.maximum(distances(matrices, solution), 1e-3)))
    return solution


def cauchy(matrices):
    """A loss that hardly minds what lies beyond 0.2 mm."""
    start = solve(matrices)
    return least_squares(lambda x: distances(matrices, x), start, loss="cauchy", f_scale=0.2).x


def best_share(matrices, share):
    """Least squares over the share of poses that agree best, until they are the same."""
    solution = solve(matrices)
    for _ in range(50):
        distance = distances(matrices, solution)
        solution = solve(matrices[distance <= np.quantile(distance, share)])
    return solution


def rotation_noise(matrices, place_mm=0.1, turn_rad=0.002):
    """Poses weighed by the noise of place and rotation, which acts across the lever to the tip."""
    solution = solve(matrices)
    for _ in range(20):
        lever = matrices[:, :3, :3] @ solution[:3]
        across = (lever**2).sum(axis=1)[:, None, None] * np.eye(3) - lever[:, :, None] * lever[:, None, :]
        covariance = place_mm**2 * np.eye(3) + turn_rad**2 * across
        solution = solve(matrices, np.linalg.inv(np.linalg.cholesky(covariance)))
    return solution


def depth_noise(matrices, factor=3.0):
    """The tracker's depth axis counted as noisier, as optical trackers are."""
    return solve(matrices, np.tile(np.diag([1, 1, 1 / factor]), (len(matrices), 1, 1)))


def shifted(matrices, steps):
    """Rotations taken some samples later than places, as if their clocks differed."""
    at = np.arange(len(matrices)) + steps
    inside = (at >= 0) & (at <= len(matrices) - 1)
    moved = matrices[inside].copy()
    turns = Slerp(np.arange(len(matrices)), Rotation.from_matrix(matrices[:, :3, :3]))
    moved[:, :3, :3] = turns(at[inside]).as_matrix()
    return moved


def with_outliers(matrices, seed=0):
    """The recording with a share of its poses replaced by random ones."""
    rng = np.random.default_rng(seed)
    bad = rng.choice(len(matrices), int(OUTLIERS * len(matrices)), replace=False)
    spoiled = matrices.copy()
    spoiled[bad, :3, :3] = Rotation.random(len(bad), random_state=rng).as_matrix()
    spoiled[bad, :3, 3] = rng.uniform(-1500, 1500, (len(bad), 3))
    return spoiled


def sonocal(matrices):
    """What `sonocal tool` finds."""
    found = calibrate_pivot(matrices)
    return np.concatenate([found.tip_mm, found.pivot_mm])


def main():
    """Measure and print."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    real = poses()
    n = len(real)
    ways = {
        "three poses: first, middle, last": solve(real[[0, n // 2, n - 1]]),
        "least squares": solve(real),
        "sonocal": sonocal(real),
        f"sonocal, {OUTLIERS:.0%} random poses": sonocal(with_outliers(real)),
        "least sum of distances": least_absolute(real),
        "Cauchy loss, 0.2 mm": cauchy(real),
        "the best half": best_share(real, 0.5),
        "weighed by rotation noise": rotation_noise(real),
        "depth 3 x noisier": depth_noise(real),
    }
    print(f"{'way':34}{'tip, mm':>28}   from 3 poses: axis, all   from LSQ: all   rms, mm")
    for name, solution in ways.items():
        tip = solution[:3]
        rms = np.sqrt(np.mean(distances(real, solution) ** 2))
        off, far = np.abs(tip - THREE_POSES), np.linalg.norm(tip - LEAST_SQUARES)
        print(
            f"{name:34}{tip[0]:9.3f},{tip[1]:7.3f},{tip[2]:10.3f}{off.max():17.2f}{np.linalg.norm(off):7.2f}"
            f"{far:16.2f}{rms:10.3f}"
        )
    for steps in (-1.0, -0.5, -0.1, 0.0, 0.1, 0.5, 1.0):
        moved = shifted(real, steps)
        rms = np.sqrt(np.mean(distances(moved, solve(moved)) ** 2))
        print(f"rotations {steps:+.1f} samples against places: rms {rms:.3f} mm")
    rng = np.random.default_rng(0)
    triples = [solve(real[rng.choice(n, 3, replace=False)])[:3] for _ in range(2000)]
    off = np.linalg.norm(np.array(triples) - LEAST_SQUARES, axis=1)
    far = np.linalg.norm(THREE_POSES - LEAST_SQUARES)
    print(
        f"three random poses miss least squares by {np.median(off):.2f} mm (median), {np.mean(off > far):.0%} by more "
        f"than the {far:.2f} mm of the first, middle and last"
    )
    deviation = np.sqrt(np.diag(calibrate_pivot(real).covariance))[:3]
    print(f"sonocal's standard deviations: {', '.join(f'{x:.3f}' for x in deviation)} mm")


if __name__ == "__main__":
    main()
