"""How many sightings it takes to 1 mm: a hand that is told the next pose and misses it, and one that wanders smoothly.

python -m benchmarks.guidance [--seeds 20] [--until 1.0]

Sightings by the paper's protocol (1 px, 1 mm at the needle's ends, 500 x 500 px of 0.24 mm). The hand that is told
misses by 25 px and 10 degrees (standard deviations an axis); a pose that it misses the image with counts, too. The
smooth hand is the simulator's, 20 images a second, as free to tilt. Both stop when the calibration says that its error
stays below so many mm at the image's corners (95 %); what it is in truth stands beside.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np

import sonocal as sc
from sonocal.geometry import area_places
from sonocal.simulation.sweep import random_calibration
from sonocal.simulation.sweep_motion import HandMotion
from sonocal.simulation.ultrasound_probe import ProbeGeometry
from sonocal.sweep.guidance import Reach, first_holds, next_holds

SIDE, SCALE, NEEDLE_MM = 500, 0.24, 400.0
SIZE = (SIDE, SIDE)
SIGMA_PX = SIGMA_MM = 1.0
MISS_PX, MISS_DEG = 25.0, 10.0
RATE_HZ, LONGEST_S = 20.0, 200.0
FEWEST, MOST = 8, 4000
GROWTH = 1.02
TILTS_DEG = (60.0, 30.0)
FULL = ProbeGeometry(
    size_px=SIZE,
    scale_mm_per_px=SCALE,
    depth_mm=SIDE * SCALE,
    top_mm=0.0,
    half_width_mm=0.5 * SIDE * SCALE,
)
Pose = tuple[np.ndarray, np.ndarray]


class Scan:
    """Sightings that grow, and the calibration of them."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng([seed, 21])
        self.truth = random_calibration(self.rng, SCALE)
        self.points: list[np.ndarray] = []
        self.segments: list[np.ndarray] = []
        self.asked = 0

    def see(self, place_px: np.ndarray, along: np.ndarray) -> None:
        """One pose, which gives a sighting where it crosses the image."""
        self.asked += 1
        if not np.all((place_px >= 0) & (place_px <= SIDE - 1)):
            return
        along = self.truth.rotation @ (along / np.linalg.norm(along))
        middle, before = self.truth @ place_px[None], self.rng.uniform(0.1, 0.9) * NEEDLE_MM
        ends = middle + np.array([[-before], [NEEDLE_MM - before]]) * along
        self.points.append(place_px + self.rng.normal(scale=SIGMA_PX, size=2))
        self.segments.append(ends + self.rng.normal(scale=SIGMA_MM, size=ends.shape))

    def fit(self) -> sc.Calibration | None:
        """None where the sightings do not give one."""
        try:
            return sc.calibrate(
                sc.Observations(np.array(self.points), np.array(self.segments), image_size_px=SIZE)
            )
        except sc.SonocalError:
            return None

    def off_mm(self, found: sc.Calibration) -> float:
        """The greatest true error at a corner."""
        corners = area_places(np.array([[0.0, 0.0], [SIDE - 1.0, SIDE - 1.0]]))[:-1]
        return float(np.linalg.norm(found.probe_from_image @ corners - self.truth @ corners, axis=1).max())


def expected_mm(found: sc.Calibration | None) -> float:
    """What it says of itself at the corners."""
    if found is None or found.covariance is None:
        return np.inf
    return float(found.predicted_errors()[2][:-1].max())


def told(scan: Scan, until_mm: float, most_tilt_deg: float) -> tuple[int, float]:
    """Poses asked of a hand that is told, and the true error then."""
    reach = Reach(most_tilt_deg, MISS_PX, MISS_DEG)
    beginning, found = first_holds(SIZE, count=3 * FEWEST, reach=reach), None
    while scan.asked < MOST:
        hold = beginning[scan.asked % len(beginning)] if found is None else next_holds(found, reach=reach)[0]
        turned = hold.direction + np.cross(
            scan.rng.normal(scale=np.radians(MISS_DEG), size=3), hold.direction
        )
        scan.see(np.array(hold.place_px) + scan.rng.normal(scale=MISS_PX, size=2), turned)
        if len(scan.points) >= FEWEST:
            found = scan.fit() or found
        if found is not None and expected_mm(found) <= until_mm:
            return scan.asked, scan.off_mm(found)
    return MOST, np.nan


def smooth_poses(seed: int, most_tilt_deg: float) -> Iterator[Pose]:
    """Places and directions of a hand that wanders; to 30 degrees its slopes are as much smaller."""
    times = np.arange(0.0, LONGEST_S, 1.0 / RATE_HZ)
    needles = HandMotion(FULL, LONGEST_S, np.random.default_rng(seed)).needle(times)
    along = needles[:, 1] - needles[:, 0]
    along[:, :2] *= np.tan(np.radians(most_tilt_deg)) / np.tan(np.radians(60.0))
    yield from zip(needles.mean(axis=1)[:, :2] / SCALE, along, strict=True)


def smooth(scan: Scan, until_mm: float, most_tilt_deg: float, seed: int) -> tuple[int, float]:
    """Images of a hand that wanders, and the true error when it is done."""
    due = FEWEST
    for place, along in smooth_poses(seed, most_tilt_deg):
        scan.see(place, along)
        if len(scan.points) < due:
            continue
        due = max(due + 2, int(GROWTH * due))
        found = scan.fit()
        if found is not None and expected_mm(found) <= until_mm:
            return scan.asked, scan.off_mm(found)
    return MOST, np.nan


def main() -> None:
    """Print a line for each tilt."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--until", type=float, default=1.0, help="mm at the corners, 95 %%")
    arguments = parser.parse_args()
    for tilt in TILTS_DEG:
        seeds = range(arguments.seeds)
        ours = np.array([told(Scan(seed), arguments.until, tilt) for seed in seeds])
        theirs = np.array([smooth(Scan(seed), arguments.until, tilt, seed) for seed in seeds])
        few, many = np.median(ours[:, 0]), np.median(theirs[:, 0])
        print(
            f"tilts to {tilt:.0f} degrees, to {arguments.until} mm: told {few:.0f} sightings (in truth "
            f"{np.median(ours[:, 1]):.2f} mm, at most {ours[:, 1].max():.2f}), smooth {many:.0f} "
            f"({np.median(theirs[:, 1]):.2f}, {theirs[:, 1].max():.2f}): 1 / {many / few:.1f}"
        )


if __name__ == "__main__":
    main()
