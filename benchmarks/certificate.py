"""How often an answer is shown to be the best of all, never a worse one, and how long that takes.

python -m benchmarks.certificate [--scenes 10000] [--first-seed 0] [--write docs/theory.md]

Scenes of needles tilted by up to 5, 20 or 50 deg, with noise of 1, 5 or 20 px and 0.5 mm; refinement from random starts
gives the best answer, and worse ones that are the best of their neighbourhood, planted as answers. Where the best
one is not shown to be, many more starts look for a better one. Answers of `best_fit` are held against the best of all.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.pages import tell
from sonocal import _core
from sonocal.errors import DegenerateGeometryError, NoConsensusError
from sonocal.registration.best_fit import best_fit
from sonocal.registration.options import Options
from sonocal.registration.rows import PointLineRows, to_core

COUNTS, TILTS_DEG, NOISE_PX, NOISE_MM = (4, 5, 6, 10, 20, 50), (5.0, 20.0, 50.0), (1.0, 5.0, 20.0), 0.5
MM_PER_PX, HALF_MM, STARTS, MANY_STARTS = 0.24, 200.0, 24, 400
# Relative to the least cost: answers that cost this much more are worse.
WORSE = 1e-6


def scene(rng: np.random.Generator, needles: int, tilt_deg: float, dimension: int) -> PointLineRows:
    """Needles across the image, and what is seen of them."""
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-100, 100, 3)
    px = rng.choice(NOISE_PX)
    seen = rng.uniform(0, 500, (needles, 3)) * [1, 1, dimension - 2]
    tilts = Rotation.from_rotvec(np.radians(tilt_deg) * rng.uniform(-1, 1, (needles, 3)))
    way = tilts.as_matrix()[:, :, 2]
    middle = MM_PER_PX * seen @ turn.T + shift
    ends = middle[:, None] + HALF_MM * np.array([-1.0, 1.0])[:, None] * (way @ turn.T)[:, None]
    ends += rng.normal(0, NOISE_MM, ends.shape)
    if dimension == 2:
        return PointLineRows(seen + rng.normal(0, px, seen.shape) * [1, 1, 0], ends, 2)
    points = np.stack([seen - 100 * way, seen + 100 * way], axis=1).reshape(-1, 3)
    sightings = np.repeat(np.arange(needles, dtype=np.int32), 2)
    return PointLineRows(points + rng.normal(0, px, points.shape), np.repeat(ends, 2, axis=0), 3, sightings)


def answers(
    rows: PointLineRows, options: _core.Options, rng: np.random.Generator, starts: int = STARTS
) -> list[_core.Estimate]:
    """Where refinement from random starts comes to rest."""
    chosen, middle = np.ones(len(rows), dtype=bool), rows.segments_mm.mean(axis=(0, 1))
    found = []
    for turn in Rotation.random(starts, random_state=rng).as_matrix():
        shift = middle - MM_PER_PX * turn @ rows.points.mean(axis=0)
        start = _core.Transform(np.ascontiguousarray(turn), shift, np.full(3, MM_PER_PX))
        found.append(_core.refine(rows.core, chosen, start, options))
    return [one for one in found if one.converged and one.sound]


def core_transform(found: _core.Estimate) -> _core.Transform:
    """Where a refinement ended."""
    return _core.Transform(found.rotation, found.translation, found.scales)


class Counts:
    """Of the scenes of one row of the table."""

    def __init__(self) -> None:
        self.said = {"optimal": 0, "tied": 0, "not shown": 0}
        self.scenes = self.refused = self.missed = self.worse = self.false = 0
        self.times_us: dict[str, list[float]] = {"optimal": [], "tied": [], "not shown": []}

    def add(self, rows: PointLineRows, known: bool, rng: np.random.Generator) -> None:
        """One scene."""
        self.scenes += 1
        scale = {"model": "rigid", "scale_mm_per_px": MM_PER_PX} if known else {}
        asked = Options.of(weighting="geometric", threshold_mm=np.inf, **scale)
        options = rows.core_options(asked)
        ends = [(one.squared_sum, core_transform(one)) for one in answers(rows, options, rng)]
        try:
            own, _ = best_fit(rows, asked)
            ends.insert(0, (own.squares_mm2, to_core(own.transform)))
            fitted = True
        except (DegenerateGeometryError, NoConsensusError):
            self.refused += 1
            fitted = False
        if not ends:
            return
        cost, best = min(ends, key=lambda end: end[0])
        if self.certified(rows, best, options) == "not shown":
            more = [
                (one.squared_sum, core_transform(one)) for one in answers(rows, options, rng, MANY_STARTS)
            ]
            cost, best = min([(cost, best), *more], key=lambda end: end[0])
        self.said[self.certified(rows, best, options)] += 1
        self.missed += fitted and worse_than(ends[0][0], cost)
        for other, at in ends:
            if worse_than(other, cost):
                self.worse += 1
                self.false += self.certified(rows, at, options) != "not shown"

    def certified(self, rows: PointLineRows, at: _core.Transform, options: _core.Options) -> str:
        """What the core says of an answer."""
        begin = time.process_time_ns()
        said = _core.certificate(rows.core, np.ones(len(rows), dtype=bool), at, options)
        self.times_us[said].append(1e-3 * (time.process_time_ns() - begin))
        return said

    def cells(self) -> tuple[str, ...]:
        """Of the table."""
        best = sum(self.said.values())
        return (
            f"{self.scenes}",
            f"{100 * self.said['optimal'] / max(best, 1):.2f} %",
            f"{self.said['tied']}",
            f"{self.said['not shown']}",
            f"{self.missed}",
            f"{self.refused}",
            f"{self.false} of {self.worse}",
            " / ".join(taken(self.times_us[said]) for said in ("optimal", "not shown")),
        )


def worse_than(cost: float, least: float) -> bool:
    """By more than rounding."""
    return cost > least * (1 + WORSE) + 1e-9


def taken(times_us: list[float]) -> str:
    """Median and what 95 % take, us."""
    return f"{np.median(times_us):.0f}, {np.quantile(times_us, 0.95):.0f}" if times_us else "none"


def row_of(dimension: int, known: bool, needles: int, seeds: range) -> str:
    """A line of the table."""
    counts = Counts()
    for seed in seeds:
        rng = np.random.default_rng([seed, needles, dimension])
        counts.add(scene(rng, needles, TILTS_DEG[seed % len(TILTS_DEG)], dimension), known, rng)
    name = f"{dimension}D{', scale known' if known else ''}"
    return f"| {' | '.join((name, str(needles), *counts.cells()))} |"


def table(scenes: int, first_seed: int) -> Iterator[str]:
    """The table, line by line; as many scenes in all."""
    yield (
        "| probe | needles | scenes | best answers shown optimal | tied | not shown | best_fit is not the best "
        "| best_fit refuses | worse answers called best | processor time, us: shown / not shown, median, 95 % |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|"
    each = -(-scenes // (4 * len(COUNTS)))
    for known in (False, True):
        for dimension in (2, 3):
            for needles in COUNTS:
                yield row_of(dimension, known, needles, range(first_seed, first_seed + each))


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=10_000, help="in all")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--write", type=Path, help="page whose table to replace")
    asked = parser.parse_args(arguments)
    tell((("certificate", line) for line in table(asked.scenes, asked.first_seed)), asked.write)


if __name__ == "__main__":
    main()
