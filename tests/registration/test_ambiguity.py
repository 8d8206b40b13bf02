"""Nearly parallel needles leave an image and its mirror; whoever took one of them must not be sure of it."""

import numpy as np
import pytest

import sonocal as sc
from sonocal.calibration import point_line_rows
from sonocal.registration.ambiguity import better_of_mirrored, mirrored_answer
from sonocal.registration.options import Options
from sonocal.registration.robust import fit_point_lines
from tests.builders.similarities import random_similarity

TRUTH = random_similarity(11, scale=0.24)


def nearly_parallel(spread: float, seed: int, noise: float = 0.3) -> sc.Observations:
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(0, 500, (30, 2)), np.zeros(30)])
    directions = [0.2, 0.1, 1.0] + spread * rng.normal(size=(30, 3))
    along = 100 * directions / np.linalg.norm(directions, axis=1, keepdims=True) @ TRUTH.rotation.T
    middle = TRUTH @ points
    segments = np.stack([middle - along, middle + along], axis=1) + noise * rng.normal(size=(30, 2, 3))
    return sc.Observations((points + noise * rng.normal(size=points.shape))[:, :2], segments)


@pytest.mark.parametrize("spread", [0.01, 0.02])
def test_an_answer_of_nearly_parallel_needles_is_not_off_by_more_than_it_may_be(spread):
    warned = 0
    for seed in range(12):
        found = sc.calibrate(nearly_parallel(spread, seed), image_size_px=(500, 500))
        places, predicted, _ = found.predicted_errors()
        off = np.linalg.norm(found.probe_from_image @ places - TRUTH @ places, axis=1)
        assert np.all(off < 5 * predicted)
        warned += "two-answers" in {d.code for d in found.warnings}
    assert warned >= 1 or spread > 0.01


def test_the_better_of_the_two_comes_first():
    for seed in range(8):
        rows = point_line_rows(nearly_parallel(0.01, seed))
        fit = fit_point_lines(rows, Options())
        best, other = better_of_mirrored(rows, fit)
        assert other is not None
        squares = [np.sum(np.minimum(f.residuals_mm, fit.threshold_mm) ** 2) for f in (best, other)]
        assert squares[0] <= squares[1]


def test_needles_in_all_directions_have_no_second_answer():
    found = sc.calibrate(nearly_parallel(2.0, 0), image_size_px=(500, 500))
    assert not found.warnings
    rows = point_line_rows(nearly_parallel(2.0, 0))
    assert mirrored_answer(rows, fit_point_lines(rows, Options())) is None


def test_the_near_parallel_wires_of_a_stepper_leave_two_answers(data_folder):
    observations = sc.read_observations(data_folder / "observations" / "trus_3nwires.csv")
    found = sc.calibrate(observations, fit_split="calibration")
    assert found.warnings[0].code == "two-answers"
    assert found.predicted_errors()[1].max() > 5
