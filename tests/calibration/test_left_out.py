"""Rows that were left out and agree among themselves make an answer a coin's toss; gross errors do not."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.simulation.scene import simulate_observations
from sonocal.validation import give_verdict

CODE = "left-out-rows-agree"


def with_moved(seed, dimension, count, chosen, degrees=70.0, mm=25.0):
    """Sightings of which the lines of some are given by another definition of the marker."""
    rows = simulate_observations(dimension, count, seed=seed).observations
    turn = Rotation.from_rotvec(np.radians(degrees) * np.array([0.6, 0.8, 0.0]))
    moved = rows.segments_mm @ turn.as_matrix().T + np.array([mm, 0.0, 0.0])
    which = chosen(rows.frame)[:, None, None]
    return dataclasses.replace(rows, segments_mm=np.where(which, moved, rows.segments_mm))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("every", [2, 3])
def test_two_definitions_by_turns_stop(dimension, every):
    found = sc.calibrate(with_moved(3, dimension, 120, lambda frame: frame % every == 0))
    verdict = give_verdict(found)
    assert verdict.level == "stop"
    assert CODE in verdict.codes
    left = int(np.count_nonzero(~found.inlier))
    (said,) = (one.message for one in found.diagnostics if one.code == CODE)
    assert f"of the {left} rows left out agree" in said


@pytest.mark.parametrize("seed", range(4))
def test_gross_errors_and_a_few_rows_of_another_definition_do_not(seed):
    rows = simulate_observations(2, 100, seed=seed).observations
    rng = np.random.default_rng(seed)
    points = rows.points_px.copy()
    points[:40] = rng.uniform(0, 499, (40, 2))
    few = with_moved(seed, 2, 100, lambda frame: frame % 5 == 0)
    for table in (rows, dataclasses.replace(rows, points_px=points), few):
        assert CODE not in {one.code for one in sc.calibrate(table).diagnostics}
