"""Minimal solvers against their public peers: one run, the same problems.

    python -m benchmarks.solvers                    the tables
    python -m benchmarks.solvers --save             and keep it as the baseline
    python -m benchmarks.solvers --compare          and say what got slower or less sure; exit 1 then

Times are the least of several runs, the Python call included; a peer without batches is called once a
problem. Ratios of one run mean something, times of two runs hardly.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import timeit
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from sonocal.registration import constraints, solvers

BASELINE = Path(__file__).with_name("baseline.json")
SCALE, IMAGE_PX, NEEDLE_MM = 0.24, 500.0, 400.0
TIMED, CHECKED = 10_000, 100_000
REPEATS = 7


@dataclass(frozen=True)
class Problems:
    """Four image points (B, 4, 3), a line each (B, 4, 2, 3), the truth (B, 4, 4)."""

    points: np.ndarray
    segments: np.ndarray
    truth: np.ndarray

    def first(self, count: int) -> Problems:
        return Problems(self.points[:count], self.segments[:count], self.truth[:count])

    def noisy(self, seed: int) -> Problems:
        """1 px on the points, 1 mm on the needles' ends; both rows of a needle share its ends' noise."""
        random = np.random.default_rng(seed)
        planar = np.ptp(self.points[..., 2]) == 0
        points = self.points + random.normal(size=self.points.shape) * ([1, 1, 0] if planar else [1, 1, 1])
        ends = random.normal(size=self.segments.shape)
        return Problems(
            points, self.segments + (ends if planar else np.repeat(ends[:, ::2], 2, axis=1)), self.truth
        )


@dataclass(frozen=True)
class Solver:
    """`solve` prepares a call that gives (B, K, 4, 4), NaN where there is no solution."""

    name: str
    planar: bool
    solve: Callable[[Problems], Callable[[], np.ndarray]]
    most: int = CHECKED  # how many problems it is worth waiting for
    # The bare call, where `solve` does more.
    clocked: Callable[[Problems], Callable[[], object]] | None = None


def problems(planar: bool, count: int, seed: int) -> Problems:
    random = np.random.default_rng(seed)
    points = random.uniform(0, IMAGE_PX, (count, 4, 3)) * ([1, 1, 0] if planar else [1, 1, 1])
    q, r = np.linalg.qr(random.normal(size=(count, 3, 3)))
    rotation = q * np.sign(np.diagonal(r, axis1=1, axis2=2))[:, None]
    truth = np.tile(np.eye(4), (count, 1, 1))
    truth[:, :3, :3] = SCALE * rotation * np.linalg.det(rotation)[:, None, None]
    truth[:, :3, 3] = random.uniform(-100, 100, (count, 3))
    places = points @ np.swapaxes(truth[:, :3, :3], 1, 2) + truth[:, None, :3, 3]
    along = (
        random.normal(size=(count, 4, 3))
        if planar
        else np.repeat(places[:, 1::2] - places[:, ::2], 2, axis=1)
    )
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    before = random.uniform(0, NEEDLE_MM, (count, 4, 1))
    if not planar:
        places, before = np.repeat(places[:, ::2], 2, axis=1), np.repeat(before[:, ::2], 2, axis=1)
    segments = np.stack([places - before * along, places + (NEEDLE_MM - before) * along], axis=2)
    return Problems(points, segments, truth)


def plane(p: Problems) -> np.ndarray:
    return np.ascontiguousarray(p.points[..., :2])


def lines(p: Problems) -> tuple[np.ndarray, np.ndarray]:
    return p.points.reshape(-1, 2, 2, 3), np.ascontiguousarray(p.segments[:, ::2])


def seven_rows(p: Problems) -> tuple[np.ndarray, np.ndarray]:
    planes = constraints.planes_of_lines(p.segments).reshape(-1, 8, 4)
    return np.ascontiguousarray(np.repeat(p.points, 2, axis=1)[:, :7]), np.ascontiguousarray(planes[:, :7])


def six_rows(p: Problems) -> tuple[np.ndarray, np.ndarray]:
    points, planes = seven_rows(p)
    return np.ascontiguousarray(points[:, :6]), np.ascontiguousarray(planes[:, :6])


def flat_rows(p: Problems) -> tuple[np.ndarray, np.ndarray]:
    points, planes = seven_rows(p)
    return np.ascontiguousarray(points[..., :2]), planes


def at_scale(p: Problems) -> Callable[[], np.ndarray]:
    points, planes = six_rows(p)
    return lambda: solvers.three_quadrics(points, planes, scale=SCALE).matrices


def ours() -> list[Solver]:
    return [
        Solver("four_points", True, lambda p: prepared(solvers.four_points, plane(p), p.segments)),
        Solver(
            "four_points, steps=2",
            True,
            lambda p: prepared(solvers.four_points, plane(p), p.segments, steps=2),
        ),
        Solver("two_conics", True, lambda p: prepared(solvers.two_conics, *flat_rows(p))),
        Solver("three_quadrics", True, lambda p: prepared(solvers.three_quadrics, *seven_rows(p))),
        Solver("three_quadrics, scale known", True, at_scale),
        Solver(
            "paper_four_points",
            True,
            lambda p: prepared(solvers.paper_four_points, plane(p), p.segments),
            5000,
        ),
        Solver("two_lines", False, lambda p: prepared(solvers.two_lines, *lines(p))),
        Solver("two_lines, steps=2", False, lambda p: prepared(solvers.two_lines, *lines(p), steps=2)),
        Solver("three_quadrics", False, lambda p: prepared(solvers.three_quadrics, *seven_rows(p))),
        Solver("three_quadrics, scale known", False, at_scale),
        Solver(
            "paper_two_lines", False, lambda p: prepared(solvers.paper_two_lines, p.points, p.segments), 2000
        ),
    ]


def prepared(solve: Callable, *arrays: np.ndarray, **options: int) -> Callable[[], np.ndarray]:
    """The call alone: arranging the arrays is not timed."""
    return lambda: solve(*arrays, **options).matrices


def peers() -> list[Solver]:
    found: list[Solver] = []
    try:
        import poselib
    except ImportError:
        print("poselib is not installed: pip install poselib", file=sys.stderr)
    else:
        for planar in (True, False):
            for name in ("gp4ps", "gp4ps_kukelova"):
                call = getattr(poselib, name)
                solve = partial(partial, by_poselib, call)
                found.append(Solver(f"poselib {name}", planar, solve, TIMED, partial(poselib_alone, call)))
    try:
        from pytheia import sfm
    except ImportError:
        print("pytheia is not installed: pip install pytheia", file=sys.stderr)
    else:
        call = sfm.GdlsSimilarityTransform
        for planar in (True, False):
            solve = partial(partial, by_pytheia, call)
            found.append(Solver("pytheia gDLS", planar, solve, 1000, partial(pytheia_alone, call)))
    found += [
        Solver("scipy least_squares", planar, lambda p: lambda: by_scipy(p), 200) for planar in (True, False)
    ]
    return found


def poselib_arrays(p: Problems) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Its rays are our lines: alpha p + lambda x = R X + t, so s = 1 / alpha. Points in the order 1, 2, 1, 2."""
    order = [0, 2, 1, 3]
    origins = np.ascontiguousarray(p.segments[:, order, 0])
    along = p.segments[:, order, 1] - origins
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    return origins, along, np.ascontiguousarray(p.points[:, order])


