"""A second scan at another depth is named so, by its own calibration; one of the same depth is not."""

import dataclasses
import re

import numpy as np
import pytest

import sonocal as sc
from sonocal.findings import reading_order
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict, validate


def two_scans(seed, factor, **options):
    """A calibration, and rows whose images show `factor` times as many mm a px."""
    rows = simulate_observations(2, 120, seed=seed).observations
    pick = np.arange(120) < 60
    second = rows.select(~pick)
    second = dataclasses.replace(
        second, points_px=second.points_px / factor, image_size_px=None, sha256="", source="second.csv"
    )
    return sc.calibrate(rows.select(pick), **options), second


@pytest.mark.parametrize("factor", [0.8, 1.25, 2.0])
@pytest.mark.parametrize("seed", range(3))
def test_another_depth_setting_is_named_first_and_no_frame_is_blamed(seed, factor):
    calibration, second = two_scans(seed, factor)
    found = validate(calibration, second)
    said = [one.code for one in found.diagnostics if one.severity == "warning"]
    assert said[:2] == ["other-depth-setting", "held-out-rows-far-off"]
    assert "wrong-tool-frame" not in said
    percent = re.search(r"they differ by (\S+) %", found.diagnostics[0].message)
    assert float(percent[1]) == pytest.approx(100 * (factor - 1), abs=3)
    verdict = give_verdict(calibration, found)
    assert verdict.level == "stop"
    assert list(verdict.codes) == sorted(verdict.codes, key=reading_order)
    assert [code for code in verdict.codes if code in said] == said


@pytest.mark.parametrize("seed", range(3))
def test_the_same_depth_is_not(seed):
    calibration, second = two_scans(seed, 1.0)
    assert "other-depth-setting" not in [one.code for one in validate(calibration, second).diagnostics]


@pytest.mark.parametrize("factor", [0.8, 1.25])
def test_a_known_scale_is_no_reason_to_fit_another_depth_at_it(factor):
    calibration, second = two_scans(2, factor, scale_mm_per_px=0.24)
    said = [one.code for one in validate(calibration, second).diagnostics if one.severity == "warning"]
    assert said[:2] == ["other-depth-setting", "held-out-rows-far-off"]


@pytest.mark.parametrize("off", [-0.05, 0.05])
def test_a_known_scale_that_was_wrong_makes_no_other_depth_of_a_scan_of_the_same(off):
    calibration, second = two_scans(2, 1.0, scale_mm_per_px=0.24 * (1 + off))
    assert "known-scale-disagrees" in [one.code for one in calibration.diagnostics]
    assert "other-depth-setting" not in [one.code for one in validate(calibration, second).diagnostics]
    _, deeper = two_scans(2, 1.25)
    (finding,) = (
        one for one in validate(calibration, deeper).diagnostics if one.code == "other-depth-setting"
    )
    percent = re.search(r"they differ by (\S+) %", finding.message)
    assert float(percent[1]) == pytest.approx(25, abs=3)


def test_a_marker_that_was_moved_is_no_depth_and_no_frame():
    calibration, second = two_scans(1, 1.0)
    second = dataclasses.replace(second, segments_mm=second.segments_mm + 30.0)
    said = [one.code for one in validate(calibration, second).diagnostics]
    assert said[0] == "held-out-rows-far-off"
    assert not {"wrong-tool-frame", "other-depth-setting"} & set(said)
