"""Call every function of the compiled core with hostile arrays: it may refuse, with a sentence, and nothing else.

    scripts/sanitize                     builds the core with the sanitizers and makes a few thousand calls
    CALLS=100000 scripts/sanitize        as many as one wants

    python scripts/fuzz_core.py --module build/sanitize/_core.so [--calls 100000] [--seed 0]

Lengths that disagree, codes that are negative or huge, NaN and 1e300, empty and strided arrays, options beyond all
sense, and sound shapes full of degenerate geometry. Calls are made by child processes, a few thousand each; one that
dies, or takes longer than a minute for a call, is named with the seed that repeats it.
"""

from __future__ import annotations

import argparse
import faulthandler
import importlib.util
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

CALLS_A_CHILD = 2000
LONGEST_CALL_S = 60
REFUSALS = (ValueError, TypeError)
NUMBERS = [0.0, -0.0, 1.0, -1.0, 1e-300, 1e59, 1e61, 1e200, 1e308, -1e308, np.nan, np.inf, -np.inf, 5e-324]
CODES = [-(2**31), -1, 0, 1, 2, 7, 1000, 2**31 - 1]
COUNTS = [-(2**31), -1, 0, 1, 2, 3, 64, 2**20 + 1, 2**31 - 1]

Call = Callable[[], Any]


