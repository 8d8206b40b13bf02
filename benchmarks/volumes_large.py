"""Volumes larger than the memory that they may take, in bricks, by threads."""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

import sonocal as sc
from sonocal.reconstruction import pieces
from sonocal.recording import Frames, ImageGeometry, Poses, Recording

LARGE_PX = 1024


class _Made(Frames):
    """Images that are made when they are asked for."""

    def __init__(self, count: int) -> None:
        self._count, self.shape, self.dtype = count, (LARGE_PX, LARGE_PX), np.dtype(np.uint8)
        self._base = np.random.default_rng(0).integers(0, 256, self.shape, dtype=np.uint8)

    def __len__(self) -> int:
        return self._count

    def read(self, index: int) -> Any:
        return np.roll(self._base, index, axis=0)


def _large_sweep(side: int, count: int) -> tuple[Recording, Any, dict[str, Any]]:
    """Images across a cube of so many voxels of 1 mm, tilted a little."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    c, n = np.cos(0.1), np.sin(0.1)
    poses[:, :3, :3] = [[c, 0, n], [0, 1, 0], [-n, 0, c]]
    poses[:, 2, 3] = np.linspace(0, side - 1, count)
    one = Poses.of("Probe", "Tracker", poses)
    frames = _Made(count)
    matrix = np.diag([side / LARGE_PX, side / LARGE_PX, 1.0, 1.0])
    recording = Recording(np.arange(count) / 30, frames, {one.name: one}, ImageGeometry.of(frames, 2, "MF"))
    bounds = [[0.0, 0, 0], [side - 1.0] * 3]
    mask = np.ones(frames.shape, dtype=bool)
    return recording, matrix, {"bounds_mm": bounds, "spacing_mm": 1.0, "mask": mask, "longest_gap_mm": 50.0}


def large(_: Any) -> None:
    """1200^3 voxels in a process of its own, and 400^3 in bricks against one piece."""
    code = "from benchmarks.volumes_large import peak; peak()"
    print(
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout,
        end="",
    )
    middling()


def middling() -> None:
    """400^3 voxels, in bricks against one piece, and by two threads against one."""
    recording, matrix, options = _large_sweep(400, 60)
    for mode in ("nearest", "linear", "between"):
        bricks = sc.reconstruct(recording, matrix, **options, interpolation=mode, speckle="kept")
        side, pieces.SIDE = pieces.SIDE, 400
        whole = sc.reconstruct(recording, matrix, **options, interpolation=mode, speckle="kept")
        pieces.SIDE = side
        print(
            f"large     400^3, {mode}: bricks and one piece equal: {np.array_equal(bricks.values, whole.values)}"
        )
    took, work = {}, {}
    for threads in (1, 2):
        start, before = time.perf_counter(), time.process_time()
        sc.reconstruct(recording, matrix, **options, interpolation="linear", threads=threads)
        took[threads], work[threads] = time.perf_counter() - start, time.process_time() - before
    print(
        f"large     two threads: {work[1]:.1f} s of processors by one, {work[2]:.1f} s by two; by the clock "
        f"{took[1] / took[2]:.2f} times one, which says something where nothing else runs"
    )


def peak() -> None:
    """1200^3 voxels into a file: the most memory that the process had."""
    recording, matrix, options = _large_sweep(1200, 120)
    with tempfile.TemporaryDirectory() as folder:
        volume = sc.reconstruct(recording, matrix, Path(folder) / "volume.mha", **options)
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        size = " x ".join(map(str, volume.grid.size))
        print(f"large     {size}, {volume.filled_share:.0%} filled: {most:.0f} MB at most")
