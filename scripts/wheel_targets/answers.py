"""Numbers that every build of the core must agree in, as JSON: run by each CPython, compared by check.py."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator

import numpy as np

import sonocal as sc
import sonocal.registration as reg
from sonocal import _core
from sonocal.detection import detect
from sonocal.registration import solvers
from sonocal.simulation.scene import simulate_observations
from sonocal.simulation.sweep import SweepOptions, simulate_sweep

SEEDS = range(5)


def calibrations() -> Iterator[np.ndarray]:
    """Matrices, covariances and noise of simulated scans, with outliers and without."""
    for seed in SEEDS:
        for dimension, outliers in ((2, 0.0), (2, 0.3), (3, 0.0), (3, 0.2)):
            scene = simulate_observations(dimension, 40, outlier_share=outliers, seed=seed)
            found = sc.calibrate(scene.observations)
            yield found.probe_from_image.matrix
            if found.covariance is not None:
                yield found.covariance


def registrations() -> Iterator[np.ndarray]:
    """Similarities of points on points, as another field asks for."""
    random = np.random.default_rng(1)
    for _ in SEEDS:
        source = random.uniform(-50, 50, (30, 3))
        target = 0.3 * source[:, [1, 2, 0]] + [1, 2, 3] + random.normal(scale=0.1, size=(30, 3))
        yield reg.register(reg.point_point(source, target)).target_from_source.matrix


def minimal_solutions() -> Iterator[np.ndarray]:
    """Sorted scales of all solutions of minimal problems, in batches that every kernel has its part in."""
    random = np.random.default_rng(2)
    points, segments = random.uniform(0, 500, (200, 4, 2)), random.normal(size=(200, 4, 2, 3)) * 100
    found = solvers.four_points(points, segments)
    yield np.sort(np.nan_to_num(np.linalg.norm(found.matrices[..., :3, 0], axis=-1)), axis=-1)
    image, needles = random.uniform(0, 500, (200, 2, 2, 3)), random.normal(size=(200, 2, 2, 3)) * 100
    found = solvers.two_lines(image, needles)
    yield np.sort(np.nan_to_num(np.linalg.norm(found.matrices[..., :3, 0], axis=-1)), axis=-1)


def detections() -> Iterator[np.ndarray]:
    """Points found in simulated images."""
    found = detect(simulate_sweep(options=SweepOptions(frames=6, seed=3)).recording)
    yield found.points_px[found.rank == 0]


def main() -> None:
    """Print what this build is and what it finds."""
    kinds = (calibrations, registrations, minimal_solutions, detections)
    numbers = {kind.__name__: np.concatenate([np.ravel(one) for one in kind()]).tolist() for kind in kinds}
    about = {"kernel": _core.kernel(), "machine": platform.machine(), "python": platform.python_version()}
    print(json.dumps({"about": about, "numbers": numbers}))


if __name__ == "__main__":
    main()
