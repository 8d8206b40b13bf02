"""Consensus with outliers: how often it finds what one who knew the inliers would, and how long it takes.

    python -m benchmarks.robust [--runs 10000]

Times are the least of several repeats, in one run with the peer's: numpy's linear start and SciPy's LM, which
get the inliers alone.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import timeit
from collections.abc import Callable

import numpy as np

from sonocal import _core
from sonocal import registration as reg
from sonocal.calibration import point_line_rows
from sonocal.errors import NoConsensusError
from sonocal.geometry import Similarity
from sonocal.registration.fit import away_from_lines
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import PointLineRows
from sonocal.simulation.scene import IMAGE_PX, SimulatedSightings, simulate_observations

REPEATS = 30
GEOMETRIC, LIKELIHOOD = "geometric", "likelihood"


def scene_of(dimension: int, rows: int, share: float, seed: int) -> SimulatedSightings:
    """So many rows: needles in 2D, two rows a needle in 3D."""
    return simulate_observations(dimension, rows // (dimension - 1), outlier_share=share, seed=seed)


def core_call(rows: PointLineRows, weighting: str) -> Callable[[], object]:
    """The core alone; its table is made once for all that is asked of it."""
    table, options = rows.core, Options.of(weighting=weighting).to_core(0.0, 0.0)
    return lambda: _core.estimate(table, options)


def constraints_of(scene: SimulatedSightings) -> reg.Rows:
    found = scene.observations
    if found.dimension == 2:
        return reg.point_line(
            np.column_stack([found.points_px, np.zeros(len(found.points_px))]), found.segments_mm
        )
    return reg.line_line(found.points_px.reshape(-1, 2, 3), found.segments_mm[::2])


def scipy_fit(scene: SimulatedSightings) -> Callable[[], object]:
    """Linear start, then LM on the paper's cost with numeric derivatives; inliers only."""
    from scipy.optimize import least_squares
    from scipy.spatial.transform import Rotation

    found = scene.observations
    points = np.column_stack([found.points_px, np.zeros(len(found.points_px))])[:, :3][~scene.outlier]
    segments = found.segments_mm[~scene.outlier]

    def fit() -> object:
        rows = reg.point_line(points, segments)
        solve = reg.solvers.linear_points if found.dimension == 2 else reg.solvers.linear_lines
        x = rows.points[:, : found.dimension]
        start = solve(np.ascontiguousarray(x), rows.planes).matrices[0]
        scale = np.cbrt(np.linalg.det(start[:3, :3]))
        turn = Rotation.from_matrix(start[:3, :3] / scale).as_rotvec()

        def residuals(v: np.ndarray) -> np.ndarray:
            matrix = np.exp(v[6]) * Rotation.from_rotvec(v[:3]).as_matrix()
            moved = rows.points @ matrix.T + v[3:6]
            return np.einsum("ij,ij->i", rows.planes[:, :3], moved) + rows.planes[:, 3]

        return least_squares(residuals, np.r_[turn, start[:3, 3], np.log(scale)], method="lm")

    return fit


def least_us(call: Callable[[], object], number: int) -> float:
    return 1e6 * min(timeit.repeat(call, number=number, repeat=REPEATS)) / number


def time_table() -> str:
    out = [
        "| rows, outliers | core, geometric | core, likelihood | reg.register, geometric | likelihood | "
        "linear + SciPy LM (inliers alone) | ratio to register, geometric |",
        "|---|---|---|---|---|---|---|",
    ]
    for dimension, rows, share in (
        (2, 50, 0.2),
        (3, 50, 0.2),
        (2, 50, 0.5),
        (3, 50, 0.5),
        (2, 100, 0.7),
        (3, 100, 0.7),
    ):
        scene = scene_of(dimension, rows, share, seed=3)
        table, constraints = point_line_rows(scene.observations), constraints_of(scene)
        number = 100 if share < 0.7 else 10
        core = [least_us(core_call(table, weighting), number) for weighting in (GEOMETRIC, LIKELIHOOD)]
        whole = [
            least_us(lambda c=constraints, w=weighting: reg.register(c, weighting=w), number)  # type: ignore[misc]
            for weighting in (GEOMETRIC, LIKELIHOOD)
        ]
        peer = least_us(scipy_fit(scene), 2)
        out.append(
            f"| {dimension}D {rows}, {100 * share:.0f} % | {core[0]:.0f} us | {core[1]:.0f} us | {whole[0]:.0f} us | "
            f"{whole[1]:.0f} us | {peer:.0f} us | {peer / whole[0]:.0f} |"
        )
    return "\n".join(out)


