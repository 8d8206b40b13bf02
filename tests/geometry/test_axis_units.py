"""An axis in another unit is seen by a rigid needle, which changes its length with its direction."""

import numpy as np
import pytest

from sonocal.geometry.axis_units import axis_doubt, odd_axis


def needles(seed, count=40, length_mm=200.0, noise_mm=0.4):
    rng = np.random.default_rng(seed)
    along = rng.normal(size=(count, 3)) * [0.4, 0.6, 1.0]
    along *= length_mm / np.linalg.norm(along, axis=1, keepdims=True)
    first = rng.uniform(-100, 100, (count, 3))
    return np.stack([first, first + along], axis=1) + noise_mm * rng.normal(size=(count, 2, 3))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("unit", [0.1, 10.0, 1 / 25.4, 1e-3, 1e3])
def test_the_odd_axis_its_factor_and_the_needle_s_length_are_found(axis, unit):
    for seed in range(5):
        factors = np.where(np.arange(3) == axis, unit, 1.0)
        found, factor, length_mm = odd_axis(needles(seed) * factors)
        assert found == axis
        assert factor == pytest.approx(1 / unit, rel=0.05)
        assert length_mm == pytest.approx(200.0, rel=0.05)
        (said,) = axis_doubt(needles(seed) * factors)
        assert said.message.startswith(f"is {'xyz'[axis]} in another unit?")


@pytest.mark.parametrize("seed", range(20))
def test_needles_and_points_anywhere_on_a_line_are_not_accused(seed):
    rng = np.random.default_rng(seed)
    segments = needles(seed)
    along = segments[:, 1] - segments[:, 0]
    anywhere = segments[:, :1] + rng.uniform(0.2, 3.0, (40, 1, 1)) * np.stack([0 * along, along], axis=1)
    # Where each line meets two planes.
    middle, unit = segments.mean(axis=1), along / along[:, 2:]
    crossings = np.stack([middle + (z - middle[:, 2:]) * unit for z in (-100.0, 100.0)], axis=1)
    for each in (segments, anywhere, crossings, crossings + 0.4 * rng.normal(size=crossings.shape)):
        assert odd_axis(each) is None


def test_few_segments_and_segments_of_no_length_say_nothing():
    assert odd_axis(needles(1)[:9] * [1, 1, 10]) is None
    assert odd_axis(np.zeros((20, 2, 3))) is None
    assert odd_axis(np.tile(needles(1)[:1], (20, 1, 1))) is None
