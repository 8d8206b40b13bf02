"""Axes of simulated steppers beside their truth: errors, and what the stated ones cover.

    python -m benchmarks.steppers [--seeds 200] [--first-seed 1000]

The simulator shares no code with what it measures.
"""

import argparse

import numpy as np

from benchmarks.simulators.stepper import stepper
from sonocal.tools import calibrate_stepper

SCENES = {
    "90 deg, 60 mm": {},
    "40 deg, 30 mm": {"turn_deg": 40.0, "travel_mm": 30.0},
    "90 deg, 60 mm, tilted by 1 deg": {"tilt_deg": 1.0},
    "90 deg, 60 mm, tilted by 0.3 deg": {"tilt_deg": 0.3},
}


def angle_deg(one, other):
    """Between two axes of whichever sign."""
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(one, other)), abs(one @ other)))


def centre_off_mm(found, truth):
    """How far the axis that was found passes by the point of the true one nearest the marker."""
    axis, point, _ = truth
    away = point - axis * (axis @ point) - found.centre_mm
    return np.linalg.norm(away - found.axis * (found.axis @ away))


def covered(vector, truth, covariance):
    """Of an axis, along each of two directions across it, whether it is within its 95 %."""
    vector = vector if vector @ truth > 0 else -vector
    across = np.linalg.svd(vector[None])[2][1:]
    off = across @ (truth - vector)
    return np.abs(off) < 1.96 * np.sqrt(np.einsum("ij,jk,ik->i", across, covariance, across))


def main():
    """Print a row a scene."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=1000)
    asked = parser.parse_args()
    for name, options in SCENES.items():
        rows, tilted = [], 0
        for seed in range(asked.first_seed, asked.first_seed + asked.seeds):
            rotation, translation, truth = stepper(seed, **options)
            found = calibrate_stepper(rotation, translation)
            tilted += "stepper-tilted" in [one.code for one in found.diagnostics]
            rows.append(
                (
                    angle_deg(found.axis, truth[0]),
                    angle_deg(found.translation, truth[2]),
                    centre_off_mm(found, truth),
                    covered(found.axis, truth[0], found.axis_covariance).mean(),
                    covered(found.translation, truth[2], found.translation_covariance).mean(),
                )
            )
        axis, along, centre, first, second = np.array(rows).T
        print(
            f"{name:34} axis {np.median(axis):.3f} deg (95 % below {np.quantile(axis, 0.95):.3f}), translation "
            f"{np.median(along):.3f} deg ({np.quantile(along, 0.95):.3f}), centre {np.median(centre):.2f} mm "
            f"({np.quantile(centre, 0.95):.2f}); covered {first.mean():.1%} and {second.mean():.1%}; "
            f"said to be tilted {tilted} of {asked.seeds}",
            flush=True,
        )


if __name__ == "__main__":
    main()