def poselib_alone(call: Callable, p: Problems) -> Callable[[], object]:
    problems_of = list(zip(*poselib_arrays(p), strict=True))

    def run() -> None:
        for a, b, c in problems_of:  # results are dropped: keeping them would time the garbage collector
            call(a, b, c, False)

    return run


def by_poselib(call: Callable, p: Problems) -> np.ndarray:
    origins, along, image = poselib_arrays(p)
    out = np.full((len(image), 8, 4, 4), np.nan)
    for b in range(len(image)):
        poses, alphas = call(origins[b], along[b], image[b], False)
        for k, (pose, alpha) in enumerate(zip(poses[:8], alphas[:8], strict=True)):
            out[b, k, :3] = pose.Rt / alpha
            out[b, k, 3] = [0, 0, 0, 1]
    return out


def pytheia_alone(call: Callable, p: Problems) -> Callable[[], object]:
    problems_of = [tuple(map(list, arrays)) for arrays in zip(*poselib_arrays(p), strict=True)]

    def run() -> None:
        for arrays in problems_of:
            call(*arrays)

    return run


def by_pytheia(call: Callable, p: Problems) -> np.ndarray:
    """Its rays as poselib's: s o + alpha d = R x + t, quaternions w first."""
    from scipy.spatial.transform import Rotation

    out = np.full((len(p.points), 8, 4, 4), np.nan)
    for b, arrays in enumerate(zip(*poselib_arrays(p), strict=True)):
        quaternions, translations, scales = call(*map(list, arrays))
        for k, (q, t, s) in enumerate(list(zip(quaternions, translations, scales, strict=True))[:8]):
            if s > 0:
                out[b, k, :3, :3] = Rotation.from_quat(q, scalar_first=True).as_matrix() / s
                out[b, k, :3, 3] = t / s
                out[b, k, 3] = [0, 0, 0, 1]
    return out


