"""Whether the stated error holds where tracking errs slowly: coverage of the bound at the image's corners.

    python -m benchmarks.drift [--seeds 100] [--first 1000] [--rows WORD]

A row is a kind of error; "covered" is the share of image corners that are off by less than the 95 % that is predicted,
over scans that came without `drifting-residuals`, over those with, and over all; then with what a recording's poses add
(`offset-in-tracker`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

import sonocal as sc
from benchmarks.simulators.drifts import FRAMES_PER_S, IMAGE_PX, Drifting, drifting_scan
from sonocal.recording import Poses, Recording
from sonocal.sweep.tabulate import Posing
from sonocal.sweep.tracker_offset import with_tracker_offset

WARNING = "drifting-residuals"


def rows() -> Iterator[tuple[str, dict[str, Any]]]:
    """What is simulated, by name."""
    for dimension in (2, 3):
        for frames in (100, 300, 1000):
            yield f"{dimension}D, N = {frames}, none", {"dimension": dimension, "frames": frames}
        for frames in (20, 50, 200):
            stills = {"dimension": dimension, "frames": frames, "still": True}
            yield f"{dimension}D, N = {frames}, none, stills", stills
        for memory in (3, 10, 30):
            for frames in (100, 300, 1000, 2000):
                drift = {"dimension": dimension, "frames": frames, "memory": memory, "drift_mm": 0.5}
                yield f"{dimension}D, N = {frames}, AR(1) of {memory} frames", drift
        for name, more in OTHERS.items():
            yield f"{dimension}D, N = 300, {name}", {"dimension": dimension, "frames": 300, **more}


OTHERS: dict[str, dict[str, Any]] = {
    "AR(1) of 3, ends apart": {"memory": 3, "drift_mm": 1.0, "both_ends": False},
    "AR(1) of 3, 2 mm": {"memory": 3, "drift_mm": 2.0},
    "AR(1) of 3, 0.2 mm": {"memory": 3, "drift_mm": 0.2},
    "AR(1) of 10, stills": {"memory": 10, "drift_mm": 0.5, "still": True},
    "random walk to 1 mm": {"memory": np.inf, "drift_mm": 1.0},
    "distortion 1 mm": {"distortion_mm": 1.0},
    "distortion 2 mm": {"distortion_mm": 2.0},
    "sag 1 mm": {"sag_mm": 1.0},
    "sag 3 mm": {"sag_mm": 3.0},
    "every frame three times": {"repeats": 3},
}


def off_and_bound(scan: Drifting, found: sc.Calibration) -> tuple[np.ndarray, np.ndarray]:
    """How far off the corners are, and the 95 % bound there (mm)."""
    places, _, bound = found.predicted_errors()
    homogeneous = np.zeros((len(places), 4))
    homogeneous[:, : places.shape[1]], homogeneous[:, 3] = places, 1.0
    there = (homogeneous @ scan.probe_from_image.T)[:, :3]
    off = np.linalg.norm(found.probe_from_image @ places - there, axis=1)
    return off[:-1], bound[:-1]


def recording_of(scan: Drifting) -> Recording:
    """The probe's poses."""
    poses = Poses.of("Probe", "Tracker", scan.tracker_from_probe)
    return Recording(times=np.arange(len(scan.tracker_from_probe)) / FRAMES_PER_S, poses={poses.name: poses})


def one_row(settings: dict[str, Any], seeds: range) -> str:
    """The table's cells of one kind."""
    ratios, with_poses, warned, others, wide, offsets = [], [], [], 0, [], 0
    for seed in seeds:
        scan = drifting_scan(seed, **settings)
        observed = sc.Observations(scan.points_px, scan.segments_mm, frame=scan.frame)
        size = (int(IMAGE_PX),) * observed.dimension
        found = sc.calibrate(observed, image_size_px=size, threshold_mm=15.0)
        off, bound = off_and_bound(scan, found)
        ratios.append(off / bound)
        wide.append(bound.max())
        posed = with_tracker_offset(found, observed, recording_of(scan), Posing())
        off, bound = off_and_bound(scan, posed)
        with_poses.append(off / bound)
        offsets += len(posed.warnings) > len(found.warnings)
        codes = {one.code for one in found.warnings}
        warned.append(WARNING in codes)
        others += bool(codes - {WARNING})
    ratio, said = np.array(ratios), np.array(warned)
    cells = [
        f"{100 * np.mean(ratio[chosen] < 1):.0f} % ({chosen.sum()})" if chosen.any() else "-"
        for chosen in (~said, said, said | True)
    ]
    wrong = int(np.sum((ratio.max(axis=1) > 3) & ~said))
    cells.append(f"{100 * np.mean(np.array(with_poses) < 1):.0f} % ({offsets})")
    return f"{' | '.join(cells)} | {wrong} | {np.median(wide):.2f} mm | {others}"


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--rows", default="")
    given = parser.parse_args(arguments)
    print(
        "| errors | covered, not warned (scans) | warned | all | with poses (offsets found) | off by > 3 bounds, not "
        "warned | median bound | warned of else |\n|---|---|---|---|---|---|---|---|"
    )
    for name, settings in rows():
        if given.rows in name:
            cells = one_row(settings, range(given.first, given.first + given.seeds))
            print(f"| {name} | {cells} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
