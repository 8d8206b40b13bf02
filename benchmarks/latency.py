"""Image and tracker that are not of one instant: named, refused, or harmless; and sound scans that are accused of it.

python -m benchmarks.latency [--scans 200] [--first 0]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

import sonocal as sc
from benchmarks.simulators.late import HANDS, NEEDLE, Late, late_scan
from sonocal.sweep import calibrate_points

# Scans without a lag, of which none may be accused: of another rate, few frames, noise that drifts, volumes.
SOUND = {
    "20 images/s": {},
    "10 images/s": {"rate_hz": 10.0},
    "60 images, 12/s, uneven": {"rate_hz": 12.0, "frames": 60, "jitter_s": 0.02},
    "15 % outliers": {"outliers": 0.15},
    "tracking drifts (0.9 a frame)": {"memory": 0.9, "sigma_mm": 1.0},
    "tracking drifts (0.97 a frame)": {"memory": 0.97, "sigma_mm": 1.5, "frames": 200},
    "3D": {"dimension": 3},
}
LEAST_S, MOST_S = 0.05, 0.19
ACCUSED = ("latency", "latency-beyond-tolerance")


@dataclass
class Outcome:
    """What became of a scan.

    Attributes:
        refused: no calibration was given.
        named_s: the lag that was named, NaN if none was.
        stopped: the verdict is not to use it.
        error_mm, bound_mm: at the worst corner of the image, true and predicted.
    """

    refused: bool
    named_s: float
    stopped: bool
    error_mm: float
    bound_mm: float


def outcome(scan: Late, *, recording: bool) -> Outcome:
    """Calibrate it, as a table or as a recording with points."""
    try:
        found = (
            calibrate_points(scan.recording, [NEEDLE], scan.detections)[0]
            if recording
            else sc.calibrate(scan.observations)
        )
    except sc.SonocalError as error:
        return Outcome(True, named(error.diagnostics), True, np.nan, np.nan)
    from sonocal.validation import give_verdict

    corners = np.array([[u, v, w] for u in (0, 500) for v in (0, 500) for w in (0, 500)], dtype=float)
    corners = corners if found.dimension == 3 else corners[::2, :2]
    off = np.linalg.norm(found.probe_from_image @ corners - scan.truth @ corners, axis=1).max()
    bound = float(found.predicted_errors()[2].max())
    stopped = give_verdict(found).level == "stop"
    return Outcome(False, named(found.diagnostics), stopped, float(off), bound)


def named(findings: Sequence[sc.Diagnostic]) -> float:
    """The lag, s, that findings ask to be undone."""
    advice = [one.advice for one in findings if one.code == "latency"]
    return float(advice[0].split("--latency ")[1].split()[0]) if advice else np.nan


def lag_of(seed: int) -> float:
    """50 to 190 ms, either way."""
    rng = np.random.default_rng([seed, 7])
    return float(rng.uniform(LEAST_S, MOST_S) * rng.choice([-1, 1]))


def late(hands: str, seeds: range, *, recording: bool, **options: float) -> str:
    """A row of the first table."""
    off, told, harmless, stopped, refused = [], 0, 0, 0, 0
    for seed in seeds:
        lag = lag_of(seed)
        found = outcome(late_scan(seed, hands, lag, **options), recording=recording)
        told += found.refused or np.isfinite(found.named_s)
        harmless += not found.refused and np.isnan(found.named_s) and found.error_mm <= found.bound_mm
        stopped, refused = stopped + found.stopped, refused + found.refused
        if np.isfinite(found.named_s):
            off.append(1e3 * abs(found.named_s - lag))
    within = np.count_nonzero(np.array(off) <= 5.0)
    middle, most = np.quantile(off or [np.nan], [0.5, 0.98])
    return (
        f"named or refused {told}, else within its bound {harmless}; refused {refused}, not to be used {stopped}; "
        f"value within 5 ms {within} of {len(off)}, median {middle:.1f}, 98 % {most:.1f} ms"
    )


def accused(hands: str, seeds: range, **options: float) -> int:
    """How many sound scans are accused of a lag."""
    return sum(
        any(one.code in ACCUSED for one in findings)
        for findings in (
            sound_findings(lambda seed=seed: late_scan(seed, hands, 0.0, **options)) for seed in seeds
        )
    )


def sound_findings(scan: Callable[[], Late]) -> Sequence[sc.Diagnostic]:
    """Everything that is said of a scan."""
    try:
        return sc.calibrate(scan().observations).diagnostics
    except sc.SonocalError as error:
        return error.diagnostics


def rows(seeds: range) -> Iterator[str]:
    """All of the tables, row by row."""
    for recording in (False, True):
        for hands in HANDS:
            what = "recording" if recording else "table"
            yield f"{what:10s} {hands:6s} {late(hands, seeds, recording=recording)}"
    for dimension in (3,):
        for hands in HANDS:
            yield f"{'3D table':10s} {hands:6s} {late(hands, seeds, recording=False, dimension=dimension)}"
    for name, options in SOUND.items():
        counts = [accused(hands, seeds, **options) for hands in HANDS]
        yield f"sound: {name:32s} accused {', '.join(map(str, counts))} ({', '.join(HANDS)})"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scans", type=int, default=200)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scan")
    asked = parser.parse_args(arguments)
    for row in rows(range(asked.first, asked.first + asked.scans)):
        print(row, flush=True)


if __name__ == "__main__":
    main()
