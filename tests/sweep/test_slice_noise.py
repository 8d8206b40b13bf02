"""Wires nearly along the image take no part where others hold it, and a thick slice's noise is in the covariance."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration.options import Options
from sonocal.geometry import Similarity
from sonocal.observations import Observations
from sonocal.sweep.candidates import Candidates
from sonocal.sweep.slice_noise import LEAST_MET_DEG, calibrated_across, with_slice_noise

SCALE, COUNT = 0.3, 120
TRUTH = Similarity(Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix(), np.array([20.0, -50.0, 10.0]), SCALE)


def wires(seed, met_deg, off_px=0.0, px=0.5):
    """Sightings of four wires, each of which meets the image at an angle (COUNT,), deg."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(0, 300, (COUNT, 2)), np.zeros(COUNT)])
    lean, about = 1 / np.tan(np.radians(met_deg)), rng.uniform(0, 2 * np.pi, COUNT)
    leans = lean[:, None] * np.column_stack([np.cos(about), np.sin(about)])
    ways = np.column_stack([leans, np.ones(COUNT)]) / np.hypot(lean, 1)[:, None]
    ends = TRUTH.apply((points[:, None] + np.array([[-250.0], [250.0]]) * ways[:, None]).reshape(-1, 3))
    seen = points[:, :2] + px * rng.normal(size=(COUNT, 2)) + off_px * rng.normal(size=(COUNT, 1)) * leans
    return Observations(
        seen,
        ends.reshape(-1, 2, 3) + 0.05 * rng.normal(size=(COUNT, 2, 3)),
        frame=np.arange(COUNT) // 4,
        target=np.array([f"wire {i % 4}" for i in range(COUNT)]),
        image_size_px=(300, 300),
    )


def angles(low, high, share, seed=0):
    """(COUNT,), deg: a share nearly along the image, the others steeper."""
    rng = np.random.default_rng(seed)
    return np.where(rng.random(COUNT) < share, rng.uniform(5, 20, COUNT), rng.uniform(low, high, COUNT))


def across(rows):
    """What is fitted of rows that all agree."""
    table = Candidates(rows, Options.of(), 5.0)
    return calibrated_across(table, np.ones(COUNT, dtype=bool), TRUTH, sc.calibrate)


def test_wires_nearly_along_the_image_are_left_out():
    met = angles(35, 90, 0.2)
    found, fitted = across(wires(0, met, off_px=2.0))
    np.testing.assert_array_equal(fitted, met > LEAST_MET_DEG)
    assert found.fit.observations == np.count_nonzero(fitted)


def test_where_most_wires_are_so_all_are_kept():
    assert across(wires(0, angles(35, 90, 0.7)))[1].all()


def test_those_that_alone_hold_a_motion_are_kept():
    assert across(wires(0, angles(89.99, 90, 0.2)))[1].all()  # parallel ones let the image slide along them


def test_one_needle_keeps_them():
    rows = wires(0, angles(35, 90, 0.2)).with_sound(target=np.full(COUNT, "needle"))
    assert across(rows)[1].all()


def test_errors_of_a_thick_slice_are_within_what_is_said_as_often_as_it_says():
    places, within, before = np.array([[0.0, 0, 0], [300, 0, 0], [0, 300, 0], [300, 300, 0]]), [], []
    for seed in range(60):
        rows = wires(seed, angles(35, 90, 0.0, seed), off_px=4.0)
        found = sc.calibrate(rows)
        off = np.linalg.norm(found.probe_from_image @ places - TRUTH @ places, axis=1)
        wider = with_slice_noise(found, rows)
        order = np.lexsort(places[:, :2].T)
        for one, into in ((found, before), (wider, within)):
            corners, _, predicted = one.predicted_errors()
            there = [
                int(np.argmin(np.linalg.norm(corners[:, :2] - place, axis=1))) for place in places[:, :2]
            ]
            into.extend(off[order] <= predicted[there][order])
    assert np.mean(before) < np.mean(within)
    assert 0.9 <= np.mean(within) <= 0.985


def test_where_the_slice_is_thin_hardly_any_is_wider():
    wider = 0
    for seed in range(40):
        rows = wires(seed, angles(35, 90, 0.0, seed))
        found = sc.calibrate(rows)
        wider += with_slice_noise(found, rows) is not found
    assert wider <= 5


@pytest.mark.parametrize("weighting", ["geometric", "likelihood"])
def test_the_answer_stays(weighting):
    rows = wires(1, angles(35, 90, 0.0), off_px=4.0)
    found = sc.calibrate(rows, weighting=weighting)
    wider = with_slice_noise(found, rows)
    assert wider.probe_from_image is found.probe_from_image
    assert wider.predicted_errors()[2].max() > found.predicted_errors()[2].max()
