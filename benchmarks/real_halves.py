"""Real sets: the first half of the frames against the second, by what each says of itself.

    python -m benchmarks.real_halves [--data FOLDER]

The difference of two calibrations of one set-up, in the tangent, by the sum of their covariances: chi-squared a
freedom, 1 in expectation where both say the truth of themselves and know it well; p counts how well.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

import sonocal as sc
from sonocal.registration.uncertainty import point_jacobian
from sonocal.validation import compare

# What PLUS's notes say of the scanners' pixels: unequal in two of the sets.
SETS = {"depth15_polaris": "similarity", "fcal12_ascension": "anisotropic", "trus_3nwires": "anisotropic"}


def halves(rows: sc.Observations) -> tuple[sc.Observations, sc.Observations]:
    """The rows of the first half of the frames, and those of the second."""
    middle = np.median(np.unique(rows.frame))
    return rows.select(rows.frame < middle), rows.select(rows.frame >= middle)


def chi_squared(first: sc.Calibration, second: sc.Calibration) -> float:
    """Of the way from one to the other, a freedom: in the tangent of either, the larger of the two.

    Each covariance is of its own calibration's tangent: they are added where both mean the same, of the places' errors.
    """
    places = first.predicted_errors()[0]
    parameters = len(np.asarray(first.covariance))
    away = (first.probe_from_image @ places - second.probe_from_image @ places).reshape(-1)
    jacobians = [
        point_jacobian(one.probe_from_image, places, parameters).reshape(-1, parameters)
        for one in (first, second)
    ]
    errors = sum(
        jacobian @ np.asarray(one.covariance) @ jacobian.T
        for one, jacobian in zip((first, second), jacobians, strict=True)
    )
    found = []
    for jacobian in jacobians:
        to_tangent = np.linalg.pinv(jacobian)
        way = to_tangent @ away
        found.append(float(way @ np.linalg.solve(to_tangent @ errors @ to_tangent.T, way)) / parameters)
    return max(found)


def compared(name: str, first: sc.Observations, second: sc.Observations, model: str) -> str:
    """A row of the table."""
    try:
        found = [sc.calibrate(rows, model=model) for rows in (first, second)]  # type: ignore[arg-type]
    except sc.SonocalError as refusal:
        return f"| {name}, {model} | refused | | {str(refusal).split(',')[0]} | |"
    if any(one.covariance is None for one in found):
        return f"| {name}, {model} | no error is predicted | | | |"
    places, _, bound = found[0].predicted_errors()
    apart = np.linalg.norm(found[0].probe_from_image @ places - found[1].probe_from_image @ places, axis=1)
    others = found[1].predicted_errors()[2]
    p_value = compare(*found).p_value
    return (
        f"| {name}, {model} | {chi_squared(*found):.2f} | {p_value:.2f} | {apart.max():.2f} mm | "
        f"{bound.max():.2f}, {others.max():.2f} mm |"
    )


def table(folder: Path) -> Iterator[str]:
    """A row for each set, split and half."""
    yield "| set | chi-squared a freedom | p | furthest apart | bounds (95 %) |\n|---|---|---|---|---|"
    for name, model in SETS.items():
        rows = sc.read_observations(folder / f"{name}.csv")
        splits = [rows.select_split(split) for split in ("calibration", "validation")]
        for split, part in zip(("calibration", "validation"), splits, strict=True):
            yield compared(f"{name}, halves of {split}", *halves(part), model)
        yield compared(f"{name}, calibration against validation", *splits, model)


def main(arguments: list[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    for line in table(parser.parse_args(arguments).data / "observations"):
        print(line, flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
