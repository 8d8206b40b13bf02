"""Two definitions of a marker by turns are found, whichever rows they are of; other errors are no two lumps."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.registration.two_motions import two_motions
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict

CODE = "two-markers"


def with_second(seed, dimension, share, degrees, mm, count=120):
    """Sightings of which a share, drawn by chance, has lines of another definition."""
    rows = simulate_observations(dimension, count, seed=seed).observations
    rng = np.random.default_rng([seed, 7])
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    middle = rows.segments_mm.mean(axis=(0, 1))
    shift = rng.normal(size=3)
    moved = (rows.segments_mm - middle) @ turn.T + middle + mm * shift / np.linalg.norm(shift)
    second = np.isin(rows.frame, np.unique(rows.frame)[rng.random(count) < share])
    return dataclasses.replace(rows, segments_mm=np.where(second[:, None, None], moved, rows.segments_mm))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("share", [0.3, 0.5])
def test_definitions_by_turns_are_found_and_stop(dimension, share):
    named = 0
    for seed in range(4):
        verdict = give_verdict(sc.calibrate(with_second(seed, dimension, share, 4.0, 5.0), threshold_mm=20.0))
        assert verdict.level != "use"
        named += CODE in verdict.codes
        assert verdict.level == "stop" or CODE not in verdict.codes
    assert named >= 3


@pytest.mark.parametrize("dimension", [2, 3])
def test_sound_scans_are_of_one_marker(dimension):
    for seed in range(20):
        found = sc.calibrate(simulate_observations(dimension, 60, seed=seed).observations)
        assert CODE not in {one.code for one in found.diagnostics}


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("noise", ["normal", "student", "along one axis"])
def test_noise_of_any_shape_is_one_lump_and_two_are_two(seed, noise):
    rng = np.random.default_rng(seed)
    motions, groups = rng.normal(size=(150, 2, 7)), np.arange(150)
    errors = {
        "normal": rng.normal(size=(150, 2)),
        "student": np.clip(rng.standard_t(3, size=(150, 2)), -4, 4),  # what is further out is left out
        "along one axis": rng.normal(size=(150, 2)) + motions[:, :, 0] * rng.normal(0, 3, (150, 1)),
    }[noise]
    rigid = motions[:, :, :6]
    assert two_motions(errors, motions, rigid, groups).gain < 25.0
    second = rng.random(150) < 0.4
    apart = errors + np.where(second[:, None], 5.0 * rigid[:, :, 1], 0.0)
    if noise == "normal":
        found = two_motions(apart, motions, rigid, groups)
        assert found.gain > 25.0
        assert max(np.mean((found.second > 0.5) == second), np.mean((found.second <= 0.5) == second)) > 0.9
