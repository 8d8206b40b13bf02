"""Lengths that are not mm, and places that are not px, are doubted by name; sound scans are not."""

import dataclasses

import numpy as np
import pytest
from benchmarks.simulators.scans import scan
from click.testing import CliRunner
from hypothesis import given
from hypothesis import strategies as st

import sonocal as sc
from sonocal.cli.main import main
from sonocal.geometry.units import length_hints, needle_hints, place_hints, scale_hints, scan_hints
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict
from tests.builders.recordings import random_poses

CODE = "implausible-units"
IN_MM = {"metres": 1000.0, "centimetres": 10.0, "inches": 25.4}


def doubts(rows):
    return [one for one in sc.calibrate(rows).warnings if one.code == CODE]


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("unit", IN_MM)
def test_a_unit_is_named_and_stops(unit, dimension):
    for seed in range(10):
        rows = scan(seed, dimension=dimension, outliers=0).observations
        other = dataclasses.replace(rows, segments_mm=rows.segments_mm / IN_MM[unit])
        (doubt,) = doubts(other)
        assert unit in doubt.message
        assert f"{IN_MM[unit]:g}" in doubt.advice
        assert give_verdict(sc.calibrate(other)).level == "stop"


def test_shares_of_the_image_are_named():
    rows = simulate_observations(2, 40, seed=1).observations
    shares = dataclasses.replace(rows, points_px=rows.points_px / 500, image_size_px=None)
    (doubt,) = doubts(shares)
    assert "are these pixels?" in doubt.message
    assert "multiply u by the image's width" in doubt.advice


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", [10, 50, 400])
def test_sound_scans_are_not_doubted(dimension, count):
    for seed in range(20):
        assert not doubts(simulate_observations(dimension, count, seed=seed).observations)


# A scale of one is that of places which are in mm already.
NOT_ONE = st.floats(0.02, 0.97) | st.floats(1.03, 1.4)


@given(NOT_ONE, st.floats(30, 400), st.floats(100, 1500))
def test_what_scanners_and_needles_are_is_not_doubted(mm_per_px, needle_mm, away_mm):
    rng = np.random.default_rng(0)
    points, segments = rng.uniform(0, 500, (20, 2)), np.zeros((20, 2, 3)) + away_mm
    segments[:, 1, 2] += needle_mm
    assert not scale_hints(np.array([mm_per_px]))
    assert not length_hints(points, np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1))
    assert not needle_hints("needle", needle_mm)
    poses = random_poses(rng, 20)
    poses[:, :3, 3] += away_mm
    assert not place_hints("Probe", poses)


def test_an_unsure_scale_is_not_doubted_and_a_sure_one_is():
    assert scale_hints(np.array([0.008]), 0.01)
    assert not scale_hints(np.array([0.008]), 0.2)


@given(st.floats(0.1, 3.75))
def test_voxels_of_the_deepest_setting_are_not_doubted(mm_per_px):
    """240 mm in 64 voxels."""
    assert not scale_hints(np.array([mm_per_px]), dimension=3)
    if abs(mm_per_px - 1.0) > 0.03:
        assert bool(scale_hints(np.array([mm_per_px]), dimension=2)) == (mm_per_px > 1.5)


def test_shares_of_a_volume_are_doubted_by_the_scale_too():
    assert scale_hints(np.array([60.0]), 0.01, dimension=3)


def test_a_scale_that_is_hardly_known_is_neither_doubted_nor_a_warning_of_numpy():
    with np.errstate(all="raise"):
        assert not scale_hints(np.array([1e-5]), 1e6)
        assert not scale_hints(np.array([1e5]), 1e6)


def test_the_command_stops_writes_nothing_and_goes_on_when_told(tmp_path):
    rows = scan(0, outliers=0).observations
    sc.write_observations(dataclasses.replace(rows, segments_mm=rows.segments_mm / 1000), tmp_path / "a.csv")
    arguments = ["calibrate", str(tmp_path / "a.csv"), "-o", str(tmp_path / "out"), "--no-report"]
    refused = CliRunner().invoke(main, arguments)
    assert (refused.exit_code, "are these metres?" in refused.output) == (1, True)
    assert not (tmp_path / "out").exists()
    told = CliRunner().invoke(main, [*arguments, "--accept-units"])
    assert told.exit_code == 0, told.output
    assert "Do not use it." in told.output
    assert "Sound" not in told.output


