"""Mixes that leave a motion free are refused by its name, with noise and without; the like that do not are answered."""

import numpy as np
import pytest
from benchmarks.simulators.degenerate_mixes import KINDS, SIDE, with_noise
from benchmarks.simulators.trust_scans import mapped

import sonocal as sc

CODES = {
    "shift": {"parallel-lines"},
    "scale": {"lines-through-one-point"},
    "turn": {"collinear-image-points", "points-on-one-line", "one-image-point", "lines-through-one-point"},
}


def table(made, dimension):
    _, points, spanning = made
    each, count = points.shape[1], len(points)
    padded = np.full((count, 3, 3), np.nan)
    padded[:, : spanning.shape[1]] = spanning
    return sc.Observations.of_targets(
        points.reshape(-1, 3)[:, :dimension],
        np.repeat(padded, each, axis=0),
        frame=np.repeat(np.arange(count), each),
        target=np.repeat([f"target {i % 6}" for i in range(count)], each),
        image_size_px=(500,) * dimension,
    )


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("sigma_px", "sigma_mm"), [(0.0, 0.0), (1.0, 0.3), (2.0, 1.0)])
@pytest.mark.parametrize("kind", KINDS)
def test_what_leaves_a_motion_free_is_refused_and_nothing_else(kind, dimension, sigma_px, sigma_mm):
    make, free = KINDS[kind]
    for seed in range(2):
        rng = np.random.default_rng(seed)
        made = with_noise(make(rng, dimension), rng, dimension, sigma_px, sigma_mm)
        if free:
            with pytest.raises(sc.DegenerateGeometryError) as caught:
                sc.calibrate(table(made, dimension))
            assert caught.value.code in CODES[free], str(caught.value)
            continue
        found = sc.calibrate(table(made, dimension))
        corners = np.array([[0, 0, 0], [SIDE - 1, 0, 0], [0, SIDE - 1, 0]])
        off = np.linalg.norm(found.probe_from_image @ corners - mapped(made[0], corners), axis=1)
        assert np.all(off <= 2.0 * found.predicted_errors()[2].max() + 1e-6)
