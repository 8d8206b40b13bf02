"""How often a pixel's true place is within the predicted distance of the voxel that it was put into.

Of the tracker's jitter alone, of a calibration's own error alone, and of both. A calibration errs alike at all of its
pixels, so that each simulated sweep has a calibration of its own, found from simulated sightings of a needle.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import sonocal as sc
from benchmarks.simulators.fields import path, probe_from_image, turned
from sonocal.reconstruction.options import Options
from sonocal.reconstruction.placed import image_matrix, place
from sonocal.reconstruction.sureness import Repeated, error_image_um
from sonocal.recording import ImageGeometry, Poses, Recording
from sonocal.simulation.scene import IMAGE_PX, simulate_observations

JITTER = (0.3, 0.3)
FRAMES, SIGHTINGS, SIGMA = 30, 20, 0.5
STEP_PX = 55


def error(seeds: range) -> None:
    """Of each source of error: places within the predicted 95 %, between images and at them."""
    for what in ("jitter", "calibration", "both"):
        for mode in ("nearest", "between"):
            shares = [_within(seed, what, mode) for seed in seeds]
            spread = np.std(shares) / np.sqrt(len(shares))
            print(
                f"error     {what}, {mode}: {np.mean(shares):.1%} +- {spread:.1%} of the places of {len(shares)} "
                "sweeps within the predicted 95 %"
            )


def _within(seed: int, what: str, mode: str) -> float:
    rng = np.random.default_rng([seed, 2])
    true = path(FRAMES)
    jitter = (0.0, 0.0) if what == "calibration" else JITTER
    seen = true.copy()
    seen[:, :3, :3] = true[:, :3, :3] @ turned(rng, np.radians(jitter[1]), FRAMES)
    seen[:, :3, 3] += rng.normal(0, jitter[0], (FRAMES, 3))
    calibration, matrix = _calibrated(seed) if what != "jitter" else (probe_from_image(), probe_from_image())
    side = IMAGE_PX if what != "jitter" else 100
    step = STEP_PX if what != "jitter" else 9
    options = Options(noise_mm=jitter[0], noise_deg=jitter[1], interpolation=mode)
    predicted = error_image_um(
        calibration, place(_sweep(seen, side), image_matrix(calibration), options), options
    )
    v, u = np.mgrid[:side:step, :side:step].reshape(2, -1)
    pixels = np.stack([u, v, 0 * u, 1 + 0 * u]).astype(float)
    off = (seen @ image_matrix(calibration) @ pixels - true @ matrix @ pixels)[:, :3].transpose(0, 2, 1)
    if mode == "between":
        t = rng.random((FRAMES - 1, len(u), 1))
        off = (1 - t) * off[:-1] + t * off[1:]
    return float(np.mean(np.linalg.norm(off, axis=2) <= predicted[v, u] / 1000))


def _calibrated(seed: int) -> tuple[Any, Any]:
    """A calibration, and the truth that it was to find."""
    simulated = simulate_observations(2, SIGHTINGS, sigma_px=SIGMA, sigma_mm=SIGMA, seed=seed)
    return sc.calibrate(simulated.observations), simulated.probe_from_image.matrix


def _sweep(seen: Any, side: int) -> Recording:
    """Poses, and images of which only the size is of use."""
    frames, one = Repeated(np.zeros((side, side), np.uint8), len(seen)), Poses.of("Probe", "Tracker", seen)
    return Recording(np.arange(len(seen)) / 20, frames, {one.name: one}, ImageGeometry.of(frames, 2, "MF"))
