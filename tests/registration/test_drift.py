"""The drift that neighbouring frames share: its likelihood and covariance by dense matrices, and laws of its clock."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.trust_judge import calibrated
from benchmarks.simulators.trust_sound import SOUND
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import _core
from sonocal.registration.options import Options
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import to_core
from tests.builders.point_lines import scene_rows

seeds = st.integers(0, 3_000)


def drifting(seed, frames=80, memory=15.0, millimetres=1.0):
    """One needle a frame whose line is off by an autoregression of some standard deviation."""
    rows, _ = scene_rows(seed, 2, frames)
    rng = np.random.default_rng([seed, 1])
    keeps = np.exp(-1.0 / memory)
    steps, off = rng.normal(size=(frames, 3)), np.zeros((frames, 3))
    off[0] = steps[0]
    for t in range(1, frames):
        off[t] = keeps * off[t - 1] + np.sqrt(1.0 - keeps**2) * steps[t]
    return dataclasses.replace(
        rows, segments_mm=np.ascontiguousarray(rows.segments_mm + millimetres * off[:, None])
    )


def found_in(rows, time, **options):
    """The core's answer, and the white residuals that it is of."""
    fit = fit_point_lines(rows, Options.of(threshold_mm=100.0, **options))
    of_fit = fit.options.to_core(fit.sigma_px, fit.sigma_mm)
    about = rows.core, fit.inlier, to_core(fit.transform), of_fit
    sums = _core.noise_sums(*about, fit.covariance, [], time=time, known_px=False, known_mm=False)
    return sums.drift, _core.white_residuals(*about), fit.covariance


def kernel_of(white, time, memory):
    """(M, M): the covariance of the residuals under a drift of unit variance."""
    at = time[white.row]
    return white.shift @ white.shift.T * np.exp(-np.abs(at[:, None] - at) / memory)


def misfit(white, covariance):
    """Minus twice the logarithm of the restricted likelihood but for a constant, the scale profiled.

    Turns and scales are stiff: e times as large costs four times what residuals are expected to sum to.
    """
    root = np.linalg.inv(np.linalg.cholesky(covariance))
    count, k = white.jacobian.shape
    stiff = np.sqrt(4.0 * (count - k)) * np.delete(np.eye(k), [3, 4, 5], axis=0)
    x = np.concatenate([root @ white.jacobian, stiff])
    y = np.concatenate([root @ white.white, np.zeros(len(stiff))])
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    determinants = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(x.T @ x)[1]
    return (count - k) * np.log(left @ left) + determinants


@settings(max_examples=15)
@given(seeds, st.sampled_from(["likelihood", "geometric"]))
def test_the_gain_is_that_of_the_restricted_likelihood_and_nothing_near_is_likelier(seed, weighting):
    time = np.sort(np.random.default_rng(seed).uniform(0, 80, 80))
    drift, white, _ = found_in(drifting(seed), time, weighting=weighting)
    if drift.gain == 0:
        return

    def value(wander, memory):
        return misfit(white, np.eye(len(white.white)) + wander * kernel_of(white, time, memory))

    here = value(drift.wander, drift.memory)
    assert drift.gain == pytest.approx(misfit(white, np.eye(len(white.white))) - here, abs=1e-5)
    beside = [
        (drift.wander * 1.3, drift.memory),
        (drift.wander / 1.3, drift.memory),
        (drift.wander, drift.memory * 1.3),
        (drift.wander, drift.memory / 1.3),
    ]
    most = 2 * np.ptp(time)  # of the memories that are tried
    assert all(value(*one) > here - 1e-6 for one in beside if one[1] < most)


@settings(max_examples=10)
@given(seeds)
def test_what_it_does_to_the_covariance_is_that_of_the_fit_to_it(seed):
    time = np.arange(80.0)
    drift, white, covariance = found_in(drifting(seed), time)
    if drift.gain == 0:
        return
    pulled = covariance @ white.jacobian.T
    expected = drift.wander * pulled @ kernel_of(white, time, drift.memory) @ pulled.T
    size = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(
        drift.of_offsets / np.outer(size, size), expected / np.outer(size, size), atol=1e-9
    )


@settings(max_examples=10)
@given(seeds, st.floats(-1e4, 1e4))
def test_when_the_clock_starts_and_which_way_it_runs_change_nothing(seed, start):
    rows, time = drifting(seed), np.arange(80.0)
    one = found_in(rows, time)[0]
    for other in (found_in(rows, time + start)[0], found_in(rows, -time)[0]):
        assert other.gain == pytest.approx(one.gain, abs=1e-5)
        if one.gain > 0:
            assert (other.memory, other.wander) == pytest.approx((one.memory, one.wander), rel=1e-6)


def test_memory_and_size_are_those_put_in():
    found = [found_in(drifting(seed, 300, 10.0), np.arange(300.0))[0] for seed in range(20)]
    assert all(one.gain > 20 for one in found)
    assert 7.0 < np.median([one.memory for one in found]) < 14.0
    stretches = np.median([one.stretches for one in found])
    assert stretches == pytest.approx(1 + 299 / (2 * np.median([one.memory for one in found])), rel=0.05)


def test_independent_rows_hardly_ever_drift():
    gains = [found_in(scene_rows(seed, 2, 80)[0], np.arange(80.0))[0].gain for seed in range(200)]
    assert sum(gain > 0 for gain in gains) <= 20  # by chance one of 20
    assert sum(gain > 8 for gain in gains) <= 3


@pytest.mark.parametrize("seed", [20019, 20020, 20026, 20042])
def test_a_sound_sweep_is_not_shrunk_to_a_point_whose_needles_drift(seed):
    """If the image vanished, a drift could be all its needles' ways: weights do not move with the transform."""
    assert calibrated(SOUND["3D, sweep"](seed, 400)).noise.drift is None
