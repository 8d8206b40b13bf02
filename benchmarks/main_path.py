"""What the main path promises, measured: recovery, robustness and time.

python -m benchmarks.main_path [--scenes 10000] [--data FOLDER]
"""

from __future__ import annotations

import argparse
import functools
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import sonocal as sc
from sonocal.geometry import similarity_errors
from sonocal.simulation.scene import simulate_observations

REPEATS = 7


def noise_free(scenes: int, dimension: int) -> str:
    """Scenes whose matrix is recovered to 1e-6 (mm, mm/px) without noise."""
    worst = []
    for seed in range(scenes):
        scene = simulate_observations(dimension, 10, sigma_px=0, sigma_mm=0, seed=seed)
        found = sc.calibrate(scene.observations).probe_from_image.matrix
        worst.append(np.abs(found - scene.probe_from_image.matrix).max())
    return f"{sum(w < 1e-6 for w in worst)} of {scenes} (worst {max(worst):.1e})"


def gross_outliers(scenes: int, dimension: int) -> str:
    """Scenes off by more than 5 deg or 10 mm, with 1 px + 1 mm noise and 40 % gross outliers."""
    bad, angles, distances = 0, [], []
    for seed in range(scenes):
        scene = simulate_observations(dimension, 50, outlier_share=0.4, seed=seed)
        found = sc.calibrate(scene.observations).probe_from_image
        angle, distance, _ = similarity_errors(found, scene.probe_from_image)
        angles.append(np.degrees(angle))
        distances.append(distance)
        bad += bool(angles[-1] > 5 or distance > 10)
    return f"{bad} of {scenes} (worst {max(angles):.2f} deg, {max(distances):.2f} mm)"


def real_data(data: Path, name: str) -> str:
    """Errors and warnings on a recorded set."""
    path = data / "observations" / f"{name}.csv"
    if not path.exists():
        return f"skipped: no {path}"
    found = sc.calibrate(sc.read_observations(path), fit_split="calibration", test_split="validation")
    warned = ", ".join(d.code for d in found.warnings) or "none"
    assert found.test is not None
    return (
        f"fit {found.fit.rms_mm:.3f}, test {found.test.rms_mm:.3f} mm rms; "
        f"corner {found.predicted_errors()[2].max():.2f} mm (95 %); warnings: {warned}"
    )


def best_time(call: Callable[[], object], inner: int = 20) -> float:
    """Least mean time of a call over some repeats, s."""
    call()
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        for _ in range(inner):
            call()
        times.append((time.perf_counter() - start) / inner)
    return min(times)


def process_time(*arguments: str) -> float:
    """Median wall time of a fresh Python process, s."""
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        subprocess.run([sys.executable, *arguments], check=True, capture_output=True)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=10_000)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    options = parser.parse_args()

    def row(what: str, measured: str) -> None:
        print(f"{what:60s} {measured}", flush=True)

    for name in ("depth15_polaris", "fcal12_ascension", "trus_3nwires"):
        row(name, real_data(options.data, name))
    for dimension in (2, 3):
        row(f"noise-free, {dimension}D, recovered to 1e-6", noise_free(1000, dimension))
    for dimension in (2, 3):
        row(
            f"40 % gross outliers, {dimension}D, off by > 5 deg or 10 mm",
            gross_outliers(options.scenes, dimension),
        )
    for dimension, needles in ((2, 50), (3, 25)):
        rows = simulate_observations(dimension, needles, outlier_share=0.2).observations
        row(
            f"calibrate(), 50 rows, {dimension}D, 20 % outliers, warm",
            f"{best_time(functools.partial(sc.calibrate, rows)) * 1e3:.2f} ms",
        )
    numpy_alone = process_time("-c", "import numpy")
    row("import sonocal beyond NumPy", f"{process_time('-c', 'import sonocal') - numpy_alone:.3f} s")
    row("sonocal --help", f"{process_time('-m', 'sonocal', '--help'):.3f} s")
    with tempfile.TemporaryDirectory() as folder:
        row("sonocal demo", f"{process_time('-m', 'sonocal', 'demo', '-o', folder, '--overwrite'):.2f} s")


if __name__ == "__main__":
    main()
