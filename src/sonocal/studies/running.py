"""Running a study: what is missing is cut into tasks of about a second, done by whoever is there, and kept."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sonocal.errors import UnsupportedError, require
from sonocal.geometry import Array
from sonocal.geometry.shown import brief
from sonocal.studies.definition import Cell, Study
from sonocal.studies.scene import BLOCK_TRIALS
from sonocal.studies.store import Store
from sonocal.studies.trials import run_trials

__all__ = ["Workers", "program_version", "run_study", "threads"]

TASK_SECONDS = 1.0
MOST_BLOCKS = 500
# So many tasks a worker are under way: the next one is there when one ends, and few results wait in memory.
TASKS_A_WORKER = 2

Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class Workers:
    """Who does the tasks: anything that behaves like `concurrent.futures.Executor`, and how many it has now."""

    executor: Executor
    count: Callable[[], int]

    __repr__ = brief


@dataclass(frozen=True)
class _Task:
    index: int
    cell: Cell
    first: int
    last: int


@contextmanager
def threads() -> Iterator[Workers]:
    """All cores of this machine: the core releases the interpreter's lock while it works."""
    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    executor = ThreadPoolExecutor(count)
    try:
        yield Workers(executor, lambda: count)
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def run_study(
    study: Study, folder: str | Path, workers: Workers, *, progress: Progress = lambda done, total: None
) -> Store:
    """Do what a folder does not hold yet of a study.

    Results do not depend on who does the tasks, in which order, or on how often the run was interrupted.

    Args:
        study: to run.
        folder: of its results; made if absent, continued if it holds a part of this study.
        workers: who does the tasks.
        progress: called with the trials done and all trials.

    Returns:
        The store, complete.

    Raises:
        InputError: the folder holds something else, or cannot be written.
        UnsupportedError: a worker runs another version of sonocal.
    """
    require("study", study, Study)
    version = program_version()
    store = Store(Path(folder), study, version)
    queue = _Queue(study, store)
    total = study.trials * len(queue.cells)
    pending: dict[Future[_Done], _Task] = {}
    try:
        progress(total - queue.left, total)
        while True:
            count = workers.count()
            while len(pending) < TASKS_A_WORKER * count and (task := queue.next(count)):
                pending[workers.executor.submit(_do, task.cell, task.first, task.last)] = task
            if not pending:
                break
            for future in wait(pending, return_when=FIRST_COMPLETED).done:
                task, done = pending.pop(future), future.result()
                if done.version != version:
                    raise UnsupportedError(
                        f"a worker runs sonocal {done.version} and this is {version}; install the same version on all"
                    )
                store.write(task.index, task.first, task.last, done.results)
                queue.learn(task, done.seconds)
                progress(total - queue.left, total)
    finally:
        for future in pending:
            future.cancel()
    store.finish()
    return store


def program_version() -> str:
    """What makes the numbers: results of unlike versions are never mixed."""
    from importlib.metadata import version

    return version("sonocal")


@dataclass(frozen=True)
class _Done:
    results: dict[str, Array]
    seconds: float
    version: str


def _do(cell: Cell, first: int, last: int) -> _Done:
    start = time.perf_counter()
    results = run_trials(cell, first, last)
    return _Done(results, time.perf_counter() - start, program_version())


class _Queue:
    """Cuts what is missing into tasks; a cell's first task is one block, which tells how long the rest takes."""

    def __init__(self, study: Study, store: Store) -> None:
        self.cells = study.cells()
        self._runs = [store.missing(index) for index in range(len(self.cells))]
        self._seconds: dict[int, float] = {}  # of a block
        self._waiting: set[int] = set()  # cells whose first task is under way
        self.left = sum(last - first for runs in self._runs for first, last in runs)

    def next(self, workers: int) -> _Task | None:
        """The next task: of a cell whose time is known or asked for first, otherwise more of any."""
        for index, runs in enumerate(self._runs):
            if not runs or index in self._waiting:
                continue
            return self._cut(index, workers)
        for index, runs in enumerate(self._runs):
            if runs:
                return self._cut(index, workers)
        return None

    def learn(self, task: _Task, seconds: float) -> None:
        """A task is done."""
        blocks = -(-(task.last - task.first) // BLOCK_TRIALS)
        self._seconds[task.index] = seconds / blocks
        self._waiting.discard(task.index)
        self.left -= task.last - task.first

    def _cut(self, index: int, workers: int) -> _Task:
        first, last = self._runs[index].pop(0)
        blocks = 1
        if index in self._seconds:
            blocks = round(TASK_SECONDS / max(self._seconds[index], 1e-9))
            # The last tasks are shared out, so that no worker is left with a long one.
            share = -(-(last - first) // BLOCK_TRIALS) // (TASKS_A_WORKER * workers)
            blocks = max(1, min(blocks, share, MOST_BLOCKS))
        else:
            self._waiting.add(index)
        end = min(last, first + blocks * BLOCK_TRIALS)
        if end < last:
            self._runs[index].insert(0, (end, last))
        return _Task(index, self.cells[index], first, end)
