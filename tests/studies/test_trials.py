"""Laws of the batched trials: methods, errors, bounds."""

import msgspec
import numpy as np
import pytest

from sonocal.calibration import calibrate, point_line_rows
from sonocal.geometry import Similarity, similarity_errors
from sonocal.observations import Observations
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.studies import METHODS, Scene, Study
from sonocal.studies.measures import bound_errors, calibration_errors, target_place
from sonocal.studies.methods import run_method
from sonocal.studies.scene import simulate_block
from sonocal.studies.trials import run_trials

CASES = [(name, dimension) for name, method in METHODS.items() for dimension in method.fewest]


def study_of(**scene):
    return Study(name="t", title="", methods=list(METHODS), scene=Scene(**scene), factors={"needles": [8]})


def observations_of(trials, trial, dimension):
    rows = trials.points.shape[1]
    return Observations(
        points_px=trials.points[trial, :, :dimension],
        segments_mm=trials.segments[trial],
        frame=np.repeat(np.arange(rows // (dimension - 1)), dimension - 1),
    )


@pytest.mark.parametrize(("name", "dimension"), CASES)
def test_every_method_finds_the_truth_without_noise(name, dimension):
    scene = Scene(dimension=dimension, needles=8, sigma_px=0.0, sigma_mm=0.0)
    trials = simulate_block(scene, 1, 0, 0)
    before, after = run_method(name, scene, trials, threshold_mm=5.0)
    for found in (before, after):
        off = np.abs(found - trials.truth).max(axis=(1, 2))
        assert np.mean(off < 1e-6) > 0.98


@pytest.mark.parametrize(("name", "dimension"), CASES)
def test_the_fewest_needles_are_enough_and_one_less_is_refused(name, dimension):
    fewest = METHODS[name].fewest[dimension]
    scene = Scene(dimension=dimension, needles=fewest)
    assert METHODS[name].applies(scene)
    assert not METHODS[name].applies(msgspec.structs.replace(scene, needles=fewest - 1))
    _, after = run_method(name, scene, simulate_block(scene, 0, 0, 0), threshold_mm=5.0)
    assert np.isfinite(after).all(axis=(1, 2)).mean() > 0.5


@pytest.mark.parametrize(("name", "dimension"), [("4point2D", 2), ("2line3D", 2), ("2line3D", 3)])
def test_noise_does_not_leave_the_papers_minimal_solvers_without_a_start(name, dimension):
    """A twentieth of noisy samples have no real solution in 2D, and most have none in 3D: real parts serve."""
    scene = Scene(dimension=dimension, needles=5)
    before, _ = run_method(name, scene, simulate_block(scene, 0, 0, 0), threshold_mm=5.0)
    assert np.isfinite(before).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_sonocals_trials_are_what_calibrate_gives(dimension):
    scene = Scene(dimension=dimension, needles=12)
    trials = simulate_block(scene, 0, 0, 0).first(20)
    _, after = run_method("sonocal", scene, trials, threshold_mm=5.0)
    for i in range(len(trials)):
        alone = calibrate(observations_of(trials, i, dimension)).probe_from_image.matrix
        np.testing.assert_allclose(after[i], alone, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize(("name", "dimension"), [case for case in CASES if case[0] != "sonocal"])
def test_refined_answers_are_minima_of_the_papers_cost(name, dimension):
    scene = Scene(dimension=dimension, needles=12)
    trials = simulate_block(scene, 0, 0, 0).first(20)
    _, after = run_method(name, scene, trials, threshold_mm=50.0)  # all rows agree
    for i in range(len(trials)):
        rows = point_line_rows(observations_of(trials, i, dimension))
        again = refine_point_lines(
            Similarity.from_matrix(after[i]), rows, None, Options(weighting="geometric")
        )
        np.testing.assert_allclose(again.transform.matrix, after[i], rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("dimension", [2, 3])
def test_outliers_are_left_out(dimension):
    scene = Scene(dimension=dimension, needles=30, outlier_share=0.3)
    trials = simulate_block(scene, 0, 0, 0)
    for name in ("4point2D", "sonocal") if dimension == 2 else ("sonocal", "two_lines"):
        _, after = run_method(name, scene, trials, threshold_mm=5.0)
        errors = calibration_errors(scene, after, trials.truth)
        assert np.mean(errors[:, 0] < 3.0) > 0.97


def test_errors_are_those_of_the_paper():
    rng = np.random.default_rng(0)
    truth = Similarity.from_rotvec(rng.normal(size=(50, 3)), rng.normal(size=(50, 3)) * 50, 0.24)
    found = truth.retract(rng.normal(size=(50, 7)) * [0.1, 0.1, 0.1, 2, 2, 2, 0.01])
    errors = calibration_errors(Scene(), found.matrix, truth.matrix)
    angle, distance, scale = similarity_errors(found, truth)
    np.testing.assert_allclose(errors[:, 0], np.degrees(angle), rtol=1e-9)
    np.testing.assert_allclose(errors[:, 1], distance, rtol=1e-9)
    np.testing.assert_allclose(errors[:, 2], scale, atol=1e-12)
    place = target_place(Scene())
    expected = np.linalg.norm(found.apply(place[None]) - truth.apply(place[None]), axis=-1).reshape(-1)
    np.testing.assert_allclose(errors[:, 3], expected, rtol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_bound_is_attained_with_small_noise_and_many_needles(dimension):
    """An independent oracle: the spread of maximum-likelihood answers, which is asymptotically the bound's."""
    scene = Scene(dimension=dimension, needles=40, sigma_px=0.2, sigma_mm=0.2)
    squares, bounds, draws = [], [], []
    for block in range(5):
        trials = simulate_block(scene, 0, 0, block)
        _, after = run_method("sonocal", scene, trials, threshold_mm=5.0)
        squares.append(calibration_errors(scene, after, trials.truth) ** 2)
        rms, drawn = bound_errors(scene, trials)
        bounds.append(rms**2)
        draws.append(drawn**2)
    measured, bound, drawn = (np.concatenate(values).mean(axis=0) for values in (squares, bounds, draws))
    np.testing.assert_allclose(np.sqrt(measured / bound), 1.0, atol=0.06)
    np.testing.assert_allclose(np.sqrt(drawn / bound), 1.0, atol=0.06)


@pytest.mark.parametrize("dimension", [2, 3])
def test_trials_do_not_depend_on_how_they_are_cut(dimension):
    cell = study_of(dimension=dimension, crosswires=2).cells()[0]
    whole = run_trials(cell, 0, 450)
    parts = [run_trials(cell, 0, 200), run_trials(cell, 200, 400), run_trials(cell, 400, 450)]
    for name, values in whole.items():
        assert values.dtype == np.float32
        np.testing.assert_array_equal(values, np.concatenate([part[name] for part in parts]))


def test_methods_of_another_dimension_are_left_out():
    assert study_of(dimension=3).cells()[0].methods == ["3line3D", "2line3D", "two_lines", "sonocal"]
    assert study_of(dimension=2).cells()[0].methods == [
        "5point2D",
        "4point2D",
        "2line3D",
        "four_points",
        "sonocal",
    ]


def test_trials_of_a_cell_do_not_change_with_other_cells_and_methods():
    alone = study_of()
    more = msgspec.structs.replace(
        alone, methods=["sonocal"], factors={"needles": [5, 8], "sigma_px": [0.5, 1.0]}
    )
    (cell,) = [c for c in more.cells() if c.levels == {"needles": 8, "sigma_px": 1.0}]
    one, other = run_trials(alone.cells()[0], 0, 100), run_trials(cell, 0, 100)
    np.testing.assert_array_equal(one["errors"][:, -1], other["errors"][:, 0])
