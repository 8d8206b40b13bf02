"""Sound of another speed than the scanner assumes, seen by a curved probe: how far off answers are with and without it.

python -m benchmarks.sound [--seeds N] [--first-seed N] [--kinds REGEX] [--ratios R,R,...]

Each scan is fitted as it is, with the speed given, and with the speed estimated; the measure is the same scan, with the
same noise, of a bath in which sound runs as assumed.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

import sonocal as sc
from benchmarks.simulators.fans import RADIUS_MM, as_shown, fan_scan
from benchmarks.simulators.trust_judge import image_size, table
from benchmarks.simulators.trust_scans import Array, Scan, mapped
from sonocal.calibration import Calibration, Sound

ASSUMED = 1540.0
KINDS = {
    "2D, 100 stills": {"frames": 100, "dimension": 2, "still": True},
    "2D, sweep of 100": {"frames": 100, "dimension": 2, "still": False},
    "2D, 300 stills": {"frames": 300, "dimension": 2, "still": True},
    "3D, 60 stills": {"frames": 60, "dimension": 3, "still": True},
}
RATIOS = (0.96, 1.0, 1.04)
PLACES = 9
# What names the speed of sound where nobody asked.
NAMES = {"anisotropic-scale", "image-distortion"}
# A predicted error above what is accepted is no accusation; chance calls one speed of a hundred another.
FAIR, TOLD = {"weak-motion"}, 0.01
METHODS = ("right", "given", "estimated", "with mm/px")
ERRORS = (
    "scans",
    "speed",
    "right speed, mm",
    "ignored: tissue / bath, mm",
    "given: tissue / bath, times the right speed's",
    "estimated: tissue / bath, likewise",
    "estimated with the scanner's mm/px, likewise",
    "corners within the 95 % bound: right / given / estimated / with mm/px",
)
WORDS = (
    "scans",
    "speed",
    "named without the option",
    "told from the assumed speed",
    "accused",
    "speed in its interval: estimated / with mm/px",
    "half of that, m/s",
)


@dataclass(frozen=True)
class Judged:
    """One scan.

    Attributes:
        tissue_mm, bath_mm: by method, rms over the image: of images at the assumed speed, and as scanned.
        corners_mm: by method, the greatest at a corner of images at the assumed speed.
        covered: by method, the share of corners within their predicted error (95 %).
        speed, half_m_s: by method, the estimate's error over the half width of its interval, and that half width.
        named, accused, told: without the option; with the estimate; and whether that is told from the assumed speed.
    """

    tissue_mm: dict[str, float]
    bath_mm: dict[str, float]
    corners_mm: dict[str, float]
    covered: dict[str, float]
    speed: dict[str, float]
    half_m_s: dict[str, float]
    named: bool
    accused: bool
    told: bool


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--kinds", default="", metavar="REGEX")
    parser.add_argument("--ratios", default=",".join(map(str, RATIOS)), metavar="R,R,...")
    asked = parser.parse_args(arguments)
    seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
    print(table_head(ERRORS), flush=True)
    words = [table_head(WORDS)]
    for kind in (name for name in KINDS if re.search(asked.kinds, name)):
        for ratio in (float(one) for one in asked.ratios.split(",")):
            found = [judged(seed, kind, ratio) for seed in seeds]
            print(errors_of(kind, ratio, found), flush=True)
            words.append(words_of(kind, ratio, found))
    print("\n" + "\n".join(words))


def table_head(columns: tuple[str, ...]) -> str:
    """The head of a table."""
    return f"| {' | '.join(columns)} |\n{'|---' * len(columns)}|"


def judged(seed: int, kind: str, ratio: float) -> Judged:
    """What is said of a scan with and without the speed, beside the truth."""
    scan = fan_scan(seed, ratio=ratio, **KINDS[kind])  # type: ignore[arg-type]
    right = fan_scan(seed, ratio=1.0, **KINDS[kind])  # type: ignore[arg-type]
    told = {"probe_radius_mm": RADIUS_MM}
    mm_per_px = float(np.linalg.norm(scan.truth[:3, 0]))
    found = {
        "right": calibrated(right),
        "ignored": calibrated(scan),
        "given": calibrated(scan, **told, sound_speed_m_s=ratio * ASSUMED),
        "estimated": calibrated(scan, **told, sound_speed_m_s="estimate"),
        "with mm/px": calibrated(scan, **told, sound_speed_m_s="estimate", scanner_mm_per_px=mm_per_px),
    }
    sounds = {name: sound_of(found[name]) for name in METHODS[2:]}
    halves = {name: half_width(one) for name, one in sounds.items()}
    p_value = sounds["estimated"].p_value
    assert p_value is not None
    warned = {one.code for one in found["estimated"].warnings}
    return Judged(
        tissue_mm={name: rms(tissue_errors(one, scan)) for name, one in found.items()},
        bath_mm={
            name: rms(bath_errors(one, scan, 1.0 if name == "right" else ratio))
            for name, one in found.items()
        },
        corners_mm={name: float(corner_errors(one, scan).max()) for name, one in found.items()},
        covered={name: covered(one, scan) for name, one in found.items()},
        speed={name: (one.speed_m_s - ratio * ASSUMED) / halves[name] for name, one in sounds.items()},
        half_m_s=halves,
        named=bool(NAMES & {one.code for one in found["ignored"].warnings}),
        accused=bool(warned - FAIR) or (ratio == 1.0 and p_value < TOLD),
        told=p_value < TOLD,
    )


def sound_of(found: Calibration) -> Sound:
    """What it knows of the speed."""
    assert found.sound is not None
    return found.sound


def half_width(sound: Sound) -> float:
    """Of its interval, m/s."""
    assert sound.by_rows_m_s is not None
    return (sound.by_rows_m_s[1] - sound.by_rows_m_s[0]) / 2


def calibrated(scan: Scan, **options: Any) -> Calibration:
    """The program under test."""
    return sc.calibrate(table(scan), image_size_px=image_size(scan), **options)


def places(scan: Scan) -> Array:
    """(M, D): all over the image."""
    side = np.linspace(scan.corners_px.min(), scan.corners_px.max(), PLACES)
    return np.stack(np.meshgrid(*[side] * scan.dimension), axis=-1).reshape(-1, scan.dimension)


def tissue_errors(found: Calibration, scan: Scan) -> Array:
    """(M,), mm: of images in which sound runs as assumed."""
    return np.linalg.norm(found.probe_from_image @ places(scan) - mapped(scan.truth, places(scan)), axis=1)


def bath_errors(found: Calibration, scan: Scan, ratio: float) -> Array:
    """(M,), mm: of images as scanned, with what the calibration knows of their shape."""
    seen = as_shown(places(scan), scan.truth, ratio)
    if found.sound is not None:
        seen = found.sound.at_assumed_speed(seen)
    return np.linalg.norm(found.probe_from_image @ seen - mapped(scan.truth, places(scan)), axis=1)


def corner_errors(found: Calibration, scan: Scan) -> Array:
    """(C,), mm: of images in which sound runs as assumed, at `predicted_errors`' corners."""
    corners = found.predicted_errors()[0][:-1]
    return np.linalg.norm(found.probe_from_image @ corners - mapped(scan.truth, corners), axis=1)


