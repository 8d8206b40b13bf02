"""Pixels and voxels that are not square are found, the odd axis is named, and sound of another speed with it."""

import dataclasses

import numpy as np
import pytest
from benchmarks.comparison import needle_scan
from benchmarks.simulators.scans import scan
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration.fit import fit_rows
from sonocal.calibration.options import Options
from sonocal.validation import give_verdict

CODE = "anisotropic-scale"


def rows_of(seed, dimension, count, stretched=()):
    """Sightings whose image is stretched by factors along its axes: one px is so much less."""
    rng = np.random.default_rng([seed, dimension, count])
    truth = (Rotation.random(random_state=seed).as_matrix(), rng.uniform(-100, 100, 3))
    rows = needle_scan(rng, truth, dimension, count)
    return dataclasses.replace(rows, points_px=rows.points_px / (stretched or (1.0,) * dimension))


def said(rows, **options):
    return [one.message for one in sc.calibrate(rows, **options).diagnostics if one.code == CODE]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("weighting", ["likelihood", "geometric"])
def test_voxels_of_another_length_along_one_axis_are_found_and_the_axis_is_named(axis, weighting):
    stretched = tuple(1.1 if one == axis else 1.0 for one in range(3))
    for seed in range(6):
        (message,) = said(rows_of(seed, 3, 30, stretched), weighting=weighting)
        assert f"mm/px; {'uvw'[axis]} is +" in message
        assert "sound of" not in message


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("speed", [1482.0, 1600.0])
def test_a_stretch_of_depth_names_the_speed_of_sound(speed, dimension):
    for seed in range(6):
        rows = rows_of(seed, dimension, 200, (1.0, speed / 1540.0, 1.0)[:dimension])
        (message,) = said(rows)
        named = float(message.split("sound of ")[1].split(" m/s")[0])
        assert named == pytest.approx(speed, abs=20)


@pytest.mark.parametrize("count", [6, 10, 20, 60])
def test_cubes_are_not_accused(count):
    assert sum(bool(said(rows_of(seed, 3, count))) for seed in range(20)) <= 1


def test_wires_that_are_off_are_no_stretch():
    """Errors that a wire's rows share are many rows and few measurements."""
    found = 0
    for seed in range(40):
        rows = scan(seed, dimension=3, frames=150).observations
        wire = rows.frame % 15
        off = np.random.default_rng(seed).normal(scale=1.5, size=(15, 1, 3))
        rows = dataclasses.replace(rows, target=wire.astype(str), segments_mm=rows.segments_mm + off[wire])
        found += bool(said(rows))
    assert found <= 2


@pytest.mark.parametrize("seed", range(5))
def test_the_scales_are_those_of_the_voxels_wherever_the_marker_is(seed):
    rows = rows_of(seed, 3, 100, (1.0, 0.97, 1.05))
    found = fit_rows(rows, Options(model="anisotropic")).fit.transform.scales
    np.testing.assert_allclose(found, 0.24 * np.array([1.0, 0.97, 1.05]), rtol=0.015)
    moved = sc.Similarity(Rotation.random(random_state=seed).as_matrix(), np.array([50.0, -20.0, 9.0]), 1.0)
    other = dataclasses.replace(rows, segments_mm=moved @ rows.segments_mm)
    np.testing.assert_allclose(
        fit_rows(other, Options(model="anisotropic")).fit.transform.scales, found, rtol=1e-4
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_scales_that_move_corners_far_stop_and_lead(dimension):
    rows = rows_of(5, dimension, 120, (1.0, 1.25, 1.0)[:dimension])
    verdict = give_verdict(sc.calibrate(rows, threshold_mm=20.0))
    assert verdict.level == "stop"
    assert verdict.codes[:2] == (CODE, f"{CODE}-far-off")
    lenient = give_verdict(sc.calibrate(rows, threshold_mm=20.0, tolerance_mm=100.0))
    assert f"{CODE}-far-off" not in lenient.codes
