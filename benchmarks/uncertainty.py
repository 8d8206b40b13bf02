"""Whether the refinement reaches the statistical limit, and whether the uncertainty it states is true.

    python -m benchmarks.uncertainty [--scenes 2000] [--runs 10000] [--data FOLDER]

Scenes are the paper's (section 9.1). Two thresholds of a figure mean: without outliers, so nothing is left out.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

import sonocal as sc
from sonocal import _core
from sonocal.calibration import point_line_rows
from sonocal.geometry import Similarity, area_places
from sonocal.registration.options import Options
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import PointLineRows, to_core
from sonocal.registration.uncertainty import point_covariance
from sonocal.simulation.scene import IMAGE_PX, SimulatedSightings, simulate_observations

PARAMETERS = 7
# No outliers here: a threshold that leaves out nothing of the noise.
THRESHOLD_MM = 40.0
# Of e' F e, of which 7 are expected: once in 10^18 where errors are small enough for the bound.
FAR = 100.0
NOISES = ((1.0, 1.0), (3.0, 0.3), (0.3, 3.0))


def tangent_error(found: Similarity, truth: Similarity) -> np.ndarray:
    """The tangent (7,) that leads from the truth to what was found."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(found.rotation @ truth.rotation.T).as_rotvec()
    return np.r_[turn, found.translation - truth.translation, np.log(found.scale / truth.scale)]


def fisher_information(
    rows: PointLineRows, truth: Similarity, sigma_px: float, sigma_mm: float
) -> np.ndarray:
    """Of the tangent at the truth, (7, 7)."""
    everything = np.ones(len(rows), dtype=bool)
    options = Options().to_core(sigma_px, sigma_mm)
    jacobian = _core.white_residuals(rows.core, everything, to_core(truth), options).jacobian
    return np.asarray(jacobian.T @ jacobian)


def cramer_rao(dimension: int, needles: int, noise: tuple[float, float], scenes: int, known: bool) -> str:
    """sqrt(mean of e' F e / 7), which the Cramer-Rao bound holds at 1, with its standard error.

    The bound is for small errors: where the noise has made a far answer the likelier one, the mean is also given
    without such scenes.
    """
    values = []
    for seed in range(scenes):
        scene = simulate_observations(dimension, needles, sigma_px=noise[0], sigma_mm=noise[1], seed=seed)
        rows = point_line_rows(scene.observations)
        levels = {"sigma_px": noise[0], "sigma_mm": noise[1]} if known else {}
        fit = fit_point_lines(rows, Options(threshold_mm=THRESHOLD_MM, **levels))
        error = tangent_error(fit.transform, scene.probe_from_image)
        values.append(error @ fisher_information(rows, scene.probe_from_image, *noise) @ error / PARAMETERS)
    ratio = np.sqrt(np.mean(values))
    near = np.array(values)[np.array(values) * PARAMETERS <= FAR]
    text = f"{ratio:.3f} +- {np.std(values) / np.sqrt(scenes) / (2 * ratio):.3f}"
    if len(near) == scenes:
        return text
    return f"{text}; {np.sqrt(np.mean(near)):.3f} but for {scenes - len(near)} of {scenes}"


def cramer_rao_table(scenes: int) -> str:
    out = [
        "| probe, needles | noise | levels known | levels estimated |",
        "|---|---|---|---|",
    ]
    for dimension in (2, 3):
        for needles in (6, 10, 20, 50):
            for noise in NOISES:
                cells = (cramer_rao(dimension, needles, noise, scenes, known) for known in (True, False))
                out.append(
                    f"| {dimension}D, {needles} | {noise[0]} px, {noise[1]} mm | {' | '.join(cells)} |"
                )
    return "\n".join(out)


def rotation_table(scenes: int) -> str:
    """The likelihood's weights against the paper's cost, rms of the rotation error on the same scenes."""
    out = ["| 3D, needles | paper's cost | likelihood | ratio |", "|---|---|---|---|"]
    for needles in (10, 20, 50):
        squares: dict[str, list[float]] = {"geometric": [], "likelihood": []}
        for seed in range(scenes):
            scene = simulate_observations(3, needles, seed=seed)
            rows = point_line_rows(scene.observations)
            for weighting, kept in squares.items():
                fit = fit_point_lines(rows, Options.of(weighting=weighting, threshold_mm=THRESHOLD_MM))
                kept.append(float(np.sum(tangent_error(fit.transform, scene.probe_from_image)[:3] ** 2)))
        paper, ours = (np.degrees(np.sqrt(np.mean(kept))) for kept in squares.values())
        out.append(f"| {needles} | {paper:.3f} deg | {ours:.3f} deg | {ours / paper:.2f} |")
    return "\n".join(out)


