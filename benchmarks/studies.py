"""What studies promise, measured: time, the core against SciPy, scale-out, and medians against public peers.

    python -m benchmarks.studies                    everything but the long row
    python -m benchmarks.studies --trials 1000000   and that one with a million trials

Times of two runs hardly compare; ratios are of one run.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np

from benchmarks import scipy_study
from sonocal.studies import Scene, Study, cluster, run_study, running
from sonocal.studies.measures import calibration_errors
from sonocal.studies.methods import run_method
from sonocal.studies.scene import BLOCK_TRIALS, simulate_block
from sonocal.studies.trials import run_trials

# SOLVERS.md's peers, the best of each column: medians of the rotation error, deg, over 100 runs.
PEERS_DEG = {(2, 10): 0.79, (2, 50): 0.30, (3, 10): 0.39, (3, 50): 0.195}
PEER_TRIALS = 2000
METHODS = {2: ["5point2D", "2line3D", "4point2D", "sonocal"], 3: ["3line3D", "2line3D", "sonocal"]}


def row(what: str, measured: str) -> None:
    """One line of the table."""
    print(f"{what:62s} {measured}", flush=True)


def paper_studies() -> str:
    """Both studies from the command line, Python's start and the figures included."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        for name in ("paper-2d", "paper-3d"):
            command = [sys.executable, "-m", "sonocal", "study", name, "-o", f"{folder}/{name}"]
            subprocess.run(command, check=True, capture_output=True)
            assert Path(folder, name, f"{name}.png").exists()
        return f"{time.perf_counter() - start:.1f} s"


def against_scipy(dimension: int, trials: int) -> str:
    """Trials a second of processor time of all methods at N = 10; and that both find the same."""
    scene = Scene(dimension=dimension, needles=10)
    methods = METHODS[dimension]
    block = simulate_block(scene, 0, 0, 0)
    sightings = np.repeat(np.arange(10), dimension - 1)
    medians = []
    start = time.process_time()
    for method in methods:
        found = [
            scipy_study.run(method, (block.points[i], block.segments[i], sightings, dimension), 5.0, i)[1]
            for i in range(trials)
        ]
        medians.append(median_rotation(scene, np.array(found), block.truth[:trials]))
    slow = (time.process_time() - start) / trials
    study = Study(name="x", title="", methods=methods, scene=scene, factors={"needles": [10]})
    (cell,) = study.cells()
    run_trials(cell, 0, 200)
    start = time.process_time()
    run_trials(cell, 0, 1000)
    fast = (time.process_time() - start) / 1000
    ours = [
        median_rotation(
            scene, run_method(m, scene, block, threshold_mm=5.0)[1][:trials], block.truth[:trials]
        )
        for m in methods
    ]
    same = ", ".join(
        f"{name} {mine:.3f} ({theirs:.3f})" for name, mine, theirs in zip(methods, ours, medians, strict=True)
    )
    return f"{slow / fast:.0f} x ({1 / fast:.0f} against {1 / slow:.1f} trials/s); medians, deg: {same}"


def median_rotation(scene: Scene, found: np.ndarray, truth: np.ndarray) -> float:
    return float(np.nanmedian(calibration_errors(scene, found, truth)[:, 0]))


def scaling(trials: int) -> None:
    """Local worker processes: one, then two; start-up aside. And what of it does not depend on other load."""
    study = Study(name="many", title="", trials=trials, methods=["sonocal"], factors={"needles": [10]})
    (cell,) = study.cells()
    start = time.process_time()
    run_trials(cell, 0, 2000)
    cpu = (time.process_time() - start) / 2000
    row(
        f"{trials} trials, processor time over two cores",
        f"{cpu * trials / 2:.0f} s ({1e6 * cpu:.0f} us a trial)",
    )
    seconds, busy = {}, {}
    for workers in (1, 2):
        # A share of the trials tells one worker's pace.
        done = trials if workers == 2 else min(trials, 100_000)
        with tempfile.TemporaryDirectory() as folder, cluster.local(workers) as who, timed_tasks() as tasks:
            run_study(msgspec.structs.replace(study, trials=1000), Path(folder) / "warm", who)
            tasks.clear()
            start = time.perf_counter()
            run_study(msgspec.structs.replace(study, trials=done), Path(folder) / "run", who)
            elapsed = time.perf_counter() - start
            seconds[workers], busy[workers] = elapsed / done, sum(tasks) / workers / elapsed
    row(f"{trials} trials, two local workers", f"{seconds[2] * trials:.0f} s; client {peak_mb():.0f} MB")
    row("efficiency of two workers against one", f"{seconds[1] / seconds[2] / 2:.2f}")
    row("share of their time that one and two workers are in tasks", f"{busy[1]:.2f}, {busy[2]:.2f}")


@contextmanager
def timed_tasks() -> Iterator[list[float]]:
    """Seconds of every task while the block runs."""
    seconds: list[float] = []
    learn = running._Queue.learn

    def noted(self, task, duration: float) -> None:
        seconds.append(duration)
        learn(self, task, duration)

    running._Queue.learn = noted
    try:
        yield seconds
    finally:
        running._Queue.learn = learn


def peak_mb() -> float:
    """This process's largest resident size."""
    import resource

    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def peers() -> None:
    """Medians of the rotation error: ours, of the paper's cost, which is the peers', and the peers' own.

    The peers' scenes are not kept. Where the image crosses a needle matters: its middle is known better than the
    rest, so both are shown.
    """
    for (dimension, needles), best in PEERS_DEG.items():
        for crossing in (0.0, 0.4):
            scene = Scene(dimension=dimension, needles=needles, crossing=crossing)
            blocks = [simulate_block(scene, 0, 0, block) for block in range(PEER_TRIALS // BLOCK_TRIALS)]
            errors = [
                calibration_errors(scene, run_method(method, scene, block, threshold_mm=5.0)[1], block.truth)[
                    :, 0
                ]
                for method in ("four_points" if dimension == 2 else "two_lines", "sonocal")
                for block in blocks
            ]
            geometric, ours = np.median(np.reshape(errors, (2, -1)), axis=1)
            row(
                f"median rotation, {dimension}D, N = {needles}, image within {crossing:g} of the middle",
                f"{ours:.3f} deg; paper's cost {geometric:.3f}; best peer {best}",
            )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=100_000, help="of the row on scale-out")
    parser.add_argument("--scipy-trials", type=int, default=50)
    options = parser.parse_args()
    row("paper-2d and paper-3d, figures included", paper_studies())
    peers()
    for dimension in (2, 3):
        row(
            f"all methods, {dimension}D, N = 10, one core, against SciPy",
            against_scipy(dimension, options.scipy_trials),
        )
    scaling(options.trials)


if __name__ == "__main__":
    main()
