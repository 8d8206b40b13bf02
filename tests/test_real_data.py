"""Recorded sets: what PLUS segmented in its own regression data."""

import re

import pytest

import sonocal as sc


def calibrated(data_folder, name, **options):
    rows = sc.read_observations(data_folder / "observations" / f"{name}.csv")
    return sc.calibrate(rows, fit_split="calibration", test_split="validation", **options)


def test_depth15_is_fitted_better_than_plus_fits_it(data_folder):
    found = calibrated(data_folder, "depth15_polaris")
    assert found.test.rms_mm <= 0.518  # PLUS's own matrix
    assert found.fit.rms_mm <= 0.385
    assert found.probe_from_image.scale == pytest.approx(0.2844, abs=0.0005)
    # Neighbouring frames agree by more than chance, and the recording's halves are 2 to 4 mm apart.
    assert [d.code for d in found.warnings] == ["drifting-residuals"]


def test_fcal12_is_said_to_have_unequal_pixels(data_folder):
    found = calibrated(data_folder, "fcal12_ascension")
    unequal = next(d for d in found.warnings if d.code == "anisotropic-scale")
    u, v, apart = map(
        float, re.search(r"(0\.\d+) and (0\.\d+) mm/px, ([\d.]+) % apart", unequal.message).groups()
    )
    assert (u, v) == pytest.approx((0.0787, 0.0739), abs=2e-4)
    assert apart == pytest.approx(6.5, abs=0.3)
    wider = calibrated(data_folder, "fcal12_ascension", model="anisotropic")
    assert wider.probe_from_image.scales[:2] == pytest.approx([0.0782, 0.0736], abs=6e-4)
    assert wider.test.rms_mm < found.test.rms_mm
    assert wider.test.rms_mm <= 0.755
    assert found.models[0].contradicts
    assert wider.models[0].contradicts


def test_fcal12_by_two_scales_and_equal_weights_is_within_three_quarters_of_a_millimetre(data_folder):
    one, two = (
        calibrated(data_folder, "fcal12_ascension", model=model, weighting="geometric")
        for model in ("similarity", "anisotropic")
    )
    assert two.test.rms_mm <= 0.75 < one.test.rms_mm  # PLUS's own matrix: 0.808
    assert two.models[0].contradicts


def test_trus_is_not_presented_as_sound(data_folder):
    found = calibrated(data_folder, "trus_3nwires")
    weak = next(d for d in found.warnings if d.code == "weak-motion")
    assert re.search(r"loosest is (rotation about|shift along) the image.*, known to \+-", weak.message)
    assert "all needles lie within 15 deg of one direction" in weak.message
    assert found.predicted_errors()[2][:4].min() > 2
    assert "drifting-residuals" in [d.code for d in found.warnings]
