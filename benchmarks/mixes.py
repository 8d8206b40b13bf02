"""Mixes of points, lines and planes of which most are wrong: how often `register` is right, and how long it takes.

    OMP_NUM_THREADS=1 python -m benchmarks.mixes [--scenes 200] [--write docs/registration.md]

Times are processor time, the least of several repeats of each of a few scenes, their median; ratios are of one run.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.mix_peers import Scene, ransac, refined, teaser_like
from benchmarks.pages import tell
from benchmarks.simulators.mixes import Array, Mix, mix_of, with_strangers
from sonocal import _core
from sonocal import registration as reg
from sonocal.registration.options import Options

THRESHOLD_MM = 2.0
# The corners of the source, a cube 200 mm wide, this near to the truth (root mean square).
RIGHT_MM = 1.0
TIMED_SCENES = 5
Call = Callable[[], Array]


def scene_of(kinds: dict[str, int], share: float, seed: int) -> Mix:
    """With a share of all targets, on average, taken from another scene."""
    return with_strangers(mix_of(kinds, seed), share, seed)


def rows_of(mix: Mix) -> reg.Rows:
    """As `register` takes them."""
    return reg.rows(
        *(getattr(reg, part.kind.removeprefix("image_"))(part.source, part.target) for part in mix.parts)
    )


def core_call(rows: reg.Rows) -> Call:
    """The core alone, its table made once."""
    options = Options.known(
        "similarity", "likelihood", THRESHOLD_MM, None, None, 0.9999, 10_000, Options.exhaustive_samples, 0
    ).to_core(0, 0)
    if rows.lines is not None:
        table = rows.lines.core
        return lambda: matrix_of(_core.estimate(table, options))
    table = rows.core
    return lambda: matrix_of(_core.estimate_correspondences(table, options))


def matrix_of(found: _core.Estimate) -> Array:
    """(4, 4)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = found.rotation * found.scales, found.translation
    return out


def register_call(rows: reg.Rows) -> Call:
    """All that a caller waits for."""
    return lambda: reg.register(rows, threshold_mm=THRESHOLD_MM).target_from_source.matrix


def error_mm(mix: Mix, matrix: Array) -> float:
    """Of the corners of the source, root mean square."""
    off = mix.corners @ (matrix - mix.truth)[:3, :3].T + (matrix - mix.truth)[:3, 3]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def least_ms(call: Call, repeats: int) -> float:
    """Processor time of the quickest."""
    times = []
    for _ in range(repeats):
        start = time.process_time_ns()
        call()
        times.append(time.process_time_ns() - start)
    return min(times) / 1e6


class Method:
    """How long it takes, and how far its answers are off, scene by scene."""

    def __init__(self, name: str, repeats: int) -> None:
        self.name, self.repeats = name, repeats
        self.ms: list[float] = []
        self.errors: list[float] = []

    def run(self, mix: Mix, call: Call) -> None:
        """One scene more."""
        self.errors.append(error_mm(mix, call()))
        if len(self.ms) < TIMED_SCENES:
            self.ms.append(least_ms(call, self.repeats))

    def row(self, of: float) -> str:
        """Of the table; `of`: the time to compare with, ms."""
        took = statistics.median(self.ms)
        right = sum(error <= RIGHT_MM for error in self.errors)
        return (
            f"| {self.name} | {took:.3g} ms | {took / of:.3g} | {right} of {len(self.errors)} | "
            f"{statistics.median(self.errors):.3f} mm |"
        )

    @property
    def took(self) -> float:
        """Median over scenes, ms."""
        return statistics.median(self.ms)


HEAD = "| {} | time | ratio | right | median error |\n|---|---|---|---|---|"


def points_on_lines(scenes: int) -> str:
    """200 points of a volume, and of an image, each on its own line."""
    out = [HEAD.format("points on lines")]
    for kind, share in (
        ("image_point_line", 0.6),
        ("point_line", 0.0),
        ("point_line", 0.6),
        ("point_line", 0.8),
    ):
        name = f"200 {'of an image' if kind == 'image_point_line' else 'in space'}, {100 * share:.0f} % wrong"
        core, whole = Method(f"{name}: the core", 30), Method(f"{name}: `register`", 10)
        for seed in range(scenes):
            mix = scene_of({kind: 200}, share, seed)
            rows = rows_of(mix)
            core.run(mix, core_call(rows))
            whole.run(mix, register_call(rows))
        out += [core.row(core.took), whole.row(core.took)]
    return "\n".join(out)


def reconstructions(scenes: int, peer_scenes: int) -> str:
    """Two models of a scene made of lines and planes, in units of their own."""
    out = [HEAD.format("500 lines and 500 planes")]
    for share in (0.0, 0.6, 0.8):
        name = f"{100 * share:.0f} % wrong"
        core, whole, teaser, sampled = (
            Method(f"{name}: {what}", repeats)
            for what, repeats in (
                ("the core", 20),
                ("`register`", 5),
                ("decoupled, graduated (as TEASER)", 1),
                ("RANSAC and SciPy", 1),
            )
        )
        knowing = Method(f"{name}: SciPy, told which are right", 1)
        for seed in range(scenes):
            mix = scene_of({"line_line": 500, "plane_plane": 500}, share, seed)
            rows = rows_of(mix)
            core.run(mix, core_call(rows))
            whole.run(mix, register_call(rows))
            if seed >= peer_scenes:
                continue
            scene = Scene.of_mix(mix)
            teaser.run(mix, lambda s=scene: teaser_like(s, THRESHOLD_MM))  # type: ignore[misc]
            sampled.run(mix, lambda s=scene, i=seed: ransac(s, THRESHOLD_MM, i))  # type: ignore[misc]
            sound = scene.squares(mix.truth) <= THRESHOLD_MM**2
            knowing.run(mix, lambda s=scene, m=mix, k=sound: refined(s, m.truth, k))  # type: ignore[misc]
        out += [method.row(core.took) for method in (core, whole, teaser, sampled, knowing)]
    return "\n".join(out)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", type=int, default=200)
    parser.add_argument("--peer-scenes", type=int, default=20)
    parser.add_argument("--write", type=Path, help="into this page, between its marks")
    given = parser.parse_args()
    tables = points_on_lines(given.scenes) + "\n\n" + reconstructions(given.scenes, given.peer_scenes)
    tell([("mixes", tables)], given.write)


if __name__ == "__main__":
    main()
