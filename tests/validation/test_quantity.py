"""Intervals against known truth, and laws of the numbers."""

import numpy as np
import pytest

import sonocal as sc
from sonocal.calibration.statistics import log_interval
from sonocal.validation.quantity import rms_quantity, trimmed_mean_quantity


def rms(errors, groups=None):
    groups = np.arange(len(errors)) if groups is None else groups
    return rms_quantity("c", "t", "d", np.asarray(errors, dtype=float), groups)


@pytest.mark.parametrize("units", [20, 60])
def test_the_interval_of_an_rms_holds_the_truth_19_times_in_20(units):
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(1000):
        found = rms(np.linalg.norm(rng.normal(size=(units, 2)), axis=1))
        held += found.low_mm <= np.sqrt(2) <= found.high_mm
    assert 930 <= held <= 970


def test_errors_that_a_frame_shares_widen_the_interval_as_they_should():
    rng = np.random.default_rng(2)
    groups, held, narrow = np.repeat(np.arange(30), 9), 0, 0
    for _ in range(500):
        errors = np.abs(np.repeat(rng.normal(size=30), 9) + 0.2 * rng.normal(size=270))
        truth = np.sqrt(1.04)
        clustered, single = rms(errors, groups), rms(errors)
        held += clustered.low_mm <= truth <= clustered.high_mm
        narrow += single.low_mm <= truth <= single.high_mm
    assert 460 <= held <= 490
    assert narrow < 350


def test_the_interval_of_a_trimmed_mean_holds_the_truth():
    rng = np.random.default_rng(3)
    many = np.sort(np.abs(rng.normal(size=400_000)))
    truth, held = many[: round(0.95 * len(many))].mean(), 0
    for _ in range(600):
        errors = np.abs(rng.normal(size=80))
        found = trimmed_mean_quantity("c", "t", "d", errors, np.arange(80), share=0.95)
        held += found.low_mm <= truth <= found.high_mm
    assert 555 <= held <= 585


def test_a_unit_of_length_scales_value_interval_and_spread():
    errors = np.random.default_rng(0).exponential(size=30)
    one, other = rms(errors), rms(25.4 * errors)
    for name in ("value_mm", "low_mm", "high_mm", "spread_mm"):
        assert getattr(other, name) == pytest.approx(25.4 * getattr(one, name))


def test_the_names_of_groups_do_not_matter():
    errors = np.random.default_rng(0).exponential(size=30)
    groups = np.arange(30) // 3
    assert rms(errors, groups) == rms(errors, 7 * groups + 100)


def test_two_units_have_a_value_and_no_interval():
    found = rms([1.0, 1.0, 2.0], np.array([0, 0, 1]))
    assert found.value_mm == pytest.approx(np.sqrt(2))
    assert np.isnan([found.low_mm, found.high_mm]).all()
    assert found.units == 2


def test_no_error_at_all_is_certain_and_wild_ones_do_not_overflow():
    assert log_interval(0.0, np.zeros(5), np.arange(5)) == (0.0, 0.0)
    low, high = log_interval(1e-30, np.array([1.0, -1, 1, -1]), np.arange(4))
    assert 0 < low < high < np.inf


def test_a_share_that_makes_no_sense_is_refused():
    with pytest.raises(sc.InputError, match="share must be above 0 and at most 1; got 0"):
        trimmed_mean_quantity("c", "t", "d", np.ones(3), np.arange(3), share=0)
