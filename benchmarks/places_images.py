"""From images of a target that nobody placed to a calibration, with nobody clicking.

python -m benchmarks.places_images [--seeds 20] [--first 100] [--only thread ...] [--write docs/bucket.md]

Images are those of `simulators.tank_images`, which shares nothing with the detector nor with sonocal's simulation: 200
a sweep, of 500 x 500 px and 0.2 mm; tilts go to 40 degrees, and poses are off by 0.3 mm and 0.2 degrees. Of "spots",
brighter than a thread, there are so many in an image on average. "error": root mean square over the image. "bounded
truly": errors at the image's corners within one and a half times the 95 % stated.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

import sonocal as sc
from benchmarks.pages import tell
from benchmarks.simulators.places import Sweep, image_corners, image_points
from benchmarks.simulators.places_hand import Kind
from benchmarks.simulators.tank_images import Tank
from benchmarks.simulators.tank_sweeps import tank_recording
from sonocal.calibration import Calibration
from sonocal.registration.uncertainty import point_covariance, radius_95
from sonocal.targets import Unplaced

FRAMES, ASKED_MM, BOUNDED = 200, 0.25, 1.5


class Case(NamedTuple):
    """What is in the tank, and what else is bright in it."""

    name: str
    kind: Kind
    spots: float


CASES = (
    Case("thread", "line", 0.5),
    Case("thread, 1 spot", "line", 1.0),
    Case("thread, 2 spots", "line", 2.0),
    Case("crossing", "point", 0.5),
    Case("floor", "plane", 0.5),
)


class Trial(NamedTuple):
    """Of one recording; what is refused has no error."""

    error_mm: float
    bounded: bool
    seconds: float


def trial(case: Case, seed: int) -> Trial:
    """One recording to a calibration."""
    recording, scene = tank_recording(case.kind, seed, FRAMES, tank=Tank(spots=case.spots))
    begin = time.process_time()
    try:
        found = sc.calibrate_recording(recording, [Unplaced(case.kind, case.name, "Tracker")]).calibration
    except sc.SonocalError:
        return Trial(np.nan, True, time.process_time() - begin)
    seconds = time.process_time() - begin
    corners = image_corners()
    stated = np.inf
    if found.covariance is not None:
        covariances = point_covariance(found.probe_from_image, found.covariance, corners)
        stated = radius_95(covariances, found.noise.freedom)
    bounded = bool(np.all(_off_mm(found, scene, corners) < BOUNDED * stated))
    return Trial(float(np.sqrt(np.mean(_off_mm(found, scene, image_points()) ** 2))), bounded, seconds)


def _off_mm(found: Calibration, scene: Sweep, points: np.ndarray) -> np.ndarray:
    there = points @ scene.truth[:3, :3].T + scene.truth[:3, 3]
    return np.asarray(np.linalg.norm(found.probe_from_image @ points - there, axis=1))


def table(seeds: range, only: Sequence[str]) -> Iterator[str]:
    """Line by line."""
    yield (
        f"| in the tank | spots an image | error | worst | at most {ASKED_MM} mm | bounded truly | refused | "
        "processor time |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for case in CASES:
        if only and case.name not in only:
            continue
        yield row_of(case, [trial(case, seed) for seed in seeds])


def row_of(case: Case, all_of: Sequence[Trial]) -> str:
    """A line of the table."""
    there = [one for one in all_of if np.isfinite(one.error_mm)]
    errors = np.array([one.error_mm for one in there] or [np.nan])
    return (
        f"| {case.name.partition(',')[0]} | {case.spots:g} | {np.sqrt(np.mean(errors**2)):.2f} mm "
        f"| {errors.max():.2f} mm | {np.count_nonzero(errors <= ASKED_MM)} of {len(all_of)} "
        f"| {sum(one.bounded for one in there)} of {len(there)} | {len(all_of) - len(there)} "
        f"| {np.median([one.seconds for one in all_of]):.1f} s |"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--write", type=Path)
    asked = parser.parse_args(arguments)
    seeds = range(asked.first, asked.first + asked.seeds)
    tell((("places-images", line) for line in table(seeds, asked.only)), asked.write)


if __name__ == "__main__":
    main()
