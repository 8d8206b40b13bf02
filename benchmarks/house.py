"""How the house stands: rooms, lengths, tests' share, fits a recording, all measured from the tree.

python -m benchmarks.house [--speed] [--recording]
"""

from __future__ import annotations

import argparse
import ast
import functools
import math
import statistics
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import FunctionType
from typing import Any

from scripts import check_imports

ROOT = check_imports.ROOT
REPEATS, CALLS = 60, 5


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--speed", action="store_true", help="time calibrate() against the core alone")
    parser.add_argument("--recording", action="store_true", help="count the fits of a simulated recording")
    asked = parser.parse_args(arguments)
    rows = [*rooms(), *lengths(), *share_of_tests()]
    rows += [*fits_of_a_recording(), *fits_of_a_recording(3, 40)] if asked.recording else []
    rows += [speed(dimension) for dimension in (2, 3)] if asked.speed else []
    for what, value, wanted in rows:
        print(f"{what:62s} {value:24s} {wanted}", flush=True)


def rooms() -> Iterator[tuple[str, str, str]]:
    """Modules at the root, and what the table of rooms finds."""
    modules = {check_imports.dotted(path): path for path in python_files()}
    arrows = {name: check_imports.imported(path, modules) for name, path in modules.items()}
    against = [one for name in modules for one in check_imports.against_table(name, arrows[name])]
    yield "modules in the root of src/sonocal", str(len([*check_imports.SOURCE.glob("*.py")])), "<= 5"
    yield "circles", str(len([*check_imports.circles(arrows)])), "0"
    yield "arrows upwards, or against the table", str(len(against)), "0"


def lengths() -> Iterator[tuple[str, str, str]]:
    """Lines of calibrate(), of functions, of files; docstrings explain and are not counted in functions."""
    functions = [one for path in python_files() for one in functions_in(path)]
    main_path = next(one for one in functions_in(check_imports.SOURCE / "calibration" / "calibrate.py"))
    yield "lines of calibrate() without its docstring", str(lines_without_docstring(main_path)), "<= 45"
    spans = [lines_without_docstring(one) for one in functions]
    yield "lines a function without docstring, Python, median / 95 %", median_and_p95(spans), "<= 8 / 28"
    # The bounds are what the tree had when its modules stood in no rooms.
    for what, paths, bound in (
        ("Python", python_files(), "152 / 297"),
        ("Python and C++", [*python_files(), *cpp_files()], "125 / 295"),
    ):
        yield f"lines a file, {what}, median / 95 %", median_and_p95(file_lengths(paths)), f"<= {bound}"


def file_lengths(paths: Iterable[Path]) -> list[int]:
    return [len(text(path).splitlines()) for path in paths]


def share_of_tests() -> Iterator[tuple[str, str, str]]:
    """Non-blank lines of tests among all."""
    tests = not_blank([*(ROOT / "tests").rglob("*.py"), *sources(ROOT / "cpp" / "tests")])
    code = not_blank([*python_files(), *cpp_files()])
    yield "tests' share of the lines that are not blank", f"{100 * tests / (tests + code):.1f} %", ">= 33 %"


def fits_of_a_recording(dimension: int = 2, frames: int = 120) -> Iterator[tuple[str, str, str]]:
    """How often a simulated recording is calibrated in full, and how often a transform is fitted at all."""
    import sonocal as sc
    from sonocal.calibration.calibrate import calibrate
    from sonocal.registration.best_fit import best_fit
    from sonocal.simulation.sweep import SweepOptions, simulate_sweep
    from sonocal.simulation.ultrasound_probe import curvilinear_3d

    probe = curvilinear_3d(64, 1.8) if dimension == 3 else None
    sweep = simulate_sweep(probe, options=SweepOptions(frames=frames, rate_hz=8, seed=0))
    with counting(calibrate, best_fit) as calls:
        sc.calibrate_recording(sweep.recording, sweep.lines)
    full, fits = calls["calibrate"], calls["best_fit"]
    images = "volumes" if dimension == 3 else "images"
    yield f"calls of calibrate() for a recording of {frames} {images}", str(full), "as few as needed"
    yield "fits without covariance and findings, for the same", str(fits - full), ""


