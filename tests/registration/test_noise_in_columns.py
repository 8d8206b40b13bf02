"""What noisy points put into derivatives and residuals alike is known in the mean, and counts as no finding."""

import numpy as np
import pytest
from benchmarks.slow_hand import PX, SCALE, found_in, noisy_rows, slow_sweep

import sonocal as sc
from sonocal.calibration.rows import point_line_rows
from sonocal.geometry import Similarity
from sonocal.registration.bent_lines import columns_at
from sonocal.registration.image_distortion import taken_up
from sonocal.registration.mapped import MappedRows
from sonocal.registration.noise_in_columns import noise_beyond
from sonocal.registration.whitened import whitened

ACCUSED = {"bent-needle", "image-distortion", "slice-thickness"}
LEVELS, TANGENT = (PX, 0.05), 7


def beyond_and_said(truth, noisy, segments, frame):
    """Products of a bend's columns with the residuals, beyond what the transform takes up; and their mean as said."""
    mapped = MappedRows(truth, point_line_rows(sc.Observations(noisy, segments, frame=frame)))
    rows = np.arange(len(noisy))

    def at(places):
        return columns_at(mapped, rows, TANGENT, places)

    columns = np.concatenate([at(mapped.table.points), mapped.residuals[:, :, None]], axis=2)
    white = whitened(mapped, rows, columns, LEVELS).reshape(2 * len(rows), -1)
    known, bends, residuals = white[:, :TANGENT], white[:, TANGENT:-1], white[:, -1]
    taken = taken_up(known, bends)[1]
    return (bends - known @ taken).T @ residuals, noise_beyond(mapped, rows, at, taken, LEVELS)[1]


@pytest.mark.parametrize("dimension", [2, 3])
def test_it_is_the_mean_of_what_noise_makes_of_columns_and_residuals(dimension):
    (turn, shift), points, segments, frame = slow_sweep(3, "still", 100, dimension)
    truth, rng = Similarity(turn, shift, SCALE), np.random.default_rng(dimension)
    both = [
        beyond_and_said(truth, points + rng.normal(0, PX, points.shape), segments, frame) for _ in range(200)
    ]
    found, said = (np.array(one) for one in zip(*both, strict=True))
    unsure = found.std(axis=0) / np.sqrt(len(found))
    assert np.abs(found.mean(axis=0) / unsure).max() > 8.0  # which is no small matter
    np.testing.assert_array_less(np.abs(found.mean(axis=0) - said.mean(axis=0)), 4.0 * unsure)


@pytest.mark.parametrize("noise_mm", [0.02, 0.4])
def test_a_hand_that_hardly_moves_is_accused_of_nothing(noise_mm):
    scans = (noisy_rows(seed, "still", noise_mm) for seed in range(40))
    assert sum(bool(ACCUSED & found_in(rows)) for rows in scans) <= 1
