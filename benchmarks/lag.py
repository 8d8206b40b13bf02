"""A lag that is estimated with the calibration: how far off it is, its interval, and what it does to the calibration.

python -m benchmarks.lag [--scans 100] [--first 5000] [--rows WORD] [--interval]
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import sonocal as sc
from benchmarks.simulators.late import NEEDLE, Late, late_scan
from sonocal.calibration import point_line_rows
from sonocal.calibration.lagged import rows_at_lag
from sonocal.observations.velocities import with_velocities
from sonocal.recording import with_latency
from sonocal.registration.options import Options
from sonocal.registration.uncertainty import radius_95
from sonocal.setup_checks.lag_fit import fit_lag
from sonocal.setup_checks.moving_lines import moving_in_recording
from sonocal.sweep import Posing, calibrate_points, tabulate

LEAST_S, MOST_S = 0.05, 0.19
TWENTY_SECONDS = {"frames": 400}
CORNERS = np.array([[u, v, w] for u in (0, 500) for v in (0, 500) for w in (0, 500)], dtype=float)


@dataclass
class Outcome:
    """What became of a scan.

    Attributes:
        off_s: the estimate's error; covered: whether the interval holds the truth; half_s: half its width.
        squares, of_known: squared errors at the corners of the image (mm^2), and those with the lag known.
        within: share of the corners within their bound.
        left: whether a finding of a lag is left.
    """

    off_s: float
    covered: bool
    half_s: float
    squares: float
    of_known: float
    within: float
    left: bool


def of_points(scan: Late, lag: float) -> tuple[sc.Calibration, sc.Calibration]:
    """The lag estimated, and known: a recording with points."""
    estimated = calibrate_points(scan.recording, [NEEDLE], scan.detections, latency="estimate")[0]
    return estimated, calibrate_points(with_latency(scan.recording, lag), [NEEDLE], scan.detections)[0]


def of_times(scan: Late, lag: float) -> tuple[sc.Calibration, sc.Calibration]:
    """A table with times."""
    rows = scan.observations
    return sc.calibrate(rows, latency="estimate"), sc.calibrate(rows_at_lag(rows, lag))


def of_velocities(scan: Late, lag: float, *, times: bool = False) -> tuple[sc.Calibration, sc.Calibration]:
    """A table with velocities, of some noise, and with or without times."""
    noise = 3.0 * np.random.default_rng(len(scan.observations)).normal(size=scan.velocities.shape)
    rows = with_velocities(scan.observations, scan.velocities + noise)
    if not times:
        rows = rows.with_sound(extra={name: one for name, one in rows.extra.items() if name != "time_s"})
    return sc.calibrate(rows, latency="estimate"), sc.calibrate(rows_at_lag(rows, lag))


def of_both(scan: Late, lag: float) -> tuple[sc.Calibration, sc.Calibration]:
    """A table with velocities and times."""
    return of_velocities(scan, lag, times=True)


ROWS: dict[str, tuple[Callable[[Late, float], tuple[sc.Calibration, sc.Calibration]], dict[str, Any]]] = {
    "recording, 45 mm/s": (of_points, {}),
    "no lag": (of_points, {"none": True}),
    "tracking drifts (0.9 a frame)": (of_points, {"memory": 0.9}),
    "tracking drifts (0.97 a frame)": (of_points, {"memory": 0.97}),
    "15 % outliers": (of_points, {"outliers": 0.15}),
    "10 images/s, uneven": (of_points, {"rate_hz": 10.0, "frames": 200, "jitter_s": 0.02}),
    "slow hand, 30 mm/s": (of_points, {"hands": "slow"}),
    "fast hand, 120 mm/s": (of_points, {"hands": "fast"}),
    "hand that rests": (of_points, {"hands": "still"}),
    "3D": (of_points, {"dimension": 3}),
    "table with times": (of_times, {}),
    "table with velocities": (of_velocities, {}),
    "table with both": (of_both, {}),
}


def lag_of(seed: int) -> float:
    """50 to 190 ms, either way."""
    rng = np.random.default_rng([seed, 7])
    return float(rng.uniform(LEAST_S, MOST_S) * rng.choice([-1, 1]))


def outcome(name: str, seed: int) -> Outcome | None:
    """Of one scan; None where it was refused."""
    ways, options = ROWS[name]
    options = TWENTY_SECONDS | options
    lag = 0.0 if options.pop("none", False) else lag_of(seed)
    scan = late_scan(seed, options.pop("hands", "usual"), lag, **options)
    try:
        found, known = ways(scan, lag)
    except sc.SonocalError:
        return None
    assert found.latency_s is not None
    assert found.latency_interval_s is not None
    low, high = found.latency_interval_s
    corners = CORNERS if found.dimension == 3 else CORNERS[::2, :2]
    off, of_known = (
        np.linalg.norm(one.probe_from_image @ corners - scan.truth @ corners, axis=1)
        for one in (found, known)
    )
    bounds = found.predict(corners)[1]
    return Outcome(
        off_s=found.latency_s - lag,
        covered=low <= lag <= high,
        half_s=0.5 * (high - low),
        squares=float(np.mean(off**2)),
        of_known=float(np.mean(of_known**2)),
        within=float(np.mean(off <= radius_95(bounds, found.noise.freedom))),
        left=any(one.code.startswith("latency") for one in found.diagnostics),
    )


def row(name: str, seeds: Sequence[int]) -> str:
    """The numbers of one kind of scan."""
    every = [outcome(name, seed) for seed in seeds]
    some = [one for one in every if one is not None]
    off, half = (1e3 * np.array([getattr(one, what) for one in some]) for what in ("off_s", "half_s"))
    mine, known = (np.sqrt(np.mean([getattr(one, what) for one in some])) for what in ("squares", "of_known"))
    return (
        f"| {name} | {np.sqrt(np.mean(off**2)):.2f} ms | +-{np.mean(half):.2f} ms | "
        f"{100 * np.mean([one.covered for one in some]):.1f} % | {mine:.3f} / {known:.3f} mm = {mine / known:.3f} | "
        f"{100 * np.mean([one.within for one in some]):.1f} % | {sum(one.left for one in some)} | "
        f"{len(every) - len(some)} of {len(every)} |"
    )


def interval(name: str, seeds: Sequence[int]) -> str:
    """How often the interval holds the lag: of the fit alone, without a calibration."""
    off, half = [], []
    for seed in seeds:
        options = TWENTY_SECONDS | ROWS[name][1]
        lag = 0.0 if options.pop("none", False) else lag_of(seed)
        scan = late_scan(seed, options.pop("hands", "usual"), lag, **options)
        rows = tabulate(scan.recording, [NEEDLE], scan.detections).observations
        segments, track = Posing().segments_mm(scan.recording, [NEEDLE]), np.zeros(len(rows), dtype=np.int64)
        moving = moving_in_recording(point_line_rows(rows), scan.recording.times, segments, rows.frame, track)
        found = fit_lag(moving, scan.truth, lag, Options(), 5.0)
        off.append(found.latency_s - lag)
        half.append(found.half_width_s)
    away, wide = 1e3 * np.abs(off), 1e3 * np.array(half)
    return (
        f"| {name} | {np.sqrt(np.mean(away**2)):.2f} ms | +-{np.mean(wide):.2f} ms | "
        f"{100 * np.mean(away <= wide):.1f} % of {len(away)} |"
    )


def rows(seeds: Sequence[int], word: str) -> Iterator[str]:
    """The table, row by row."""
    yield (
        "| scans | lag's error, rms | interval | holds | corners' error / with the lag known | within bound | "
        "finding left | refused |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for name in ROWS:
        if word in name:
            yield row(name, seeds)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scans", type=int, default=100)
    parser.add_argument("--first", type=int, default=5000, help="seed of the first scan")
    parser.add_argument("--rows", default="", help="only rows with this word")
    parser.add_argument("--interval", action="store_true", help="of recordings, the interval alone: fast")
    asked = parser.parse_args(arguments)
    seeds = range(asked.first, asked.first + asked.scans)
    some = (
        interval(name, seeds) for name, (way, _) in ROWS.items() if way is of_points and asked.rows in name
    )
    for line in some if asked.interval else rows(seeds, asked.rows):
        print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