def by_scipy(p: Problems) -> np.ndarray:
    """Distances of the points from the lines, from the identity's orientation at the lines' middle."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    planes = constraints.planes_of_lines(p.segments).reshape(-1, 8, 4)
    points = np.repeat(p.points, 2, axis=1)
    out = np.full((len(points), 1, 4, 4), np.nan)
    for b, (x, n) in enumerate(zip(points, planes, strict=True)):

        def matrix(v: np.ndarray) -> np.ndarray:
            a = np.eye(4)
            a[:3, :3] = np.exp(v[6]) * Rotation.from_rotvec(v[:3]).as_matrix()
            a[:3, 3] = 100 * v[3:6]
            return a

        def residuals(v: np.ndarray, x: np.ndarray = x, n: np.ndarray = n) -> np.ndarray:
            a = matrix(v)
            return np.einsum("ij,ij->i", n[:, :3], x @ a[:3, :3].T + a[:3, 3]) + n[:, 3]

        start = np.concatenate([np.zeros(3), p.segments[b].mean(axis=(0, 1)) / 100, [np.log(SCALE)]])
        out[b, 0] = matrix(least_squares(residuals, start, method="lm").x)
    return out


def measure(solver: Solver) -> dict[str, float]:
    timed = problems(solver.planar, min(TIMED, solver.most), seed=1)
    call = (solver.clocked or solver.solve)(timed)
    seconds = min(clock(call) for _ in range(REPEATS if solver.most >= TIMED else 1))
    checked = problems(solver.planar, solver.most, seed=2)
    matrices = solver.solve(checked)()
    errors = np.nan_to_num(np.abs(matrices - checked.truth[:, None]).max(axis=(2, 3)), nan=np.inf).min(axis=1)
    noisy = problems(solver.planar, min(20_000, solver.most), seed=3).noisy(4)
    under_noise = solver.solve(noisy)()
    none = np.isnan(under_noise[..., 0, 0]).all(axis=1)
    angles = rotation_errors(under_noise[~none], noisy.truth[~none])
    return {
        "ns": 1e9 * seconds / len(timed.points),
        "solutions": float(np.isfinite(matrices[..., 0, 0]).sum(axis=1).mean()),
        "success": float((errors < 1e-6).mean()),
        "p99_log10": float(np.log10(np.maximum(np.quantile(errors, 0.99, method="lower"), 1e-17))),
        "worst_log10": float(np.log10(errors.max())) if np.isfinite(errors.max()) else float("inf"),
        "none": float(none.mean()),
        "median_deg": float(np.median(angles)),
        "p90_deg": float(np.quantile(angles, 0.9)),
    }


def clock(call: Callable[[], object]) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def rotation_errors(matrices: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Angle of the best solution, deg."""
    scale = np.linalg.norm(matrices[..., :3, 0], axis=-1)[..., None, None]
    chord = np.linalg.norm(matrices[..., :3, :3] / scale - truth[:, None, :3, :3] / SCALE, axis=(-2, -1))
    angles = 2 * np.degrees(np.arcsin(np.minimum(chord / np.sqrt(8), 1)))
    return np.nan_to_num(angles, nan=np.inf).min(axis=1)


def table(results: dict[str, dict[str, float]]) -> str:
    head = "| solver | ns | solutions | success 1e-6 | log10 error p99, worst | noise: none | rotation median, p90 |"
    rows = [
        f"| {name} | {r['ns']:.0f} | {r['solutions']:.2f} | {100 * r['success']:.3f} % | {r['p99_log10']:.1f}, "
        f"{r['worst_log10']:.1f} | {100 * r['none']:.1f} % | {r['median_deg']:.2f}, {r['p90_deg']:.1f} deg |"
        for name, r in results.items()
    ]
    return "\n".join([head, "|---|---|---|---|---|---|---|", *rows])