def stated(scene: SimulatedSightings) -> dict[str, float | np.ndarray]:
    """What one calibration says of itself, and what is true."""
    from scipy.stats import f as f_distribution

    found = sc.calibrate(scene.observations, image_size_px=(IMAGE_PX,) * scene.observations.dimension)
    assert found.covariance is not None
    assert isinstance(found.probe_from_image, Similarity)
    truth = scene.probe_from_image
    # At the answer, as its user would: from what was found to the truth.
    error = tangent_error(truth, found.probe_from_image)
    region = PARAMETERS * f_distribution.ppf(0.95, PARAMETERS, found.noise.freedom)
    places = area_places(found.area_px)
    predicted = point_covariance(found.probe_from_image, found.covariance, places)
    off = np.linalg.norm(found.probe_from_image @ places - truth @ places, axis=1)
    return {
        "inside": float(error @ np.linalg.solve(found.covariance, error) <= region),
        "off": off,
        "predicted": np.sqrt(np.trace(predicted, axis1=1, axis2=2)),
    }


def stated_table(runs: int) -> str:
    """Truths inside the 95 % region, predicted over actual rms, and answers five times worse than they say."""
    out = [
        "| probe, needles | inside the 95 % region | predicted / actual rms, corners and centre | "
        "off by > 5 x predicted |",
        "|---|---|---|---|",
    ]
    for dimension in (2, 3):
        for needles in (10, 20, 50):
            all_runs = [stated(simulate_observations(dimension, needles, seed=seed)) for seed in range(runs)]
            inside = np.mean([run["inside"] for run in all_runs])
            off = np.array([run["off"] for run in all_runs])
            predicted = np.array([run["predicted"] for run in all_runs])
            ratios = np.sqrt(np.mean(predicted**2, axis=0) / np.mean(off**2, axis=0))
            wrong = np.mean(np.any(off > 5 * predicted, axis=1))
            out.append(
                f"| {dimension}D, {needles} | {100 * inside:.1f} % | {ratios.min():.3f} to {ratios.max():.3f} | "
                f"{100 * wrong:.3f} % |"
            )
    return "\n".join(out)


def bootstrap(path: Path, draws: int) -> str:
    """A real set's predicted corner error beside the spread over resampled frames."""
    if not path.exists():
        return f"skipped: no {path.name}"
    observations = sc.read_observations(path)
    parts = []
    for model in ("similarity", "anisotropic"):
        try:
            found = sc.calibrate(observations, fit_split="calibration", model=model)  # type: ignore[arg-type]
        except sc.DegenerateGeometryError as refusal:
            parts.append(f"{model}: refused: {refusal}")
            continue
        fitted = observations.select_split("calibration")
        places, rms, radius = found.predicted_errors()
        random = np.random.default_rng(0)
        frames = np.unique(fitted.frame)
        mapped = []
        for _ in range(draws):
            drawn = random.choice(frames, len(frames))
            chosen = np.concatenate([np.flatnonzero(fitted.frame == frame) for frame in drawn])
            again = sc.calibrate(fitted.select(chosen), model=model)  # type: ignore[arg-type]
            mapped.append(again.probe_from_image @ places)
        spread = np.sqrt(np.mean(np.sum((np.array(mapped) - np.mean(mapped, axis=0)) ** 2, axis=2), axis=0))
        parts.append(
            f"{model}: predicted {rms.max():.2f} mm rms, {radius.max():.2f} mm (95 %) at the worst corner; "
            f"bootstrap of frames {spread.max():.2f} mm rms; warnings {', '.join(d.code for d in found.warnings)}"
        )
    return "\n".join(parts)


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=2000)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    given = parser.parse_args(arguments)
    print(bootstrap(given.data / "observations" / "trus_3nwires.csv", given.draws), flush=True)
    print(rotation_table(given.scenes), flush=True)
    print(stated_table(given.runs), flush=True)
    print(cramer_rao_table(given.scenes), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