def truncated_cost(found: Similarity, table: PointLineRows, threshold_mm: float) -> float:
    """What the consensus minimises: squared distances, none above the threshold's."""
    away = np.linalg.norm(away_from_lines(found @ table.points, table.segments_mm), axis=1)
    return float(np.sum(np.minimum(away, threshold_mm) ** 2))


def image_error(found: Similarity, truth: Similarity, dimension: int) -> float:
    """Mean square error of the corners of the image, mm^2."""
    corners = np.zeros((2**dimension, 3))
    corners[:, :dimension] = np.indices((2,) * dimension).reshape(dimension, -1).T * float(IMAGE_PX)
    return float(np.mean(np.sum((found @ corners - truth @ corners) ** 2, axis=1)))


def rate_table(runs: int, threshold_mm: float = 5.0) -> str:
    """Consensus against the fit of the true inliers from the truth.

    Gross rows that happen to lie within the threshold of their lines count as inliers to whoever does not
    know: so the cost is compared, and the errors in the image over all runs.
    """
    out = [
        "| rows, outliers | cost within 1.2 x of the fit that knows the inliers | "
        "rms error of the corners, that fit's | runs |",
        "|---|---|---|---|",
    ]
    for dimension, rows, share in ((2, 50, 0.5), (3, 50, 0.5), (2, 100, 0.7), (3, 100, 0.7)):
        good, errors = 0, []
        for seed in range(runs):
            scene = scene_of(dimension, rows, share, seed)
            table, truth = point_line_rows(scene.observations), scene.probe_from_image
            best = refine_point_lines(truth, table, ~scene.outlier, Options(weighting="geometric")).transform
            try:
                found = fit_point_lines(
                    table, Options(weighting="geometric", threshold_mm=threshold_mm)
                ).transform
            except NoConsensusError:
                continue
            assert isinstance(found, Similarity)
            assert isinstance(best, Similarity)
            good += truncated_cost(found, table, threshold_mm) <= 1.2 * truncated_cost(
                best, table, threshold_mm
            )
            errors.append([image_error(found, truth, dimension), image_error(best, truth, dimension)])
        ours, knowing = np.sqrt(np.mean(errors, axis=0))
        out.append(
            f"| {dimension}D {rows}, {100 * share:.0f} % | {100 * good / runs:.2f} % | "
            f"{ours:.2f}, {knowing:.2f} mm | {runs} |"
        )
    return "\n".join(out)


def million_rows() -> str:
    """A process of its own for each, so that its peak memory is the fit's."""
    out = ["| rows, outliers | s | peak memory of the fit beside the table |", "|---|---|---|"]
    for share in (0.0, 0.3):
        table = point_line_rows(scene_of(2, 1_000_000, share, seed=1).observations)
        with tempfile.TemporaryDirectory() as folder:
            np.save(f"{folder}/points.npy", table.points)
            np.save(f"{folder}/segments.npy", table.segments_mm)
            command = [sys.executable, "-c", FIT_SAVED, folder]
            seconds, ratio = subprocess.run(
                command, check=True, capture_output=True, text=True
            ).stdout.split()
        out.append(f"| 1000000, {100 * share:.0f} % | {float(seconds):.2f} | {float(ratio):.1f} x |")
    return "\n".join(out)


FIT_SAVED = """
import sys, time
import numpy as np
from sonocal.registration.options import Options
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import PointLineRows
folder = sys.argv[1]
rows = PointLineRows(np.load(folder + "/points.npy"), np.load(folder + "/segments.npy"), 2)
fit_point_lines(PointLineRows(rows.points[:100], rows.segments_mm[:100], 2), Options())
def peak():  # ru_maxrss would be the parent's
    return 1024 * int(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])
before, seconds = peak(), []
for _ in range(3):
    start = time.perf_counter()
    fit_point_lines(rows, Options())
    seconds.append(time.perf_counter() - start)
print(min(seconds), (peak() - before) / (rows.points.nbytes + rows.segments_mm.nbytes))
"""


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--only", choices=("times", "rates", "million"))
    given = parser.parse_args(arguments)
    if given.only in (None, "million"):
        print(million_rows(), flush=True)
    if given.only in (None, "times"):
        print(time_table(), flush=True)
    if given.only in (None, "rates"):
        print(rate_table(given.runs), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