def speed(dimension: int) -> tuple[str, str, str]:
    """Processor time of calibrate() on 50 rows and of the core alone, its table and options made before."""
    import sonocal as sc
    from sonocal import _core
    from sonocal.calibration.options import Options
    from sonocal.calibration.rows import point_line_rows
    from sonocal.simulation.scene import simulate_observations

    needles = 50 if dimension == 2 else 25  # two rows a needle in 3D
    observations = simulate_observations(dimension, needles, outlier_share=0.2, seed=0).observations
    rows = point_line_rows(observations)
    table, options = rows.core, rows.core_options(Options())
    python, core = least_us(lambda: sc.calibrate(observations), lambda: _core.estimate(table, options))
    what = f"calibrate() against the core alone, {len(observations)} rows in {dimension}D"
    return what, f"{python / core:.1f} x ({python:.0f} / {core:.0f} us)", "<= 5 x"


def least_us(*functions: Callable[[], object]) -> list[float]:
    """The least processor time of a call of each, us, taken in turn so that all meet the same machine."""
    least = [math.inf] * len(functions)
    for _ in range(REPEATS):
        for index, function in enumerate(functions):
            begin = time.process_time()
            for _ in range(CALLS):
                function()
            least[index] = min(least[index], 1e6 * (time.process_time() - begin) / CALLS)
    return least


@contextmanager
def counting(*functions: Callable[..., Any]) -> Iterator[Counter[str]]:
    """Counts calls of functions, under whatever name the package's modules hold them."""
    calls: Counter[str] = Counter()

    def counted(function):
        @functools.wraps(function)
        def call(*arguments, **keywords):
            calls[function.__name__] += 1
            return function(*arguments, **keywords)

        return call

    stand_ins = {function: counted(function) for function in functions}
    put_in_place_of(stand_ins)
    try:
        yield calls
    finally:  # also in modules that were imported meanwhile
        put_in_place_of({stand_in: function for function, stand_in in stand_ins.items()})


def put_in_place_of(others: dict[Callable[..., Any], Callable[..., Any]]) -> None:
    """Exchanges functions wherever the package's modules hold them."""
    package = [module for name, module in sys.modules.items() if name.partition(".")[0] == "sonocal"]
    held = [(vars(module), name, value) for module in package for name, value in vars(module).items()]
    for place, name, value in held:
        if isinstance(value, FunctionType) and value in others:
            place[name] = others[value]


def functions_in(path: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    """Functions and methods of a file, nested ones too."""
    tree = ast.walk(ast.parse(text(path)))
    return [node for node in tree if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def lines_without_docstring(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """From def to its end; comments and blank lines count."""
    first, end = function.body[0], function.end_lineno or function.lineno
    documented = ast.get_docstring(function) is not None
    docstring = (first.end_lineno or first.lineno) - first.lineno + 1 if documented else 0
    return end - function.lineno + 1 - docstring


def python_files() -> list[Path]:
    return sorted(check_imports.SOURCE.rglob("*.py"))


def cpp_files() -> list[Path]:
    return [*sources(ROOT / "cpp" / "sonocal"), *sources(ROOT / "cpp" / "bind")]


def sources(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix in (".cpp", ".hpp"))


def text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def not_blank(paths: Iterable[Path]) -> int:
    return sum(bool(line.strip()) for path in paths for line in text(path).splitlines())


def median_and_p95(values: Sequence[int]) -> str:
    p95 = sorted(values)[math.ceil(0.95 * len(values)) - 1]
    return f"{statistics.median(values):g} / {p95}"


if __name__ == "__main__":
    main()
