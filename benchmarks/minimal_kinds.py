"""Minimal samples of every kind of correspondence, and consensus over them, with the scale unknown and known.

    OMP_NUM_THREADS=1 python -m benchmarks.minimal_kinds [--scenes 400] [--mixes 30] [--write docs/theory.md]

Of samples: processor time of one in a batch, the Python call included, how many are solved exactly without noise (1e-6
of the source's width), and with 0.2 mm on either side how many have no solution, and how far the best one is off, in
parts of that width. Of consensus over 120 correspondences with outliers: how many scenes are right, processor time and
samples (medians).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.mixes import matrix_of, scene_of
from benchmarks.pages import tell
from benchmarks.simulators.mixes import MM_PER_UNIT, SIDE, Array, Mix, Noise, mix_of
from sonocal import _core
from sonocal.registration import constraints, solvers
from sonocal.registration.options import Options

MAKERS = {
    name: getattr(constraints, name.removeprefix("image_"))
    for name in (
        "image_point_plane",
        "image_point_line",
        "image_point_point",
        "image_line_plane",
        "point_plane",
        "point_line",
        "point_point",
        "line_plane",
        "plane_plane",
        "line_line",
    )
}
# Correspondences of a sample with the scale unknown, and known.
COUNTS = {"point_plane": (7, 6), "point_line": (4, 3), "point_point": (3, 3), "line_plane": (4, 3)}
COUNTS |= {"plane_plane": (4, 3), "line_line": (2, 2)}
EXACT, REPEATS = 1e-6, 5
THRESHOLD_MM, RIGHT_MM, SHARES, COUNT = 2.0, 1.0, (0.5, 0.7), 120


def rows_of(mix: Mix) -> constraints.Rows:
    """As the solvers take them."""
    return constraints.rows(*(MAKERS[part.kind](part.source, part.target) for part in mix.parts))


def in_turn(rows: constraints.Rows, count: int) -> Array:
    """So many rows, one of each correspondence in turn, each beginning with another of its own."""
    sizes = np.diff(rows.first)
    order = [
        rows.first[c] + (turn + c) % sizes[c]
        for turn in range(max(sizes))
        for c in range(len(sizes))
        if turn < sizes[c]
    ]
    return np.array(order[:count])


@dataclass(frozen=True)
class Samples:
    """(B, N, 3) points, (B, N, 4) planes, (B, 4, 4) truths."""

    points: Array
    planes: Array
    truths: Array
    planar: bool

    @classmethod
    def of(cls, kind: str, count: int, rows: int, seeds: range, noise: Noise) -> Samples:
        """One of each seed."""
        made = []
        for seed in seeds:
            mix = mix_of({kind: count}, seed, noise)
            of_mix = rows_of(mix)
            chosen = in_turn(of_mix, rows)
            made.append((of_mix.points[chosen], of_mix.planes[chosen], mix.truth))
        points, planes, truths = (np.ascontiguousarray(np.stack(each)) for each in zip(*made, strict=True))
        return cls(points, planes, truths, kind.startswith("image"))

    def pairs(self) -> tuple[Array, Array]:
        """(B, 3, 3) points and places, where rows are three of each of three points on points, in turn."""
        own = self.planes.reshape(len(self.planes), 3, 3, 4)
        places = -np.einsum("btcx,btc->bcx", own[..., :3], own[..., 3])
        return np.ascontiguousarray(self.points[:, :3]), np.ascontiguousarray(places)

    def errors(self, matrices: Array) -> Array:
        """(B,): of the source's corners, the best solution's, in parts of its width; infinite where there is none."""
        corners = SIDE * np.indices((2, 2, 1 if self.planar else 2)).reshape(3, -1).T.astype(float)

        def carried(by: Array) -> Array:
            return corners @ np.swapaxes(by[..., :3, :3], -1, -2) + by[..., None, :3, 3]

        off = np.linalg.norm(carried(matrices) - carried(self.truths)[:, None], axis=-1).max(axis=-1)
        best: Array = np.where(np.isnan(off), np.inf, off).min(axis=1)
        return best / (SIDE * MM_PER_UNIT)


Call = Callable[[Samples], solvers.Solutions]


def by_conics(s: Samples) -> solvers.Solutions:
    """Seven rows of an image."""
    return solvers.two_conics(np.ascontiguousarray(s.points[..., :2]), s.planes)


def by_quadrics(s: Samples) -> solvers.Solutions:
    """Seven rows."""
    return solvers.three_quadrics(s.points, s.planes)


def at_scale(s: Samples) -> solvers.Solutions:
    """Six rows of a known scale."""
    return solvers.three_quadrics(s.points, s.planes, scale=MM_PER_UNIT)


def by_points(s: Samples) -> solvers.Solutions:
    """Three points on three points."""
    return solvers.three_points(*s.pairs())


def ns_of(call: Call, samples: Samples) -> float:
    """Processor time of one sample, the least of several runs."""
    times = []
    for _ in range(REPEATS):
        begin = time.process_time_ns()
        call(samples)
        times.append(time.process_time_ns() - begin)
    return min(times) / len(samples.points)


def sample_rows(scenes: int) -> Iterator[str]:
    """The table of samples, line by line."""
    yield "| sample | solver | ns | solutions | exact | noise: none | error of the best, median, 90 % |"
    yield "|---|---|---|---|---|---|---|"
    for kind in MAKERS:
        free, known = COUNTS[kind.removeprefix("image_")]
        tried: list[tuple[str, Call, int, int]] = [("three_quadrics", by_quadrics, free, 7)]
        if kind.startswith("image"):
            tried.append(("two_conics", by_conics, free, 7))
        tried.append(("three_quadrics, scale known", at_scale, known, 6))
        if kind.endswith("point_point"):
            tried.append(("three_points", by_points, free, 9))
        for name, call, count, rows in tried:
            exact = Samples.of(kind, count, rows, range(scenes), Noise(0.0, 0.0))
            noisy = Samples.of(kind, count, rows, range(scenes, 2 * scenes), Noise())
            found, off = call(exact), noisy.errors(call(noisy).matrices)
            solved = np.mean(exact.errors(found.matrices) < EXACT)
            yield (
                f"| {count} {kind.replace('_', '-')} | {name} | {ns_of(call, exact):.0f} | "
                f"{np.mean(found.count):.2f} | "
                f"{100 * solved:.2f} % | {100 * np.mean(np.isinf(off)):.1f} % | {np.median(off):.1e}, "
                f"{np.quantile(off, 0.9, method='lower'):.1e} |"
            )


def consensus_of(kind: str, share: float, known: bool, seeds: range) -> str:
    """Right answers, time and samples."""
    right, took, samples = 0, [], []
    told = {"model": "rigid", "scale_mm_per_px": MM_PER_UNIT} if known else {}
    options = Options.of(weighting="geometric", threshold_mm=THRESHOLD_MM, **told).to_core(0, 0)
    for seed in seeds:
        mix = scene_of({kind: COUNT}, share, seed)
        rows = rows_of(mix)
        table = rows.core if rows.lines is None else rows.lines.core
        call = _core.estimate_correspondences if rows.lines is None else _core.estimate
        begin = time.process_time_ns()
        found = call(table, options)
        took.append(1e-6 * (time.process_time_ns() - begin))
        samples.append(found.samples)
        corners = mix.corners if not kind.startswith("image") else mix.corners[mix.corners[:, 2] == 0]
        off = matrix_of(found) - mix.truth
        right += bool(
            np.sqrt(np.mean(np.sum((corners @ off[:3, :3].T + off[:3, 3]) ** 2, axis=1))) <= RIGHT_MM
        )
    return f"{right} of {len(seeds)} | {np.median(took):.2f} ms | {np.median(samples):.0f}"


def consensus_rows(scenes: int) -> Iterator[str]:
    """The table of consensus, line by line."""
    yield "| 120 of | wrong | right | time | samples | of a known scale: right | time | samples |"
    yield "|---|---|---|---|---|---|---|---|"
    for kind in MAKERS:
        for share in SHARES:
            cells = [consensus_of(kind, share, known, range(scenes)) for known in (False, True)]
            yield f"| {kind.replace('_', '-')} | {100 * share:.0f} % | {' | '.join(cells)} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the tables, and write them into a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--scenes", type=int, default=400, help="of samples, of each kind")
    parser.add_argument("--mixes", type=int, default=30, help="of consensus, of each kind and share")
    parser.add_argument("--write", type=Path, help="page whose tables to replace")
    asked = parser.parse_args(arguments)

    def lines() -> Iterator[tuple[str, str]]:
        yield from (("minimal-kinds", line) for line in sample_rows(asked.scenes))
        yield ("", "")
        yield from (("minimal-consensus", line) for line in consensus_rows(asked.mixes))

    tell((line for line in lines() if line[0] or not asked.write), asked.write)


if __name__ == "__main__":
    main()
