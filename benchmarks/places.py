"""How near to the least error a calibration comes when nobody knows where its target is, and whether it says so.

python -m benchmarks.places [--scenes 200] [--first-seed 0] [--exact | --motions | --known] [--rows TEXT] [--write PAGE]

A probe sees one target over a tank (1 px, poses 0.3 mm and 0.2 degrees, tilts to 40 degrees; 500 x 500 px, 0.2 mm/px).
"error": root mean square over the image; "least": likewise, of Cramer and Rao, in those scenes; "over it": root mean
square of the ratio; "found": scenes whose error is below four times the least; "covered": image corners within the 95 %
stated; "target": likewise of where it was found. Times are of a processor, the median scene's.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.pages import tell
from benchmarks.places_known import known_table
from benchmarks.places_motions import motion_table
from benchmarks.places_scenes import off_mm, outcome, registered
from benchmarks.simulators.places import Noise, image_points, sweep
from benchmarks.simulators.places_hand import Kind
from sonocal.errors import SonocalError


class Case(NamedTuple):
    """Scenes of a row."""

    kind: Kind
    frames: int
    wrong: float = 0.0
    tracked: bool = False
    dimension: int = 2
    points_each: int | None = None

    @property
    def name(self) -> str:
        """As the table says it."""
        more = {
            ", in a tracked tool": self.tracked,
            ", 3D": self.dimension == 3,
            ", one point an image": self.points_each == 1,
        }
        return self.kind + "".join(said for said, so in more.items() if so)


CASES = (
    Case("point", 12),
    Case("point", 12, 0.2),
    Case("point", 20, 0.4),
    Case("point", 60),
    Case("point", 60, 0.4),
    Case("line", 20),
    Case("line", 20, 0.2),
    Case("line", 60),
    Case("line", 60, 0.4),
    Case("line", 60, tracked=True),
    Case("line", 20, dimension=3),
    Case("plane", 20),
    Case("plane", 60),
    Case("plane", 60, 0.2),
    Case("plane", 60, points_each=1),
)
EXACT = (
    Case("point", 4),
    Case("point", 12),
    Case("line", 6),
    Case("line", 12),
    Case("plane", 12),
    Case("plane", 12, points_each=1),
    Case("plane", 20),
    Case("line", 6, dimension=3),
)
EXACT_MM = 1e-6


def row_of(case: Case, seeds: range) -> str:
    """A line of the table."""
    all_of = []
    for seed in seeds:
        scene = sweep(
            case.kind,
            case.frames,
            seed,
            Noise(),
            wrong=case.wrong,
            tracked=case.tracked,
            dimension=case.dimension,
            points_each=case.points_each,
        )
        all_of.append(outcome(case.kind, scene))
    sound = [one for one in all_of if one.found]
    error, least = (np.array([getattr(one, name) for one in sound]) for name in ("error_mm", "least_mm"))
    covered = [
        100 * np.mean([one.corners <= 1 for one in sound]),
        100 * np.mean([one.place_covered for one in sound]),
    ]
    return (
        f"| {case.name} | {case.frames} | {100 * case.wrong:.0f} % "
        f"| {np.sqrt(np.mean(error**2)):.2f} mm | {np.sqrt(np.mean(least**2)):.2f} mm "
        f"| {np.sqrt(np.mean((error / least) ** 2)):.2f} | {len(sound)} of {len(all_of)} "
        f"| {covered[0]:.1f} % | {covered[1]:.1f} % | {1e3 * np.median([one.seconds for one in all_of]):.0f} ms |"
    )


def table(seeds: range, rows: str = "") -> Iterator[str]:
    """Of scenes with noise, line by line."""
    yield "| target | frames | outliers | error | least | over it | found | covered | target | time |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for case in CASES:
        if rows in f"{case.name} {case.frames} {case.wrong:g}":
            yield row_of(case, seeds)


def exact_table(seeds: range, rows: str = "") -> Iterator[str]:
    """Of scenes without noise, line by line."""
    yield "| target | frames | image | exact to 1e-6 mm |"
    yield "|---|---|---|---|"
    for case in EXACT:
        if rows not in f"{case.name} {case.frames}":
            continue
        found = 0
        for seed in seeds:
            scene = sweep(
                case.kind, case.frames, seed, dimension=case.dimension, points_each=case.points_each
            )
            try:
                answer = registered(scene, case.kind, trusted=True)
            except SonocalError:
                continue
            found += bool(off_mm(answer, scene, image_points(case.dimension)).max() < EXACT_MM)
        yield f"| {case.name} | {case.frames} | {case.dimension}D | {found} of {len(seeds)} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table, and write it into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--write", type=Path, help="page whose table to replace")
    parser.add_argument("--rows", default="", help="only rows that say this, such as 'plane 60'")
    parser.add_argument("--exact", action="store_true", help="of scenes without noise, instead")
    parser.add_argument("--motions", action="store_true", help="of motions that tell too little, instead")
    parser.add_argument("--known", action="store_true", help="beside targets whose place is known, instead")
    asked = parser.parse_args(arguments)
    seeds = range(asked.first_seed, asked.first_seed + asked.scenes)
    if asked.motions:
        name, lines = "places-motions", motion_table(seeds)
    elif asked.known:
        name, lines = "places-known", known_table(seeds)
    elif asked.exact:
        name, lines = "places-exact", exact_table(seeds, asked.rows)
    else:
        name, lines = "places", table(seeds, asked.rows)
    tell(((name, line) for line in lines), asked.write)


if __name__ == "__main__":
    main()
