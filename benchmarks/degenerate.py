"""Degenerate scans with noise, and scans through a port: what is refused, warned of, and held by the bound.

python -m benchmarks.degenerate [--seeds 100] [--first-seed 0]

A degenerate scan says nothing of one motion of the image; noise makes it look as if it did. Silent: a corner of the
true image off by more than 10 mm without a word. Through a port, covered: corners within the 95 % bound, of those
answered.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

import sonocal as sc
from benchmarks.simulators.near_degenerate import DEGENERATE, corner_errors, scan
from sonocal.registration.uncertainty import radius_95
from sonocal.validation import give_verdict

FAR_MM = 10.0
NOISES = ((1.0, 0.5), (3.0, 0.3), (0.5, 1.0))
PORTS_MM, AWAY_MM, COUNTS = (1.0, 3.0, 5.0), (40.0, 100.0), (20, 100, 1000)


def outcome(made, dimension: int, size: tuple[int, ...] | None) -> tuple[str, np.ndarray, np.ndarray]:
    """Refused, warned or silent; how far the true image's corners are off, and the bound there, mm."""
    none = np.full(2**dimension, np.nan)
    try:
        found = sc.calibrate(made.observations, image_size_px=size)
    except sc.SonocalError:
        return "refused", none, none
    off = corner_errors(found.probe_from_image.matrix, made.truth, dimension)
    if found.covariance is None:
        return "warned", off, np.full(2**dimension, np.inf)
    corners = 499.0 * np.indices((2,) * dimension).reshape(dimension, -1).T
    bound = radius_95(found.predict(corners)[1], found.noise.freedom)
    return ("silent" if give_verdict(found).level == "use" else "warned"), off, bound


def degenerate_row(kind: str, dimension: int, seeds: Sequence[int]) -> str:
    """How degenerate scans end, over noises and sizes of scans."""
    ends = {"refused": 0, "warned": 0, "silent": 0}
    far = tried = 0
    for seed in seeds:
        for sigma_px, sigma_mm in NOISES:
            count = (10, 30, 100, 400)[seed % 4]
            made = scan(seed, kind, dimension=dimension, count=count, sigma_px=sigma_px, sigma_mm=sigma_mm)
            end, off, _ = outcome(made, dimension, (500,) * dimension if seed % 2 else None)
            ends[end] += 1
            far += bool(end == "silent" and off.max() > FAR_MM)
            tried += 1
    return f"| {kind}, {dimension}D | {tried} | {ends['refused']} | {ends['warned']} | {ends['silent']} | {far} |"


def port_row(spread_mm: float, away_mm: float, count: int, seeds: Sequence[int]) -> str:
    """How often the bound holds through a port."""
    held = answered = refused = 0
    for seed in seeds:
        made = scan(
            seed, "one-port", count=count, sigma_px=3.0, sigma_mm=0.3, spread=spread_mm, away_mm=away_mm
        )
        end, off, bound = outcome(made, 2, (500, 500))
        refused += end == "refused"
        if end != "refused":
            held, answered = held + int((off <= bound).sum()), answered + len(off)
    covered = f"{100 * held / answered:.1f} %" if answered else ""
    return f"| {spread_mm:g} mm, {away_mm:g} mm off | {count} | {refused} of {len(seeds)} | {covered} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=0)
    given = parser.parse_args(arguments)
    seeds = range(given.first_seed, given.first_seed + given.seeds)
    print("| scans | tried | refused | warned | silent | silent, off > 10 mm |\n|---|---|---|---|---|---|")
    for dimension, kinds in DEGENERATE.items():
        for kind in (*kinds, "sound"):
            print(degenerate_row(kind, dimension, seeds), flush=True)
    print("\n| port | N | refused | covered |\n|---|---|---|---|")
    for spread_mm in PORTS_MM:
        for away_mm in AWAY_MM:
            for count in COUNTS:
                print(port_row(spread_mm, away_mm, count, seeds), flush=True)


if __name__ == "__main__":
    main()
