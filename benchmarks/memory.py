"""Peak memory of commands on a table, and on a recording, of 100 000 frames.

python -m benchmarks.memory [--frames 100000]

Each command is a process of its own; the table and the recording are simulated with no word in common with the code
under test. The recording's images are small and all alike: they are there to be counted, points are given.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import sonocal as sc
from benchmarks.simulators.scans import FRAMES_PER_S, NEEDLE_MM, Scan, scan
from sonocal.recording import ArrayFrames, ImageGeometry, Poses, Recording
from sonocal.recording.formats import write_recording

NEEDLE = f"""[[line]]
name = "needle"
frame = "Needle"
from_mm = [0.0, 0.0, 0.0]
to_mm = [0.0, 0.0, {NEEDLE_MM}]
"""


def needle_poses(made: Scan) -> NDArray[np.float64]:
    """(N, 4, 4): in the tracker's frame, of a needle that lies along its marker's third axis."""
    segments = made.observations.segments_mm
    along = segments[:, 1] - segments[:, 0]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along, [0.3, 0.5, 0.8])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    poses = np.tile(np.eye(4), (len(segments), 1, 1))
    poses[:, :3, :3] = np.stack([side, np.cross(along, side), along], axis=-1)
    poses[:, :3, 3] = segments[:, 0]
    return np.asarray(made.tracker_from_probe @ poses)


def write_files(folder: Path, frames: int) -> None:
    """A table, a recording with its needle, and the points in its images."""
    for dimension in (2, 3):
        sc.write_observations(
            scan(0, frames=frames, dimension=dimension).observations, folder / f"table{dimension}.csv"
        )
    made = scan(0, frames=frames)
    poses = (
        Poses.of("Probe", "Tracker", made.tracker_from_probe),
        Poses.of("Needle", "Tracker", needle_poses(made)),
    )
    image = np.zeros((1, 64, 64), dtype=np.uint8)
    recording = Recording(
        times=np.arange(frames) / FRAMES_PER_S,
        poses={one.name: one for one in poses},
        frames=ArrayFrames(np.broadcast_to(image, (frames, 64, 64))),
        image=ImageGeometry((64, 64), 1, "uint8", "MF", np.eye(4)),
    )
    write_recording(recording, folder / "sweep.igs.mha")
    (folder / "needle.toml").write_text(NEEDLE)
    points = np.column_stack([made.observations.frame, made.observations.points_px])
    np.savetxt(
        folder / "points.csv",
        points,
        fmt=["%d", "%.17g", "%.17g"],
        delimiter=",",
        header="frame,u_px,v_px",
        comments="",
    )


def peak(folder: Path, *arguments: str) -> tuple[float, float]:
    """Peak resident memory, MB, and processor time, s, of a command that must succeed."""
    child = subprocess.Popen(
        [sys.executable, "-m", "sonocal", *arguments], cwd=folder, stdout=subprocess.DEVNULL
    )
    _, status, used = os.wait4(child.pid, 0)
    child.returncode = os.waitstatus_to_exitcode(status)
    assert child.returncode == 0, arguments
    return used.ru_maxrss / 1024, used.ru_utime + used.ru_stime


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, default=100_000)
    frames = parser.parse_args(arguments).frames
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # Elsewhere: what this process holds would count as what its children do.
        apart = get_context("spawn").Process(target=write_files, args=(folder, frames))
        apart.start()
        apart.join()
        print(f"{frames} frames\n")
        print("| command | peak memory, MB | processor time, s |\n|---|---|---|")
        for command in (
            "calibrate table2.csv -o two",
            "validate two/calibration.json table2.csv",
            "calibrate table3.csv -o three",
            "info table2.csv",
            "info sweep.igs.mha",
            "calibrate sweep.igs.mha --lines needle.toml --points points.csv -o given",
        ):
            megabytes, seconds = peak(folder, *command.split())
            print(f"| `sonocal {command}` | {megabytes:.0f} | {seconds:.1f} |", flush=True)


if __name__ == "__main__":
    main()
