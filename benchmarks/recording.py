"""Speed and memory of reading recordings, beside SimpleITK in the same run.

    python benchmarks/recording.py

Prints a table; ratios are what to compare between machines. Times are the best of several rounds.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
import tracemalloc
from pathlib import Path

import numpy as np

from sonocal.recording import (
    ArrayFrames,
    ImageGeometry,
    Poses,
    Recording,
)
from sonocal.recording.formats import (
    read_recording,
    write_recording,
)

DATA = Path(__file__).parent.parent.parent / "shared" / "data" / "recordings"
REAL = "fCal_Test_Calibration_3NWires.igs.mha"
FRAMES, SIZE = 188, (820, 616)
TRACKER_ITEMS = 100_000
TABLE_ROWS = 200_000
ROUNDS = 5


def best(function):
    """The shortest of several rounds, s."""
    times = []
    for _ in range(ROUNDS):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def decode(path):
    """Every frame once, in order."""
    for frame in read_recording(path).frames:
        assert frame.shape  # decoded by now


def sweep(folder):
    """The real sweep, or one of the same size where the data are absent."""
    if (DATA / REAL).is_file():
        return DATA / REAL
    rng = np.random.default_rng(0)
    pixels = np.zeros((FRAMES, *SIZE[::-1]), dtype=np.uint8)
    pixels[:, 100:500, 200:600] = rng.integers(0, 80, (FRAMES, 400, 400))
    frames = ArrayFrames(pixels)
    image = ImageGeometry.of(frames, orientation="MFA")
    path = folder / "sweep.igs.mha"
    write_recording(Recording(times=np.arange(FRAMES) / 12, frames=frames, image=image), path)
    return path


def tracker_alone(folder):
    """A long recording of two tools without images."""
    rng = np.random.default_rng(0)
    matrices = np.tile(np.eye(4), (TRACKER_ITEMS, 1, 1))
    matrices[:, :3] += rng.normal(0, 1e-4, (TRACKER_ITEMS, 3, 4))
    status = ("OK",) * TRACKER_ITEMS
    valid = np.ones(TRACKER_ITEMS, dtype=bool)
    poses = [Poses(tool, "Tracker", matrices, valid, status) for tool in ("Probe", "Needle")]
    path = folder / "tracker.igs.mha"
    write_recording(Recording(times=np.arange(TRACKER_ITEMS) / 100, poses={p.name: p for p in poses}), path)
    return path


def table_of_poses(folder):
    """A table of one tool: a time, a quaternion, a place."""
    rng = np.random.default_rng(0)
    quaternions = rng.normal(size=(TABLE_ROWS, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    rows = np.column_stack(
        [np.arange(TABLE_ROWS) / 100, quaternions, rng.uniform(-500, 500, (TABLE_ROWS, 3))]
    )
    names = ",".join(["time_s", *(f"Probe_{k}" for k in ("qw", "qx", "qy", "qz", "x", "y", "z"))])
    path = folder / "poses.csv"
    np.savetxt(path, rows, fmt="%.9g", delimiter=",", header=names, comments="")
    return path


def processor_time_of_info(path):
    """Seconds of processor time that `sonocal info` takes, the start of Python with it; the least of some."""
    times = []
    for _ in range(ROUNDS):
        start = os.times()
        subprocess.run(
            [sys.executable, "-m", "sonocal", "info", str(path)], stdout=subprocess.DEVNULL, check=True
        )
        end = os.times()
        times.append(end.children_user - start.children_user + end.children_system - start.children_system)
    return min(times)


def simpleitk(path):
    """Seconds SimpleITK takes for the same pixels; NaN where it is not installed."""
    try:
        import SimpleITK
    except ImportError:
        return float("nan")
    return best(lambda: SimpleITK.GetArrayFromImage(SimpleITK.ReadImage(path)))


def streaming_peak(path):
    """Bytes allocated at most while every frame is decoded once, after the header is read."""
    recording = read_recording(path)
    tracemalloc.start()
    for frame in recording.frames:
        del frame  # what the caller keeps is the caller's
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak, recording.frames.frame_bytes


def without_zlib_ng(path):
    """The same with the standard library's inflate, in a process of its own."""
    code = (
        "import sys; sys.modules['zlib_ng'] = None\n"
        "sys.path.insert(0, sys.argv[1])\n"
        "import recording\n"
        "print(recording.best(lambda: recording.decode(sys.argv[2])))"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent), str(path)]
    return float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def main():
    """Measure and print."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    with tempfile.TemporaryDirectory() as name:
        path = sweep(Path(name))
        ours, plain, theirs = best(lambda: decode(path)), without_zlib_ng(path), simpleitk(path)
        print(f"{FRAMES} frames of {SIZE[0]} x {SIZE[1]}, zlib ({path.name})")
        print(f"  sonocal, zlib-ng          {ours:7.3f} s   {ours / theirs:5.2f} x SimpleITK")
        print(f"  sonocal, standard library {plain:7.3f} s   {plain / theirs:5.2f} x SimpleITK")
        print(f"  SimpleITK                 {theirs:7.3f} s")
        peak, frame = streaming_peak(path)
        print(
            f"  memory when streamed      {peak / 1e6:7.2f} MB  {peak / frame:5.2f} frames of {frame / 1e6:.2f} MB"
        )
        path = tracker_alone(Path(name))
        seconds = best(lambda: read_recording(path))
        print(f"{TRACKER_ITEMS} items of two tools, no images, {path.stat().st_size / 1e6:.0f} MB")
        print(f"  sonocal                   {seconds:7.2f} s")
        path = table_of_poses(Path(name))
        print(f"{TABLE_ROWS} poses in a CSV table, {path.stat().st_size / 1e6:.0f} MB")
        print(f"  sonocal info              {processor_time_of_info(path):7.2f} s of processor time")


if __name__ == "__main__":
    main()
