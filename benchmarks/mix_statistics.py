"""Whether any mix of points, lines and planes is registered as well as can be, and its error is as large as stated.

python -m benchmarks.mix_statistics [--scenes 1000] [--first-seed 0] [--write docs/registration.md] [--exact]

Every row is of so many scenes with noise on both sides, whose levels nobody is told. "over the bound": error of the
source's corners over Cramer's and Rao's in that scene, root mean square; "stated": the errors that the covariances
predict, likewise, over those that were; "covered": the share of corners within the 95 % stated.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from benchmarks.pages import tell
from benchmarks.simulators.mix_bound import corner_error, least_covariance
from benchmarks.simulators.mixes import MM_PER_UNIT, SIDE, Mix, Noise, mix_of
from sonocal.registration import Registration, constraints, register
from sonocal.registration.uncertainty import point_covariance, radius_95

MAKERS = {
    name: getattr(constraints, name.removeprefix("image_"))
    for name in (
        "point_plane",
        "point_line",
        "image_point_line",
        "point_point",
        "line_line",
        "line_plane",
        "plane_plane",
        "image_point_point",
        "image_line_plane",
    )
}
MIXES: tuple[dict[str, int], ...] = (
    {"point_point": 10},
    {"point_line": 20},
    {"point_plane": 40},
    {"line_line": 10},
    {"line_plane": 20},
    {"plane_plane": 10},
    {"line_line": 10, "plane_plane": 10},
    {"point_point": 5, "line_line": 5, "plane_plane": 5},
    {"point_line": 10, "point_plane": 10, "line_plane": 10},
    {"image_point_point": 10},
    {"image_point_line": 20},
    {"image_line_plane": 20},
    {"image_line_plane": 40},
    {"image_point_point": 5, "image_point_line": 10, "image_line_plane": 10},
)


# Of the source's size, in mm: nearer than this an answer is exact.
EXACT = 1e-6 * SIDE * MM_PER_UNIT


def registered(mix: Mix, *, robust: bool = False, scale: float | None = None) -> Registration:
    """A mix, with the likelihood."""
    rows = constraints.rows(*(MAKERS[part.kind](part.source, part.target) for part in mix.parts))
    return register(rows, robust=robust, scale=scale)


def exact_row(kinds: dict[str, int], seeds: range) -> str:
    """How many scenes without noise are registered exactly, with the scale unknown and known."""
    counts = []
    for scale in (None, MM_PER_UNIT):
        found = 0
        for seed in seeds:
            mix = mix_of(kinds, seed, Noise(0.0, 0.0))
            answer = registered(mix, robust=True, scale=scale).target_from_source
            corners = mix.corners if "image" not in next(iter(kinds)) else mix.corners[mix.corners[:, 2] == 0]
            there = corners @ mix.truth[:3, :3].T + mix.truth[:3, 3]
            found += bool(np.abs(answer @ corners - there).max() < EXACT)
        counts.append(f"{found} of {len(seeds)}")
    name = ", ".join(f"{count} {kind.replace('_', '-')}" for kind, count in kinds.items())
    return f"| {name} | {' | '.join(counts)} |"


def row_of(kinds: dict[str, int], seeds: range) -> str:
    """A line of the table."""
    noise, covered = Noise(), []
    actual, stated, bound = [], [], []
    for seed in seeds:
        mix = mix_of(kinds, seed, noise)
        found = registered(mix)
        assert found.covariance is not None
        corners = mix.corners[mix.corners[:, 2] == 0] if "image" in next(iter(kinds)) else mix.corners
        there = corners @ mix.truth[:3, :3].T + mix.truth[:3, 3]
        off = np.linalg.norm(found.target_from_source @ corners - there, axis=1)
        covariances = point_covariance(found.target_from_source, found.covariance, corners)
        covered.append(np.mean(off <= radius_95(covariances, found.freedom)))
        actual.append(np.mean(off**2))
        stated.append(np.mean(np.trace(covariances, axis1=1, axis2=2)))
        bound.append(corner_error(mix.truth, corners, least_covariance(mix, noise)) ** 2)
    over, told = np.mean(np.divide(actual, bound)), np.mean(np.divide(stated, bound))
    name = ", ".join(f"{count} {kind.replace('_', '-')}" for kind, count in kinds.items())
    return (
        f"| {name} | {len(seeds)} | {np.sqrt(np.mean(actual)):.2f} | {np.sqrt(over):.3f} | "
        f"{np.sqrt(told / over):.3f} | {100 * np.mean(covered):.1f} % |"
    )


def exact_table(seeds: range) -> Iterator[str]:
    """Of scenes without noise, line by line."""
    yield "| correspondences | exact | exact, of a known scale |"
    yield "|---|---|---|"
    for kinds in MIXES:
        yield exact_row(kinds, seeds)


def table(seeds: range) -> Iterator[str]:
    """The table, line by line."""
    yield "| correspondences | scenes | error, mm | over the bound | stated | covered |"
    yield "|---|---|---|---|---|---|"
    for kinds in MIXES:
        yield row_of(kinds, seeds)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=1000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--write", type=Path, help="page whose table to replace")
    parser.add_argument("--exact", action="store_true", help="of scenes without noise, instead")
    asked = parser.parse_args(arguments)
    found = (exact_table if asked.exact else table)(range(asked.first_seed, asked.first_seed + asked.scenes))
    tell((("mix-statistics", line) for line in found), None if asked.exact else asked.write)


if __name__ == "__main__":
    main()