def covered(found: Calibration, scan: Scan) -> float:
    """The share of corners whose error is within the one predicted (95 %)."""
    return float(np.mean(corner_errors(found, scan) <= found.predicted_errors()[2][:-1]))


def rms(errors: Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(errors**2)))


def errors_of(kind: str, ratio: float, found: list[Judged]) -> str:
    """A row: errors over all scans, and how many times those at the right speed they are."""

    def times(where: str, method: str) -> float:
        return overall(found, where, method) / overall(found, where, "right")

    cells = (
        kind,
        f"{ASSUMED * ratio:.0f} m/s",
        f"{overall(found, 'tissue_mm', 'right'):.2f}",
        f"{overall(found, 'tissue_mm', 'ignored'):.2f} / {overall(found, 'bath_mm', 'ignored'):.2f}",
        f"{times('tissue_mm', 'given'):.2f} / {times('bath_mm', 'given'):.2f}",
        *(
            f"{times('tissue_mm', method):.2f} / {times('bath_mm', method):.2f}"
            for method in ("estimated", "with mm/px")
        ),
        " / ".join(f"{100 * np.mean([one.covered[name] for one in found]):.0f} %" for name in METHODS),
    )
    return f"| {' | '.join(cells)} |"


def overall(found: list[Judged], where: str, method: str) -> float:
    """Root mean square of all scans, mm."""
    return rms(np.array([getattr(one, where)[method] for one in found]))


def words_of(kind: str, ratio: float, found: list[Judged]) -> str:
    """A row: how often it is named, told, accused; whether intervals hold."""
    count = len(found)
    cells = (
        kind,
        f"{ASSUMED * ratio:.0f} m/s",
        *(f"{sum(getattr(one, name) for one in found)} of {count}" for name in ("named", "told", "accused")),
        " / ".join(
            f"{100 * np.mean([abs(one.speed[name]) <= 1.0 for one in found]):.1f} %" for name in METHODS[2:]
        ),
        " / ".join(f"{np.median([one.half_m_s[name] for one in found]):.0f}" for name in METHODS[2:]),
    )
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
