"""Whitened residuals have unit variance under their noise, and rows of a sighting share none."""

import numpy as np
import pytest
from benchmarks.comparison import needle_scan
from scipy.spatial.transform import Rotation

from sonocal.calibration.rows import point_line_rows
from sonocal.geometry import Similarity
from sonocal.registration.mapped import MappedRows
from sonocal.registration.whitened import across_lines, whitened

SCALE = 0.24


@pytest.mark.parametrize("dimension", [2, 3])
def test_whitened_residuals_of_the_truth_are_of_unit_variance(dimension):
    truth = (Rotation.random(random_state=1).as_matrix(), np.array([10.0, -20.0, 30.0]))
    rows = point_line_rows(needle_scan(np.random.default_rng(dimension), truth, dimension, 3000))
    mapped = MappedRows(Similarity(truth[0], truth[1], SCALE), rows)
    every = np.arange(len(rows))
    white = whitened(mapped, every, mapped.residuals[:, :, None], (1.0, 1.0))[..., 0]
    # The simulated mm noise is 1 mm on both ends.
    seen = white.reshape(-1, 2 * (dimension - 1))
    np.testing.assert_allclose(seen.T @ seen / len(seen), np.eye(seen.shape[1]), atol=0.1)


def test_rows_far_out_count_less():
    truth = (np.eye(3), np.zeros(3))
    rows = point_line_rows(needle_scan(np.random.default_rng(0), truth, 2, 50))
    moved = MappedRows(Similarity(np.eye(3), np.array([0.0, 200.0, 0.0]), SCALE), rows)
    columns = moved.residuals[:, :, None]
    far, near = (whitened(moved, np.arange(50), scale * columns, (1.0, 1.0)) for scale in (2.0, 1.0))
    assert np.abs(far).max() < 2.0 * np.abs(near).max()


def test_axes_across_are_at_right_angles():
    directions = np.random.default_rng(2).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    both = np.concatenate([across_lines(directions), directions[:, None]], axis=1)
    np.testing.assert_allclose(
        both @ np.swapaxes(both, 1, 2), np.broadcast_to(np.eye(3), (50, 3, 3)), atol=1e-12
    )