def lengthened(rows, needle_mm):
    """The same needle, of another length from the same middle."""
    middle = rows.segments_mm.mean(axis=1, keepdims=True)
    away = rows.segments_mm - middle
    away *= needle_mm / 2 / np.linalg.norm(away, axis=2, keepdims=True)
    return dataclasses.replace(rows, segments_mm=middle + away)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("needle_mm", [100.0, 300.0, 400.0, 600.0])
def test_centimetres_are_named_however_long_the_needle_is(dimension, needle_mm):
    for seed in range(5):
        rows = lengthened(scan(seed, dimension=dimension, outliers=0).observations, needle_mm)
        assert not doubts(rows)
        (doubt,) = doubts(dataclasses.replace(rows, segments_mm=rows.segments_mm / 10))
        assert "centimetres" in doubt.message


def test_places_in_mm_are_named_and_voxels_of_a_millimetre_are_sound():
    for dimension, named in ((2, 1), (3, 0)):
        for seed in range(5):
            rows = scan(seed, dimension=dimension, outliers=0).observations
            scale = sc.calibrate(rows).probe_from_image.scale
            found = doubts(dataclasses.replace(rows, points_px=rows.points_px * scale, image_size_px=None))
            assert len(found) == named
            assert all("in mm already?" in one.message for one in found)


@given(
    image_mm=st.floats(20, 350),
    needle_mm=st.floats(31, 600),
    marker_mm=st.floats(15, 300),
    scale=st.floats(0.02, 0.9),
    rms_mm=st.floats(0.05, 3),
    dimension=st.sampled_from([2, 3]),
)
def test_scans_of_usual_images_are_not_doubted_for_their_size(**measures):
    assert not scan_hints(**measures)


@given(st.floats(10, 19), st.floats(31, 600), st.floats(15, 300), st.floats(0.25, 2))
def test_probes_of_high_frequency_are_told_from_centimetres_by_the_trackers_errors(
    image, needle, marker, rms
):
    assert not scan_hints(
        image_mm=image, needle_mm=needle, marker_mm=marker, scale=image / 500, rms_mm=rms, dimension=2
    )


def test_an_area_that_no_scanner_shows_is_doubted():
    assert scan_hints(image_mm=450.0, needle_mm=200.0, marker_mm=200.0, scale=0.9, rms_mm=0.5, dimension=2)


def refusal_of(rows):
    with pytest.raises((sc.DegenerateGeometryError, sc.NoConsensusError)) as refused:
        sc.calibrate(rows)
    assert [one.code for one in refused.value.diagnostics][:1] == [CODE]
    assert "--accept-units" not in str(refused.value)  # nothing is there to go on with
    return str(refused.value)


@pytest.mark.parametrize(("dimension", "axis"), [(2, 0), (2, 1), (3, 2)])
def test_one_axis_in_shares_of_the_image_leads_the_refusal(dimension, axis):
    for seed in range(3):
        rows = scan(seed, dimension=dimension, outliers=0).observations
        points = rows.points_px.copy()
        points[:, axis] /= 1.02 * np.abs(points[:, axis]).max()
        said = refusal_of(dataclasses.replace(rows, points_px=points))
        assert said.startswith(f"is {'uvw'[axis]} in pixels?")
        assert f"multiply {'uvw'[axis]} by the image's" in said


@pytest.mark.parametrize("noise", [0.0, 1.0])
@pytest.mark.parametrize("end", [0, 1])
def test_one_end_in_metres_leads_the_refusal(end, noise):
    for seed in range(3):
        rows = simulate_observations(2, 40, seed=seed, sigma_px=noise, sigma_mm=noise).observations
        segments = rows.segments_mm.copy()
        segments[:, end] /= 1000
        said = refusal_of(dataclasses.replace(rows, segments_mm=segments))
        assert said.startswith("are both ends of the segments in one unit?")
        assert f"the {('first', 'second')[end]} ends are 0." in said