def linear_rows(planar: bool, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, planes and truth of `count` noise-free rows."""
    random = np.random.default_rng(5)
    truth = problems(planar, 1, seed=6).truth[0]
    points = random.uniform(0, IMAGE_PX, (count, 3)) * ([1, 1, 0] if planar else [1, 1, 1])
    normals = random.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    places = points @ truth[:3, :3].T + truth[:3, 3]
    return points, np.column_stack([normals, -np.einsum("ij,ij->i", normals, places)]), truth


def numpy_least_squares(points: np.ndarray, planes: np.ndarray) -> np.ndarray:
    """The same 13 (or 10) numbers by numpy's own SVD, with the homogeneous 1 on the right."""
    used = points if points[:, 2].any() else points[:, :2]
    columns = [x[:, None] * planes[:, :3] for x in used.T]
    return np.asarray(np.linalg.lstsq(np.hstack([*columns, planes[:, :3]]), -planes[:, 3])[0])


def linear_table() -> str:
    """Time and error of the linear solvers beside numpy's lstsq on the same rows."""
    out = ["| linear solver | rows | ms | numpy lstsq, ms | worst error |", "|---|---|---|---|---|"]
    for planar, solve in ((False, solvers.linear_lines), (True, solvers.linear_points)):
        for count in (20, 1000, 1_000_000):
            points, planes, truth = linear_rows(planar, count)
            given = np.ascontiguousarray(points[:, :2]) if planar else points
            ours_s = min(clock(partial(solve, given, planes)) for _ in range(REPEATS))
            numpy_s = min(clock(partial(numpy_least_squares, points, planes)) for _ in range(3))
            error = np.abs(solve(given, planes).matrices[0] - truth).max()
            out.append(
                f"| {solve.__name__} | {count} | {1e3 * ours_s:.3g} | {1e3 * numpy_s:.3g} | {error:.1e} |"
            )
    return "\n".join(out)


def single_table() -> str:
    """One problem a call from Python, us."""
    flat, space = problems(True, 1, seed=7), problems(False, 1, seed=7)
    (image, needles), (points, planes) = lines(space), seven_rows(space)
    calls: dict[str, Callable[[], object]] = {
        "four_points": partial(solvers.four_points, plane(flat)[0], flat.segments[0]),
        "two_lines": partial(solvers.two_lines, image[0], needles[0]),
        "three_quadrics": partial(solvers.three_quadrics, points[0], planes[0]),
    }
    out = ["| one problem, one call | us |", "|---|---|"]
    for name, call in calls.items():
        best = min(timeit.repeat(call, number=2000, repeat=15)) / 2000
        out.append(f"| {name} | {1e6 * best:.1f} |")
    return "\n".join(out)


def regressions(results: dict[str, dict[str, float]], before: dict[str, dict[str, float]]) -> list[str]:
    """What is 1.3 times slower than before beside the run's other solvers, or fails more often."""
    shared = [name for name in results if name in before]
    pace = float(np.median([results[n]["ns"] / before[n]["ns"] for n in shared])) if shared else 1.0
    said = []
    for name in shared:
        now, then = results[name], before[name]
        if now["ns"] > 1.3 * pace * then["ns"]:
            said.append(
                f"{name}: {now['ns']:.0f} ns, was {then['ns']:.0f} ns ({pace:.2f} x the machine's pace then)"
            )
        if now["success"] < then["success"] - 1e-4:
            said.append(f"{name}: success {100 * now['success']:.3f} %, was {100 * then['success']:.3f} %")
        if now["none"] > then["none"] + 0.005:
            said.append(f"{name}: no solution in {100 * now['none']:.1f} %, was {100 * then['none']:.1f} %")
    return said


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--save", action="store_true", help="keep what was measured as the baseline")
    parser.add_argument("--compare", action="store_true", help="say what got worse than the baseline")
    asked = parser.parse_args(arguments)
    results = {}
    for solver in [*ours(), *peers()]:
        results[f"{solver.name} ({'4 points' if solver.planar else '2 lines'})"] = measure(solver)
    print(table(results), single_table(), linear_table(), sep="\n\n")
    if asked.save:
        BASELINE.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    if asked.compare:
        said = regressions(results, json.loads(BASELINE.read_text(encoding="utf-8")))
        print("\n".join(said) or "nothing got slower or less sure")
        return 1 if said else 0
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