def main() -> int:
    """Make the calls, in children; 1 if one of them died."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--module", type=Path, required=True, help="the compiled core")
    parser.add_argument("--calls", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=0, help="of the first child; the next ones count on")
    parser.add_argument("--child", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        make_calls(load(arguments.module), arguments.calls, arguments.seed)
        return 0
    children = -(-arguments.calls // CALLS_A_CHILD)
    died = [
        seed for seed in range(arguments.seed, arguments.seed + children) if not survives(arguments, seed)
    ]
    for seed in died:
        print(f"died: --seed {seed} --calls {CALLS_A_CHILD}")
    print(f"{children * CALLS_A_CHILD} hostile calls of the core, {len(died)} of {children} processes died")
    return 1 if died else 0


def survives(arguments: argparse.Namespace, seed: int) -> bool:
    """Whether a child made all of its calls."""
    command = [sys.executable, __file__, "--child", "--module", str(arguments.module), "--seed", str(seed)]
    return subprocess.run([*command, "--calls", str(CALLS_A_CHILD)], check=False).returncode == 0


def load(path: Path) -> ModuleType:
    """The compiled core by its file, without the package round it."""
    spec = importlib.util.spec_from_file_location("_core", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def make_calls(core: ModuleType, calls: int, seed: int) -> None:
    """So many calls; whatever is not a refusal ends the process with its traceback."""
    hostile = Hostile(core, np.random.default_rng(seed))
    for _ in range(calls):
        faulthandler.dump_traceback_later(LONGEST_CALL_S, exit=True)
        try:
            hostile.call()
        except REFUSALS as refusal:
            assert str(refusal), "a refusal without a word"
    faulthandler.cancel_dump_traceback_later()


class Hostile:
    """Calls with arguments that are wrong in a few ways, or in none.

    Args:
        core: the compiled core.
        rng: where everything random comes from.
    """

    def __init__(self, core: ModuleType, rng: np.random.Generator) -> None:
        self.core, self.rng = core, rng
        self.kinds: list[Call] = [
            *(self.estimate, self.refine, self.white_residuals, self.correspondences),
            *(self.solver, self.linear, self.detect, self.trials, self.bounds, self.by_chance),
        ]

    def call(self) -> Any:
        """One call of any kind."""
        # How much is wrong: nothing, here and there a thing, or as often as not.
        self.wrong = self.rng.choice([0.0, 0.02, 0.5])
        return self.kinds[self.rng.integers(len(self.kinds))]()

    # What calls are made of

    def off(self) -> bool:
        """Whether the next thing is wrong."""
        return bool(self.rng.random() < self.wrong)

    def one_of(self, values: list[Any]) -> Any:
        return values[self.rng.integers(len(values))]

    def rows(self) -> int:
        return self.one_of(CODES[2:7]) if self.off() else int(self.rng.integers(1, 40))

    def length(self, rows: int) -> int:
        """As long as it must be, or not."""
        return max(0, rows + self.one_of([-rows, -1, 1, 5])) if self.off() else rows

    def array(self, *shape: int) -> np.ndarray:
        """Numbers that are sound, or degenerate, with wrong ones among them, in memory of any kind."""
        values = self.rng.uniform(-300, 300, shape)
        if self.rng.random() < 0.2:
            values = np.round(values, self.one_of([-2, -3]))  # many alike, many zero
        if self.off() and values.size:
            values.reshape(-1)[self.rng.integers(values.size)] = self.one_of(NUMBERS)
        if self.off():
            values = self.one_of([np.asfortranarray, np.float32, np.int64, lambda x: x[..., ::2], np.ravel])(
                np.nan_to_num(values, posinf=1, neginf=1).clip(-1e9, 1e9)
            )
        return np.asarray(values)

    def codes(self, rows: int, most: int) -> np.ndarray | None:
        """Groups of rows counted from 0, or whatever."""
        length = self.length(rows)
        codes = np.sort(self.rng.integers(0, max(1, most), length)).astype(np.int32)
        if length:
            codes = np.unique(codes, return_inverse=True)[1].reshape(-1).astype(np.int32)
        if self.off() and length:
            codes[self.rng.integers(length)] = self.one_of(CODES)
        return None if self.rng.random() < 0.2 else codes

    def factors(self, rows: int) -> np.ndarray | None:
        return np.abs(self.array(self.length(rows))) + 0.1 if self.rng.random() < 0.3 else None

    def number(self, usual: float) -> float:
        return self.one_of(NUMBERS) if self.off() else usual

    def count(self, usual: int) -> int:
        return self.one_of(COUNTS) if self.off() else usual

    def table(self) -> Any:
        """A table of points and lines: any, or one image line a sighting."""
        rows, dimension = self.rows(), self.count(self.one_of([2, 3]))
        points = self.array(self.length(rows), 3)
        if dimension == 2 and not self.off() and points.ndim == 2:
            points[:, 2:] = 0
        segments = self.array(self.length(rows), 2, 3)
        if self.rng.random() < 0.3 and segments.ndim == 3 and len(segments):
            segments[:] = segments[:1]  # parallel, or one line
        sightings = self.codes(rows, max(1, rows // 2)) if dimension != 2 or self.off() else None
        frames, targets = self.codes(rows, 9), self.codes(rows, 3)
        noise = self.factors(rows), self.factors(rows)
        return self.core.Table.of_lines(
            points, segments, sightings, frames, targets, *noise, dimension=dimension
        )

    def planes(self) -> Any:
        """A table of points and planes in correspondences."""
        rows = self.rows()
        cuts = np.sort(self.rng.choice(np.arange(1, max(2, rows)), max(0, min(rows - 1, 12)), replace=False))
        first = np.array([0, *cuts, rows], dtype=np.int32)
        if self.off():
            first[self.rng.integers(len(first))] = self.one_of(CODES)
        if self.off():
            first = first[: self.rng.integers(len(first) + 1)]
        planes = self.array(self.length(rows), 4)
        return self.core.Table.of_planes(self.array(self.length(rows), 3), planes, first)

    def options(self) -> Any:
        return self.core.Options(
            model=self.one_of(["similarity", "similarity", "anisotropic", ""]),
            weighting=self.one_of(["likelihood", "geometric"]),
            threshold=self.number(self.one_of([0.0, 5.0, 1e-9, np.inf])),
            level_px=self.number(self.one_of([0.0, 1.0])),
            level_mm=self.number(self.one_of([0.0, 1.0])),
            confidence=self.number(0.99),
            # Asked for 2^30 samples the core would draw them: that is no fault.
            max_samples=self.one_of(COUNTS[:7]) if self.off() else 50,
            exhaustive_samples=self.one_of(COUNTS[:7]) if self.off() else 200,
            seed=int(self.rng.integers(2**63)),
        )

    def transform(self) -> Any:
        turn, _ = np.linalg.qr(self.rng.normal(size=(3, 3)))
        scales = np.full(3, self.number(0.2))
        rotation = self.array(3, 3) if self.off() else np.ascontiguousarray(turn)
        return self.core.Transform(rotation, self.array(self.length(3)), scales)

    def chosen(self, rows: int) -> np.ndarray:
        return self.rng.random(self.length(rows)) < self.one_of([0.0, 0.1, 0.7, 1.0])

    # The calls

    def estimate(self) -> Any:
        return read(self.core.estimate(self.table(), self.options()))

    def refine(self) -> Any:
        table = self.table()
        return read(self.core.refine(table, self.chosen(len(table)), self.transform(), self.options()))

    def white_residuals(self) -> Any:
        table = self.table()
        return read(
            self.core.white_residuals(table, self.chosen(len(table)), self.transform(), self.options())
        )

    def correspondences(self) -> Any:
        refine = bool(self.rng.random() < 0.5)
        return read(self.core.estimate_correspondences(self.planes(), self.options(), refine=refine))

    def solver(self) -> Any:
        batch = self.one_of([(), (1,), (3,), (2, 3), (0,), (70,)])
        name, first, second = self.one_of(
            [
                ("four_points", (4, 2), (4, 2, 3)),
                ("two_lines", (2, 2, 3), (2, 2, 3)),
                ("three_quadrics", (7, 3), (7, 4)),
                ("three_quadrics", (9, 3), (9, 4)),
                ("paper_two_lines", (4, 3), (4, 2, 3)),
                ("paper_four_points", (4, 2), (4, 2, 3)),
            ]
        )
        arrays = [self.array(*batch, *(self.length(n) for n in shape)) for shape in (first, second)]
        options: list[float] = [self.count(1)]
        if not name.startswith("paper"):
            options = [self.count(self.one_of([0, 2])), self.number(0.0), *options]
        return getattr(self.core, name)(*arrays, *options)

    def linear(self) -> Any:
        rows = self.rows()
        arrays = self.array(2, self.length(rows), 3), self.array(2, self.length(rows), 4)
        return self.core.linear(*arrays, bool(self.rng.random() < 0.5), self.count(1))

    def detect(self) -> Any:
        rows, cols = self.rows(), self.rows()
        mask = (self.rng.random((rows, cols)) < self.one_of([0.0, 0.5, 1.0])).astype(np.uint8)
        scales = [self.number(s) for s in np.cumsum(self.rng.uniform(0.3, 2, self.rng.integers(0, 5)))]
        found = self.core.BlobFilter(mask, scales, self.count(self.one_of([1, 2, 5])))
        image = self.rng.uniform(0, 255, (self.length(rows), cols)).astype(np.float32)
        if self.off() and image.size:
            image.reshape(-1)[0] = self.one_of(NUMBERS[-5:])
        limits = [self.number(x) for x in (4.0, 1.0, 0.5, 0.3)]
        return found.detect(image, self.count(5), *limits, bool(self.rng.random() < 0.5))

    def trials(self) -> Any:
        trials, rows, dimension = int(self.rng.integers(0, 4)), self.rows(), self.count(self.one_of([2, 3]))
        points = self.array(trials, rows, 3)
        if dimension == 2 and points.ndim == 3:
            points[..., 2:] = 0
        return self.core.study_trials(
            points,
            self.array(self.length(trials), rows, 2, 3),
            np.arange(self.length(trials), dtype=np.uint64),
            dimension=dimension,
            solver=self.one_of(["closed_form", "paper_four_points", "paper_two_lines", "linear", "x"]),
            likelihood=bool(self.rng.random() < 0.5),
            threshold_mm=self.number(5.0),
            level_px=self.number(0.0),
            level_mm=self.number(0.0),
            confidence=self.number(0.99),
            max_samples=self.one_of(COUNTS[:7]) if self.off() else 50,
            threads=self.count(1),
        )

    def bounds(self) -> Any:
        trials, rows = int(self.rng.integers(0, 4)), self.rows()
        return self.core.study_bounds(
            self.array(trials, rows, 3),
            self.array(trials, rows, 2, 3),
            self.rng.random((self.length(trials), self.length(rows))) < 0.9,
            np.tile(np.eye(4), (self.length(trials), 1, 1)) if not self.off() else self.array(trials, 4, 4),
            dimension=self.count(self.one_of([2, 3])),
            level_px=self.number(1.0),
            level_mm=self.number(1.0),
            threads=self.count(1),
        )

    def by_chance(self) -> Any:
        """Any function with anything."""
        function = getattr(self.core, self.one_of([n for n in dir(self.core) if not n.startswith("_")]))
        things = [self.array(3, 3), None, "likelihood", 3, -1, np.zeros(0), np.zeros((0, 3)), 1.5, [1, 2]]
        return function(*(self.one_of(things) for _ in range(self.rng.integers(0, 6))))


def read(found: Any) -> None:
    """Look at everything in a result: what it points to must still be there."""
    for name in (n for n in dir(found) if not n.startswith("_")):
        np.sum(getattr(found, name, 0))


if __name__ == "__main__":
    sys.exit(main())
