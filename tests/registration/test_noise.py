"""The noise model against simulated truth: what is put in comes out, and errors are as large as predicted."""

import numpy as np
import pytest

import sonocal as sc
from sonocal.registration.noise import estimate_noise, stretch_length
from sonocal.registration.options import Options
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import PointLineRows
from sonocal.registration.uncertainty import point_covariance, radius_95, weakest_motion
from sonocal.simulation.scene import simulate_observations
from tests.builders.similarities import random_similarity


def wires(seed, sigma, per_frame=9, frames=40):
    """Rows on wires over frames with independent errors and errors shared by frame and by wire, mm."""
    rng = np.random.default_rng(seed)
    truth = random_similarity(seed, scale=0.24)
    count = per_frame * frames
    frame, target = np.repeat(np.arange(frames), per_frame), np.tile(np.arange(per_frame), frames)
    points = np.column_stack([rng.uniform(0, 500, (count, 2)), np.zeros(count)])
    shared = sigma["frame"] * rng.normal(size=(frames, 3))[frame]
    shared = shared + sigma["target"] * rng.normal(size=(per_frame, 3))[target]
    middle = truth @ points + shared + sigma["row"] * rng.normal(size=(count, 3))
    along = 50 * rng.normal(size=(count, 3))
    return (
        truth,
        points,
        np.stack([middle - along, middle + along], axis=1),
        {"frame": frame, "target": target},
    )


SIGMAS = [
    {"row": 0.3, "frame": 0.0, "target": 0.0},
    {"row": 0.2, "frame": 0.4, "target": 0.0},
    {"row": 0.2, "frame": 0.3, "target": 0.5},
]


@pytest.mark.parametrize("weighting", ["likelihood", "geometric"])
@pytest.mark.parametrize("sigma", SIGMAS)
def test_variances_put_in_come_out_and_errors_are_as_predicted(sigma, weighting):
    squares = {name: [] for name in sigma}
    normalised = []
    for seed in range(60):
        truth, points, segments, groups = wires(seed, sigma)
        rows = PointLineRows(points, segments, 2)
        noise = estimate_noise(rows, fit := fit_point_lines(rows, Options(weighting=weighting)), groups)
        squares["row"].append(noise.row_mm**2)
        for name in ("frame", "target"):
            squares[name].append(noise.shared_mm.get(name, 0.0) ** 2)
        missed = fit.transform @ [[250.0, 250, 0]] - truth @ [[250.0, 250, 0]]
        predicted = point_covariance(fit.transform, noise.covariance, [[250.0, 250]])
        normalised.append(np.sum(missed**2) / np.trace(predicted[0]))
    for name, value in sigma.items():
        assert np.sqrt(np.mean(squares[name])) == pytest.approx(value, abs=0.03)
    assert 0.6 < np.mean(normalised) < 1.6


def test_a_simulated_sweep_is_off_by_what_is_predicted():
    ratio = []
    for seed in range(150):
        scene = simulate_observations(2, 20, sigma_px=2, sigma_mm=0.05, seed=seed)
        found = sc.calibrate(scene.observations)
        places, rms, _ = found.predicted_errors()
        missed = found.probe_from_image @ places - scene.probe_from_image @ places
        ratio.append(np.sum(missed**2, axis=1) / rms**2)
    assert 0.8 < np.mean(ratio) < 1.25


def test_shares_that_cannot_be_told_apart_are_absent():
    _, points, segments, _ = wires(0, SIGMAS[0])
    each = np.arange(len(points))
    rows = PointLineRows(points, segments, 2)
    noise = estimate_noise(rows, fit_point_lines(rows, Options()), {"frame": each, "target": 0 * each})
    assert noise.shared_mm == {}


def test_stretch_length_is_one_for_independent_frames_and_long_for_a_drift():
    rng = np.random.default_rng(0)
    frame = np.repeat(np.arange(100), 3)
    assert stretch_length(rng.normal(size=(300, 3)), frame) == 1
    drift = np.sin(np.arange(100) / 8)[:, None] * [1.0, 0.5, 0.2]
    assert stretch_length(drift[frame] + 0.01 * rng.normal(size=(300, 3)), frame) > 8


def test_radius_95_holds_95_percent():
    rng = np.random.default_rng(0)
    for eigenvalues in ([1, 1, 1], [1, 0, 0], [4, 1, 0.1]):
        samples = rng.normal(size=(100_000, 3)) * np.sqrt(eigenvalues)
        inside = np.linalg.norm(samples, axis=1) < radius_95(np.diag(eigenvalues).astype(float))
        assert inside.mean() == pytest.approx(0.95, abs=0.006)
    assert radius_95(np.zeros((3, 3))) == 0


def test_weakest_motion_names_the_motion_that_was_made_weak():
    a = random_similarity(0, scale=0.24)
    corners = [[0.0, 0], [500, 0], [0, 500], [500, 500]]
    centre = a @ [[250.0, 250]]
    axis = a.rotation[:, 0]
    turn = np.r_[0.02 * axis, -np.cross(0.02 * axis, centre[0] - a.translation), 0]
    motion = weakest_motion(a, np.outer(turn, turn) + 1e-8 * np.eye(7), corners)
    np.testing.assert_allclose(np.abs(motion.turn_rad), [0.02, 0, 0], atol=1e-4)
    assert motion.turn_rms_mm == pytest.approx(0.02 * 250 * 0.24, rel=1e-2)
    assert motion.shift_rms_mm < 0.01
    assert motion.share > 0.99
    growth = np.r_[0, 0, 0, -0.05 * (centre[0] - a.translation), 0.05]
    motion = weakest_motion(a, np.outer(growth, growth), corners)
    assert motion.growth_rms_mm == pytest.approx(0.05 * 250 * 0.24 * np.sqrt(2), rel=1e-6)
    assert motion.rms_mm == pytest.approx(motion.growth_rms_mm, rel=1e-6)


def test_few_residuals_to_spare_make_the_radius_larger():
    assert radius_95(np.eye(3), 5) > radius_95(np.eye(3), 50) > radius_95(np.eye(3))
    rng = np.random.default_rng(0)
    samples = rng.normal(size=(200_000, 3)) / np.sqrt(rng.chisquare(6, (200_000, 1)) / 6)
    inside = np.linalg.norm(samples, axis=1) < radius_95(np.eye(3), 6)
    assert inside.mean() == pytest.approx(0.95, abs=0.003)
