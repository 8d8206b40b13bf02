"""What is measured weighs more than what is predicted: points of known place, held-out rows, another calibration."""

import dataclasses

import numpy as np
import pytest

import sonocal as sc
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import PointSightings, compare, give_verdict, validate_points
from sonocal.validation.measured import comparison_findings
from tests.builders.calibrations import parted_rows, sound_calibration

SEEDS = range(100)


def touched(seed, count=20, off_mm=0.0, sigma_px=1.0, sigma_mm=0.5):
    """Points seen where they are, or all off by one vector, in the frame of the calibration's own truth."""
    rng = np.random.default_rng(seed)
    truth = simulate_observations(2, 60, seed=1).probe_from_image
    points = rng.uniform(0, 500, (count, 2))
    places = truth @ points + rng.normal(scale=sigma_mm, size=(count, 3)) + off_mm * np.eye(3)[seed % 3]
    return PointSightings(
        points_px=points + rng.normal(scale=sigma_px, size=points.shape),
        frame=np.arange(count),
        target=np.full(count, "tip"),
        points_mm=places,
    )


def codes(found, sightings):
    return {finding.code for finding in validate_points(found, sightings).diagnostics}


@pytest.mark.parametrize("count", [1, 2, 5, 50])
def test_sound_points_are_no_surprise(count):
    found = sound_calibration()
    assert (
        sum(bool(codes(found, touched(seed, count)) & {"points-off", "points-far-off"}) for seed in SEEDS)
        <= 2
    )


@pytest.mark.parametrize("count", [3, 10, 50])
def test_points_that_are_off_are_said_to_be(count):
    found = sound_calibration()
    assert sum("points-off" in codes(found, touched(seed, count, 5.0)) for seed in SEEDS) >= 90


@pytest.mark.parametrize("count", [1, 2, 4, 50])
def test_points_far_off_stop_whoever_would_use_it(count):
    found, points = sound_calibration(), touched(3, count, 100.0)
    verdict = give_verdict(found, validate_points(found, points))
    assert (verdict.level, verdict.codes[-1]) == ("stop", "points-far-off")
    assert "What was measured says otherwise." in verdict.expectation


@pytest.mark.parametrize("off_mm", [(6.0, 14.0, 34.0), (0.5, 36.5, 1.4), (0.2,) * 199 + (36.0,)])
def test_points_that_are_off_by_unlike_lengths_are_said_to_be_and_the_furthest_is_named(off_mm):
    found, points = sound_calibration(), touched(3, len(off_mm), 0.0, sigma_mm=0.1)
    places = points.points_mm + np.asarray(off_mm)[:, None] * np.eye(3)[np.arange(len(off_mm)) % 3]
    findings = validate_points(found, dataclasses.replace(points, points_mm=places)).diagnostics
    (finding,) = [one for one in findings if one.code.startswith("points-")]
    assert f"point {int(np.argmax(off_mm)) + 1} of {len(off_mm)}" in finding.message
    assert finding.code == ("points-off" if len(off_mm) > 3 else "points-far-off")


def test_who_accepts_more_is_stopped_later():
    found, points = sound_calibration(), touched(3, 20, 12.0)
    assert "points-far-off" in codes(found, points)
    lenient = dataclasses.replace(found, options=dataclasses.replace(found.options, tolerance_mm=10.0))
    assert codes(lenient, points) == {"points-off"}


def test_another_calibration_that_differs_is_a_finding_and_the_same_one_is_none():
    found = sound_calibration()
    again = sc.calibrate(simulate_observations(2, 60, seed=1).observations, image_size_px=(500, 500))
    assert not list(comparison_findings(found, compare(found, again)))
    other = sound_calibration(seed=2)
    (finding,) = comparison_findings(found, compare(found, other))
    assert finding.code == "calibrations-differ"
    assert finding.severity == "warning"


def with_gross(rows, share, seed):
    """Image points of a share of the rows thrown anywhere."""
    rng = np.random.default_rng(seed)
    points = np.where(rng.random((len(rows), 1)) < share, rng.uniform(0, 500, (len(rows), 2)), rows.points_px)
    return dataclasses.replace(rows, points_px=points)


def test_gross_errors_among_held_out_rows_are_no_surprise_where_the_fit_left_out_as_many():
    said = 0
    for seed in SEEDS:
        rows = with_gross(parted_rows(seed, count=90, fitted=60), 0.2, seed)
        found = sc.calibrate(rows, fit_split="fit", test_split="test")
        said += any(finding.code.startswith("held-out") for finding in found.warnings)
    assert said <= 3


def test_gross_errors_among_held_out_rows_alone_are_a_surprise():
    said = 0
    for seed in range(30):
        rows = parted_rows(seed, count=90, fitted=60)
        gross = with_gross(rows, 0.5, seed)
        late = (rows.split == "test")[:, None]
        mixed = dataclasses.replace(rows, points_px=np.where(late, gross.points_px, rows.points_px))
        found = sc.calibrate(mixed, fit_split="fit", test_split="test")
        said += any(finding.code.startswith("held-out") for finding in found.warnings)
    assert said == 30
