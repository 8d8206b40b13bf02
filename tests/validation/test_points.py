"""Cross-wires and phantoms: known truth comes back, and tables that do not fit are refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.validation import (
    PointSightings,
    fit_crosswire,
    fixed_point_spread,
    parse_point_sightings,
    reconstruction_accuracy,
    validate_points,
)
from tests.builders.similarities import random_similarity


def poses_of(seed, count):
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=rng).as_matrix()
    poses[:, :3, 3] = rng.uniform(-200, 200, (count, 3))
    return poses


def crosswire(seed, count=20, noise_mm=0.0):
    """Pixels, poses and the place of one fixed point, and the calibration behind them."""
    rng, truth = np.random.default_rng(seed), random_similarity(seed, scale=0.24)
    pixels, poses, place = rng.uniform(0, 500, (count, 2)), poses_of(seed, count), rng.uniform(-300, 300, 3)
    rotated = np.einsum("nij,nj->ni", poses[:, :3, :3], truth @ pixels)
    poses[:, :3, 3] = place - rotated + noise_mm * rng.normal(size=(count, 3))
    return truth, PointSightings(
        pixels, points_mm=np.tile(place, (count, 1)), tracker_from_probe=poses, source="wire.csv"
    )


@given(st.integers(0, 1000))
def test_without_noise_all_errors_are_zero_and_the_calibration_comes_back(seed):
    truth, sightings = crosswire(seed)
    assert reconstruction_accuracy(truth, sightings).value_mm < 1e-9
    assert fixed_point_spread(truth, sightings).value_mm < 1e-9
    found = fit_crosswire(sightings)
    np.testing.assert_allclose(found.probe_from_image.matrix, truth.matrix, atol=1e-6)
    np.testing.assert_allclose(found.point_mm, sightings.points_mm[0], atol=1e-6)


def test_a_shifted_calibration_is_off_by_the_shift_and_a_fixed_point_spreads_by_it():
    truth, sightings = crosswire(1, count=400)
    shifted = sc.Similarity(truth.rotation, truth.translation + np.array([3.0, 0, 4.0]), truth.scale)
    assert reconstruction_accuracy(shifted, sightings).value_mm == pytest.approx(5.0)
    # Random poses turn the shift every way: its mean vanishes and its length is the spread.
    assert fixed_point_spread(shifted, sightings).value_mm == pytest.approx(5.0, rel=0.02)


def test_a_probe_that_does_not_turn_tells_nothing_at_a_fixed_point_but_at_the_tip():
    truth, sightings = crosswire(1)
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, :3, 3] = -(truth @ sightings.points_px)
    sightings = PointSightings(sightings.points_px, np.zeros((20, 3)), poses)
    shifted = sc.Similarity(truth.rotation, truth.translation + np.array([3.0, 0, 4.0]), truth.scale)
    with pytest.raises(sc.InputError, match=r"the probe turned by 0\.0 deg between sightings"):
        fixed_point_spread(shifted, sightings)
    assert reconstruction_accuracy(shifted, sightings).value_mm == pytest.approx(5.0)


def test_the_spread_is_that_of_the_noise():
    truth, sightings = crosswire(2, count=3000, noise_mm=0.5)
    assert fixed_point_spread(truth, sightings).value_mm == pytest.approx(0.5 * np.sqrt(3), rel=0.03)


def test_moving_the_tracker_changes_no_number():
    truth, sightings = crosswire(3, noise_mm=0.5)
    move = random_similarity(9, scale=1.0)
    moved = PointSightings(
        sightings.points_px, move @ sightings.points_mm, move.matrix @ sightings.tracker_from_probe
    )
    for number in (reconstruction_accuracy, fixed_point_spread):
        assert number(truth, moved).value_mm == pytest.approx(number(truth, sightings).value_mm)


def test_the_real_cross_wire_has_the_residual_of_a_linear_fit(data_folder):
    poses = np.loadtxt(data_folder / "pivot" / "crosswire_probe_poses.txt").reshape(-1, 3, 4)
    bottom = np.tile([[[0.0, 0, 0, 1]]], (len(poses), 1, 1))
    pixels = np.loadtxt(data_folder / "pivot" / "crosswire_points_px.txt")
    sightings = PointSightings(pixels, tracker_from_probe=np.concatenate([poses, bottom], axis=1))
    found = fit_crosswire(sightings)
    assert found.linear_rms_mm == pytest.approx(0.98, abs=0.005)
    spread = fixed_point_spread(found.probe_from_image, sightings)
    assert found.linear_rms_mm < spread.value_mm < 1.2
    assert spread.low_mm < spread.value_mm < spread.high_mm
    assert spread.units == 54


def test_poses_that_leave_the_cross_wire_free_are_refused():
    pixels = np.random.default_rng(0).uniform(0, 500, (20, 2))
    still = np.tile(np.eye(4), (20, 1, 1))
    with pytest.raises(sc.DegenerateGeometryError, match="turn the probe about two axes"):
        fit_crosswire(PointSightings(pixels, tracker_from_probe=still))


# Tables

POSE_HEADER = ",".join(f"probe_{row}{column}" for row in range(3) for column in range(4))
IDENTITY = "1,0,0,10,0,1,0,20,0,0,1,30"


def test_a_table_with_places_in_the_tracker_is_carried_into_the_probe():
    table = f"frame,target,u_px,v_px,x_mm,y_mm,z_mm,{POSE_HEADER}\n4,wire,1,2,11,22,33,{IDENTITY}\n"
    found = parse_point_sightings(table.encode(), "wire.csv")
    np.testing.assert_allclose(found.points_probe_mm, [[1, 2, 3]])
    assert (found.frame.tolist(), found.target.tolist()) == ([4], ["wire"])


def test_a_table_with_places_alone_has_them_in_the_probe():
    found = parse_point_sightings(b"u_px,v_px,x_mm,y_mm,z_mm\n1,2,3,4,5\n", "wire.csv")
    np.testing.assert_array_equal(found.points_probe_mm, [[3, 4, 5]])
    with pytest.raises(
        sc.InputError, match=r"wire\.csv: has no poses of the probe; add probe_00 \.\.\. probe_23"
    ):
        _ = found.poses


REFUSALS = [
    ("u_px,v_px\n1,2\n", "wire.csv: says neither where the points are"),
    ("u_px,v_px,x_mm\n1,2,3\n", "wire.csv, line 1: lacks the columns y_mm, z_mm"),
    ("u_px,v_px,x_mm,y_mm,z_mm\n1,2,3,4,far\n", "wire.csv, line 2, column z_mm: 'far' is not a number"),
    ("u_px,v_px,x_mm,y_mm,z_mm\n1,nan,3,4,5\n", "wire.csv, row 0: points_px is not finite"),
    ("u_px,v_px,x_mm,y_mm,z_mm\n1,2,3,4,1e200\n", "wire.csv, row 0: points_mm is further than 1e+09 away"),
    (
        "frame,u_px,v_px,x_mm,y_mm,z_mm\n1.5,2,3,4,5,6\n",
        "wire.csv, column frame: some of it are no whole numbers",
    ),
    ("u_px\n1\n", "wire.csv: needs a header with u_px, v_px"),
    (
        f"u_px,v_px,{POSE_HEADER}\n1,2,{IDENTITY.replace('1,0,0,10', '2,0,0,10')}\n",
        "wire.csv, row 0: the pose is not rigid",
    ),
]


@pytest.mark.parametrize(("table", "sentence"), REFUSALS)
def test_tables_that_do_not_fit_are_refused(table, sentence):
    with pytest.raises(sc.InputError) as caught:
        parse_point_sightings(table.encode(), "wire.csv")
    assert str(caught.value).startswith(sentence)


def test_a_phantom_and_a_cross_wire_have_their_own_names():
    from sonocal.simulation.scene import simulate_observations

    calibration = sc.calibrate(simulate_observations(2, 20, seed=1).observations)
    _, sightings = crosswire(1)
    assert [q.code for q in validate_points(calibration, sightings).quantities] == [
        "pra-crosswire",
        "crosswire-spread",
    ]
    phantom = PointSightings(sightings.points_px, sightings.points_mm, target=np.array(["a", "b"] * 10))
    assert [q.code for q in validate_points(calibration, phantom).quantities] == ["pra-phantom"]
