"""Whether `register` refuses what chance would give, takes what is sound, and errs by as much as it says.

python -m benchmarks.register_trust [--sets 1000] [--first-seed 0] [--write docs/trust.md]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import f as fisher

import sonocal as sc
from benchmarks.pages import tell
from benchmarks.simulators.mixes import Mix, mix_of, planes_through, with_strangers
from sonocal.registration import Registration, constraints, register
from sonocal.registration.uncertainty import point_covariance, radius_95

# Of planes the numbers alone are given, as whoever has no points of them would.
MAKERS = {
    "point_plane": lambda source, target: constraints.point_plane(source, planes_through(target)),
    "point_line": constraints.point_line,
    "image_point_line": constraints.point_line,
    "point_point": constraints.point_point,
    "line_line": constraints.line_line,
    "line_plane": lambda source, target: constraints.line_plane(source, planes_through(target)),
    "plane_plane": lambda source, target: constraints.plane_plane(
        planes_through(source), planes_through(target)
    ),
}
THRESHOLD_MM = 5.0
SETS: tuple[dict[str, int], ...] = (
    *({"point_plane": count} for count in (9, 20, 100)),
    *({"point_line": count} for count in (6, 20, 100)),
    *({"image_point_line": count} for count in (6, 20, 100)),
    *({"point_point": count} for count in (4, 20, 100)),
    *({"line_line": count} for count in (4, 20, 100)),
    *({"line_plane": count} for count in (8, 20, 100)),
    *({"plane_plane": count} for count in (8, 20, 100)),
    {"point_plane": 5, "line_line": 3, "plane_plane": 4},
    {"point_plane": 20, "line_plane": 20, "point_point": 20},
)


def registered(mix: Mix, *, robust: bool = True) -> Registration | None:
    """What `register` makes of a mix; None: refused."""
    parts = [MAKERS[part.kind](part.source, part.target) for part in mix.parts]
    try:
        return register(constraints.rows(*parts), robust=robust, threshold_mm=THRESHOLD_MM)
    except sc.SonocalError:
        return None


def corners_covered(mix: Mix, found: Registration) -> tuple[float, bool]:
    """The share of corners that are within the 95 % stated, and whether the truth is in the 95 % region."""
    assert found.covariance is not None
    similarity = found.target_from_source
    there = mix.corners @ mix.truth[:3, :3].T + mix.truth[:3, 3]
    off = np.linalg.norm(similarity @ mix.corners - there, axis=1)
    bound = radius_95(point_covariance(similarity, found.covariance, mix.corners), found.freedom)
    truth = sc.Similarity.from_matrix(mix.truth)
    turn = np.asarray(sc.Similarity(truth.rotation @ similarity.rotation.T, np.zeros(3), 1.0).quaternion_wxyz)
    angle = 2 * np.arctan2(np.linalg.norm(turn[1:]), turn[0])
    axis = turn[1:] / max(float(np.linalg.norm(turn[1:])), 1e-300)
    error = np.r_[
        angle * axis,
        truth.translation - similarity.translation,
        np.log(float(truth.scale) / float(similarity.scale)),
    ]
    region = 7 * float(fisher.ppf(0.95, 7, found.freedom))
    return float(np.mean(off <= bound)), bool(error @ np.linalg.solve(found.covariance, error) <= region)


def row_of(kinds: dict[str, int], seeds: range) -> str:
    """A line of the table."""
    counted = {"random": 0, "all of them": 0, "sound": 0, "a third": 0}
    corners, inside = [], []
    for seed in seeds:
        strange = mix_of(kinds, seed, related=False)
        counted["random"] += registered(strange) is not None
        counted["all of them"] += registered(strange, robust=False) is not None
        mix = mix_of(kinds, seed)
        found = registered(mix)
        counted["sound"] += found is None
        counted["a third"] += registered(with_strangers(mix, 0.3, seed)) is None
        if found is not None and found.covariance is not None:
            share, held = corners_covered(mix, found)
            corners.append(share)
            inside.append(held)
    name = ", ".join(f"{count} {kind.replace('_', '-')}" for kind, count in kinds.items())
    cells = " | ".join(str(count) for count in counted.values())
    return f"| {name} | {len(seeds)} | {cells} | {100 * np.mean(corners):.1f} % | {100 * np.mean(inside):.1f} % |"


def table(seeds: range) -> Iterator[str]:
    """The table, line by line."""
    yield (
        "| correspondences | sets | random: accepted | random, robust=False: accepted | sound: refused "
        "| 30 % strangers: refused | corners within the 95 % bound | truth in the 95 % region |"
    )
    yield "|---|---|---|---|---|---|---|---|"
    for kinds in SETS:
        yield row_of(kinds, seeds)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table, and write it into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--sets", type=int, default=1000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--write", type=Path, help="page whose table to replace")
    asked = parser.parse_args(arguments)
    found = table(range(asked.first_seed, asked.first_seed + asked.sets))
    tell((("register", line) for line in found), asked.write)


if __name__ == "__main__":
    main()
