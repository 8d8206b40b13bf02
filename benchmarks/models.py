"""The test of the model: how often it accuses sound scans, what it finds; a known scale's errors.

    python -m benchmarks.models [--seeds 200] [--data FOLDER]

Scans of two simulators, 2D and 3D: needles at random places, and a needle moved continuously with outliers. The last
table is of PLUS's recorded set of a linear probe with unequal pixels.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import f as f_distribution

import sonocal as sc
from benchmarks.comparison import needle_scan
from benchmarks.simulators.scans import SCALE, scan
from sonocal.registration.model_test import ModelTest
from sonocal.validation import give_verdict, nwire_error

Made = tuple[sc.Observations, sc.Similarity]
CODES = ("anisotropic-scale", "known-scale-disagrees", "known-scale-unchecked")
UNEQUAL = (0.01, 0.02, 0.03, 0.06)
WRONG = (0.005, 0.01, 0.02, 0.05, 0.2)
FAR_WRONG = (-0.3, 0.3)


def needles(seed: int, dimension: int) -> Made:
    """Needles at random places, 40 of them."""
    rng = np.random.default_rng([seed, dimension])
    truth = sc.Similarity(Rotation.random(random_state=seed).as_matrix(), rng.uniform(-100, 100, 3), SCALE)
    return needle_scan(rng, (truth.rotation, truth.translation), dimension, 40), truth


def moved(seed: int, dimension: int) -> Made:
    """One needle moved slowly, 100 images, 3 % outliers."""
    made = scan(seed, dimension=dimension)
    return made.observations, made.truth


SCANS: dict[str, Callable[[int, int], Made]] = {"needles": needles, "moved": moved}


def stretched(rows: sc.Observations, by: float) -> sc.Observations:
    """The rows of an image whose px are wider than high by a share."""
    factors = np.array([1.0 + by, 1.0, 1.0][: rows.dimension])
    return dataclasses.replace(rows, points_px=rows.points_px / factors)


def tests_of(rows: sc.Observations, **options: object) -> dict[str, ModelTest]:
    """By the narrower model."""
    return {one.narrower: one for one in sc.calibrate(rows, **options).models}  # type: ignore[arg-type]


def size_of_tests(seeds: range) -> Iterator[str]:
    """Of sound scans: p-values below 5 % and 1 %, and findings."""
    yield "| scan | | test | p < 5 % | p < 1 % | contradicted |\n|---|---|---|---|---|---|"
    for name, make in SCANS.items():
        for dimension in (2, 3):
            found: dict[str, list[tuple[float, bool]]] = {"rigid": [], "similarity": []}
            for seed in seeds:
                tests = tests_of(make(seed, dimension)[0], scale_mm_per_px=SCALE)
                for model, one in tests.items():
                    found[model].append((one.p_value, one.contradicts))
            for model, label in (("rigid", "known scale"), ("similarity", "one scale")):
                p, said = np.array(found[model]).T
                counts = f"{np.sum(p < 0.05)} | {np.sum(p < 0.01)} | {int(said.sum())}"
                yield f"| {name} | {dimension}D | {label} | {counts} of {len(p)} |"


def power(seeds: range) -> Iterator[str]:
    """Of wrong scans and wrong scales: how many the tests contradict, and what the verdict is on a wrong scale."""
    yield "| scan | | what is wrong | contradicted | Use it |\n|---|---|---|---|---|"
    for name, make in SCANS.items():
        for dimension in (2, 3):
            made = [make(seed, dimension)[0] for seed in seeds]
            for by in UNEQUAL:
                tests = [tests_of(stretched(rows, by))["similarity"] for rows in made]
                yield f"| {name} | {dimension}D | u {by:.0%} wider | {sum(t.contradicts for t in tests)} | |"
            for by in WRONG:
                yield f"| {name} | {dimension}D | {_wrongly_known(made, SCALE * (1 + by), by)} |"


def _wrongly_known(made: list[sc.Observations], scale: float, by: float) -> str:
    contradicted = used = refused = 0
    for rows in made:
        try:
            found = sc.calibrate(rows, scale_mm_per_px=scale)
        except sc.SonocalError:
            refused += 1
            continue
        contradicted += any(one.code == "known-scale-disagrees" for one in found.diagnostics)
        used += give_verdict(found).level == "use"
    refusals = f", {refused} refused" if refused else ""
    return f"a known scale {by:.1%} too large | {contradicted}{refusals} | {used} of {len(made)}"


def far_wrong(seeds: range) -> Iterator[str]:
    """Of known scales that are far off, and of the true one beside wrong rows: whether the scale is suspected."""
    yield "| scan | | what is wrong | calibrated | refused | the scale is named | Use it |"
    yield "|---|---|---|---|---|---|---|"
    for name, make in SCANS.items():
        for dimension in (2, 3):
            made = [make(seed, dimension)[0] for seed in seeds]
            for by in FAR_WRONG:
                told = _told(made, SCALE * (1 + by))
                yield f"| {name} | {dimension}D | a known scale {100 * by:+.0f} % off | {told} |"
            for what, spoil in SPOILT.items():
                spoilt = [
                    spoil(rows, np.random.default_rng(seed)) for seed, rows in zip(seeds, made, strict=True)
                ]
                yield f"| {name} | {dimension}D | {what} | {_told(spoilt, SCALE)} |"


def exchanged(rows: sc.Observations, rng: np.random.Generator) -> sc.Observations:
    """The rows with the segments of others."""
    each = rows.dimension - 1  # rows of a sighting
    order = (each * rng.permutation(len(rows) // each)[:, None] + np.arange(each)).ravel()
    return dataclasses.replace(rows, segments_mm=rows.segments_mm[order])


def outliers(rows: sc.Observations, rng: np.random.Generator) -> sc.Observations:
    """The rows, six in ten of them anywhere in the image."""
    points, wrong = rows.points_px.copy(), rng.random(len(rows)) < 0.6
    points[wrong] = rng.uniform(points.min(axis=0), points.max(axis=0), (wrong.sum(), points.shape[1]))
    return dataclasses.replace(rows, points_px=points)


SPOILT = {"nothing": lambda rows, _: rows, "60 % outliers": outliers, "lines of other rows": exchanged}


def _told(made: list[sc.Observations], scale: float) -> str:
    refused = named = used = 0
    for rows in made:
        try:
            found = sc.calibrate(rows, scale_mm_per_px=scale)
        except sc.SonocalError as refusal:
            refused += 1
            named += "contradict the scale that was given" in str(refusal)
            continue
        named += any(one.code == "known-scale-disagrees" for one in found.diagnostics)
        used += give_verdict(found).level == "use"
    return f"{len(made) - refused} | {refused} | {named} of {len(made)} | {used}"


def coverage(seeds: range) -> Iterator[str]:
    """Of the tangent's error with the scale known: how often its covariance's 95 % hold it."""
    yield "| scan | | within 95 % | e' C^-1 e / 6 |\n|---|---|---|---|"
    for name, make in SCANS.items():
        for dimension in (2, 3):
            squares, within = [], []
            for seed in seeds:
                rows, truth = make(seed, dimension)
                found = sc.calibrate(rows, scale_mm_per_px=SCALE)
                turn = Rotation.from_matrix(found.probe_from_image.rotation @ truth.rotation.T).as_rotvec()
                error = np.r_[turn, found.probe_from_image.translation - truth.translation]
                squares.append(error @ np.linalg.solve(found.covariance, error) / 6)
                within.append(squares[-1] <= f_distribution.ppf(0.95, 6, found.noise.freedom))
            inside = np.mean(within)
            yield f"| {name} | {dimension}D | {100 * inside:.1f} % | {np.mean(squares):.2f} |"


def recorded(folder: Path) -> Iterator[str]:
    """PLUS's linear probe with unequal pixels: one scale and two, on its validation rows."""
    path = folder / "observations" / "fcal12_ascension"
    rows = sc.read_observations(path.with_suffix(".csv"))
    reference = json.loads(path.with_suffix(".reference.json").read_text())
    yield "| model | weighting | mm/px | rms fit, mm | rms test, mm | PLUS's error fit / test, mm | the test |"
    yield "|---|---|---|---|---|---|---|"
    for model, weighting in product(("similarity", "anisotropic"), ("likelihood", "geometric")):
        splits = {"fit_split": "calibration", "test_split": "validation"}
        found = sc.calibrate(rows, model=model, weighting=weighting, **splits)
        errors = [
            nwire_error(found.probe_from_image, rows.select_split(split), reference["nwires"]).value_mm
            for split in ("calibration", "validation")
        ]
        scales = ", ".join(f"{one:.5f}" for one in found.scales_mm_per_px)
        (test,) = found.models
        yield (
            f"| {model} | {weighting} | {scales} | {found.fit.rms_mm:.3f} | {found.test.rms_mm:.3f} "
            f"| {errors[0]:.3f} / {errors[1]:.3f} "
            f"| F({test.contrasts}, {test.freedom:.0f}) = {test.f_statistic:.1f}, p = {test.p_value:.1g} |"
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--data", type=Path, default=Path(__file__).parents[2] / "shared" / "data")
    asked = parser.parse_args()
    seeds = range(asked.seeds)
    few = range(min(asked.seeds, 50))
    far = range(200, 200 + min(asked.seeds, 100))
    for table in (size_of_tests(seeds), coverage(seeds), power(few), far_wrong(far)):
        print("\n".join(table), end="\n\n", flush=True)
    if (asked.data / "observations").exists():
        print("\n".join(recorded(asked.data)))
    else:
        print(f"no recorded sets in {asked.data}", file=sys.stderr)


if __name__ == "__main__":
    main()
