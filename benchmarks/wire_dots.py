"""How far detected dots of wires are from where the wires cross the image, by how they lean: what a thick slice does.

python -m benchmarks.wire_dots [--seeds 10] [--first 1000] [--slice-mm 1.2] [--write docs/detection.md]

Images are those of `benchmarks.walls`' nine wires, dots those that agree with a calibration, however they lie, and
where wires are is known exactly: neither poses nor a fit are in these errors. "Off the image": the error along the
lean over the lean's tangent, which is how far off the image along its normal such a dot would lie.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.pages import tell
from benchmarks.simulators.tank_images import Tank
from benchmarks.simulators.tank_probe import Probe
from benchmarks.simulators.tank_scans import Array, Scan, tank_scan
from sonocal.sweep import calibrate_recording, slice_noise
from sonocal.targets import Line

LEANS_DEG = (0.0, 10.0, 20.0, 30.0, 45.0, 55.0, 63.0, 75.0, 90.0)


def errors_of(scan: Scan, mm_per_px: float) -> Array:
    """(N, 3): the tangent of each dot's lean, and its errors along and across that, mm."""
    rows = calibrate_recording(scan.recording, scan.targets, count=15).observations
    segments = {one.name: one.segment_mm for one in scan.targets if isinstance(one, Line)}
    found = []
    for point, frame, name in zip(rows.points_px, rows.frame, rows.target, strict=True):
        pose = scan.image_from_target[frame]
        ends = segments[str(name)] @ pose[:3, :3].T + pose[:3, 3]
        way = ends[1] - ends[0]
        lean = way[:2] / way[2]
        crossing = ends[0, :2] - ends[0, 2] * lean
        tangent = float(np.hypot(*lean))
        off = mm_per_px * point[:2] - crossing
        found.append([tangent, off @ lean / tangent, off @ [-lean[1], lean[0]] / tangent])
    return np.array(found)


def table(seeds: Iterable[int], slice_mm: float) -> Iterator[tuple[str, str]]:
    """By lean, line by line."""
    probe, tank = Probe(), Tank(slice_mm=slice_mm)
    slice_noise.LEAST_MET_DEG = 0.0  # none is left out
    scans = (tank_scan(seed, "wires", probe=probe, tank=tank) for seed in seeds)
    errors = np.concatenate([errors_of(scan, probe.mm_per_px) for scan in scans])
    yield (
        "wire-dots",
        "| a wire's lean, deg | dots | rms along, mm | mean | rms across, mm | rms off the image, mm |",
    )
    yield "wire-dots", "|---|---|---|---|---|---|"
    leans = np.degrees(np.arctan(errors[:, 0]))
    for low, high in pairwise(LEANS_DEG):
        tangent, along, across = errors[(leans >= low) & (leans < high)].T
        if not len(along):
            continue
        rms = [np.sqrt(np.mean(one**2)) for one in (along, across, along / tangent)]
        yield (
            "wire-dots",
            f"| {low:g}-{high:g} | {len(along)} | {rms[0]:.2f} | {np.mean(along):+.2f} | {rms[1]:.2f} | {rms[2]:.2f} |",
        )


def main() -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--first", type=int, default=1000, help="first seed")
    parser.add_argument(
        "--slice-mm", type=float, default=1.2, help="standard deviation of the slice's thickness"
    )
    parser.add_argument("--write", type=Path, help="into this page, between its marks")
    given = parser.parse_args()
    tell(table(range(given.first, given.first + given.seeds), given.slice_mm), given.write)


if __name__ == "__main__":
    main()
