"""Noise that a threshold cuts is no second needle and no wrong frame, but a threshold below the noise."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.scans import scan

import sonocal as sc
from sonocal.calibration.rows import point_line_rows
from sonocal.setup_checks.refused import Refused, refusal_findings

CODE = "threshold-below-noise"


def noisy(seed, noise_mm, dimension=2):
    """A scan with normal noise, of about that much per axis across the line, added to the ends of its lines."""
    rows = scan(seed, dimension=dimension, frames=200, outliers=0.0).observations
    noise = np.random.default_rng(seed).normal(0.0, noise_mm, (rows.frame.max() + 1, 1, 3))
    return dataclasses.replace(rows, segments_mm=rows.segments_mm + noise[rows.frame])


def found_in(rows, **options):
    return {one.code: one for one in sc.calibrate(rows, **options).warnings}


@pytest.mark.parametrize(
    ("noise_mm", "threshold_mm", "least", "most"),
    [
        (4.0, 5.0, 8, 10),
        (2.3, 5.0, 2, 10),
        (1.0, 5.0, 0, 0),
        (1.0, 1.5, 8, 10),
        (1.0, 2.2, 0, 10),
        (1.0, 3.4, 0, 1),
    ],
)
def test_cut_noise_is_no_second_needle_and_a_threshold_far_below_it_is_named(
    noise_mm, threshold_mm, least, most
):
    named = [found_in(noisy(seed, noise_mm), threshold_mm=threshold_mm) for seed in range(10)]
    assert not any("second-needle" in codes for codes in named)
    assert sum("wrong-tool-frame" in codes for codes in named) <= 1
    assert least <= sum(CODE in codes for codes in named) <= most


def test_noise_of_whole_lines_of_a_volume_is_no_second_needle():
    named = [found_in(noisy(seed, 2.6, dimension=3)) for seed in range(10)]
    assert not any({"second-needle", "wrong-tool-frame"} & set(codes) for codes in named)


@pytest.mark.parametrize("threshold_mm", [1.5, 2.0])
def test_the_noise_is_estimated_from_what_a_threshold_leaves_of_it(threshold_mm):
    told = [found_in(noisy(seed, 1.0), threshold_mm=threshold_mm).get(CODE) for seed in range(12)]
    deviations = [float(one.message.split("noise, which is ")[1].split(" mm")[0]) for one in told if one]
    assert len(deviations) >= 4
    assert np.median(deviations) == pytest.approx(1.1, abs=0.15)


def test_auto_is_never_below_the_noise():
    assert not any(CODE in found_in(noisy(seed, 2.0), threshold_mm="auto") for seed in range(20))


def test_refused_rows_that_agree_within_what_is_usual_are_merely_noisy():
    rows = noisy(0, 0.5)
    for threshold_mm, code in ((0.05, CODE), (5.0, "wrong-tool-frame")):
        refused = Refused(rows, point_line_rows(rows), "similarity", threshold_mm, agreeing=6)
        assert [one.code for one in refusal_findings(refused)] == [code]
