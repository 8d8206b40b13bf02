"""Noise in what a fit is made from: what it pulls is taken out, and what it alone may give is not believed."""

import numpy as np
import pytest
from benchmarks.simulators.near_degenerate import DEGENERATE, SCALE, corner_errors, scan

import sonocal as sc

CODES = {
    "one-plane": "coplanar-lines",
    "one-port": "lines-through-one-point",
    "one-direction": "parallel-lines",
    "one-image-line": "collinear-image-points",
}
KINDS = [(dimension, kind) for dimension, kinds in DEGENERATE.items() for kind in kinds]


@pytest.mark.parametrize("weighting", ["likelihood", "geometric"])
@pytest.mark.parametrize(("dimension", "kind"), KINDS)
def test_noise_does_not_make_a_degenerate_scan_an_answer(dimension, kind, weighting):
    for seed, (count, sigma_px, sigma_mm) in enumerate(
        [(10, 1, 0.3), (30, 3, 0.3), (100, 0.5, 1), (300, 1, 1)]
    ):
        made = scan(seed, kind, dimension=dimension, count=count, sigma_px=sigma_px, sigma_mm=sigma_mm)
        with pytest.raises(sc.DegenerateGeometryError) as caught:
            sc.calibrate(made.observations, weighting=weighting)
        assert caught.value.code == CODES[kind]


@pytest.mark.parametrize("dimension", [2, 3])
def test_sound_scans_owe_nothing_to_noise(dimension):
    for seed in range(20):
        made = scan(seed, dimension=dimension, count=(10, 40)[seed % 2], sigma_px=2.0, sigma_mm=0.5)
        assert sc.calibrate(made.observations).noise.apparent < 0.05


@pytest.mark.parametrize(("sigma_px", "sigma_mm"), [(3.0, 0.3), (1.0, 1.0)])
def test_many_needles_through_a_narrow_port_do_not_shrink_the_image(sigma_px, sigma_mm):
    """Held fixed, the covariance of residuals would let noise shrink it by 7 to 9 %."""
    levels = {"sigma_px": sigma_px, "sigma_mm": sigma_mm}
    off = []
    for seed in range(24):
        made = scan(seed, "one-port", count=400, spread=3.0, **levels)
        off.append(sc.calibrate(made.observations, **levels).probe_from_image.scale / SCALE - 1)
    assert abs(np.mean(off)) < 3 * np.std(off) / np.sqrt(len(off)) + 0.003


def test_through_a_port_the_bound_holds_though_levels_are_estimated():
    held = []
    for seed in range(30):
        made = scan(seed, "one-port", count=60, spread=4.0, sigma_px=2.0, sigma_mm=0.4)
        found = sc.calibrate(made.observations, image_size_px=(500, 500))
        off = corner_errors(found.probe_from_image.matrix, made.truth, 2)
        held.append(np.mean(off <= found.predicted_errors()[2][:4]))
    assert np.mean(held) > 0.85


def test_rows_too_few_to_tell_are_not_refused_for_it():
    found = sc.calibrate(scan(0, count=4).observations)
    assert "no-redundancy" in {finding.code for finding in found.warnings}
