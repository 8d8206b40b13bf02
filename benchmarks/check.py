"""Checks of a calibration by a 10-second sweep: how often a knock is seen, beside how often it was said to be.

    python -m benchmarks.check [--seeds 100] [--first 1000]

The simulator shares no code with what it measures. Thresholds were chosen on seeds below 1000.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np

import sonocal as sc
from benchmarks.simulators.checks import KINDS, first_day, knock, later
from benchmarks.simulators.trust_judge import image_size, table
from sonocal.validation import check_calibration

KNOCKS = [(mm, 0.0) for mm in (0.5, 1.0, 2.0)] + [(0.0, deg) for deg in (0.5, 1.0, 2.0)]


def calibrated(seed):
    """The calibration of the first day, and its truth."""
    scan = first_day(seed)
    return sc.calibrate(table(scan), image_size_px=image_size(scan)), scan.truth


def one(seed, known, kind, marker_motion=None, grown=1.0, **how):
    """A check, and the power that it states to see this knock."""
    calibration, truth = known
    motion = np.eye(4) if marker_motion is None else marker_motion
    there = motion @ truth
    there[:3, :3] *= grown
    check = check_calibration(calibration, table(later(seed, there, kind, **how)))
    return check, check.power(motion) if marker_motion is not None else np.nan


def line(name, checks, powers=()):
    """Print what was said of many checks."""
    said = Counter(check.verdict for check in checks)
    rate = said["changed"] / len(checks)
    stated = f"said to be seen {np.mean(powers):6.1%}" if len(powers) else " " * 22
    visible = np.median([check.visible_mm for check in checks])
    print(
        f"{name:34} changed {rate:6.1%}  {stated}  holds {said['holds']:3} cannot tell {said['cannot tell']:3}  "
        f"of 1 mm seen {np.median([check.power_mean for check in checks]):5.1%}, all of {visible:5.2f} mm",
        flush=True,
    )


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first", type=int, default=1000)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.seeds)
    known = {seed: calibrated(seed) for seed in seeds}
    for kind in KINDS:
        checks = [one(seed, known[seed], kind)[0] for seed in seeds]
        line(f"{kind}: sound", checks)
        checks = [one(seed, known[seed], kind, seconds=2.0)[0] for seed in seeds]
        line(f"{kind}: sound, 2 s", checks)
        checks = [one(seed, known[seed], kind, still_probe=True)[0] for seed in seeds]
        line(f"{kind}: sound, nothing is turned", checks)
        for mm, deg in KNOCKS:
            found = [
                one(seed, known[seed], kind, knock(np.random.default_rng([seed, 14]), mm, deg))
                for seed in seeds
            ]
            name = f"{mm:g} mm" if mm else f"{deg:g} deg"
            line(f"{kind}: knocked by {name}", *zip(*found, strict=True))
        found = [one(seed, known[seed], kind, np.eye(4), 1.05)[0] for seed in seeds]
        line(f"{kind}: depth changed by 5 %", found)


if __name__ == "__main__":
    main()
