"""How soon ctrl-C ends the core's long work.

python -m benchmarks.interrupt
"""

from __future__ import annotations

import argparse
import os
import signal
import threading
import time
from collections.abc import Callable

import numpy as np

import sonocal as sc
from sonocal.registration import solvers

AFTER_S = 0.5
REPEATS = 5


def seconds_to_stop(work: Callable[[], object]) -> float:
    """From the signal to the end of the work."""
    sent: list[float] = []

    def send() -> None:
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    threading.Timer(AFTER_S, send).start()
    try:
        work()
    except KeyboardInterrupt:
        return time.perf_counter() - sent[0]
    raise RuntimeError("the work was over before it could be ended")


def main() -> None:
    """Print the table."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    rng = np.random.default_rng(0)
    points, segments = rng.uniform(0, 500, (2000, 2)), 100 * rng.normal(size=(2000, 2, 3))
    rows = sc.Observations(points, segments)
    four = rng.normal(size=(3_000_000, 4, 2)), 100 * rng.normal(size=(3_000_000, 4, 2, 3))
    work: dict[str, Callable[[], object]] = {
        "random samples, 2000 rows": lambda: sc.calibrate(rows, max_samples=10**9, confidence=1 - 1e-12),
        "3 million minimal problems, one thread": lambda: solvers.paper_four_points(*four),
        "the same, two threads": lambda: solvers.paper_four_points(*four, threads=2),
    }
    print("| work | ended after, s, at the most |\n|---|---|")
    for name, one in work.items():
        print(f"| {name} | {max(seconds_to_stop(one) for _ in range(REPEATS)):.3f} |", flush=True)


if __name__ == "__main__":
    main()
