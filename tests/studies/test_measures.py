"""Errors, bounds and summaries of a study, against NumPy and against what must hold of them."""

from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal.geometry import Similarity
from sonocal.studies import Scene, Study
from sonocal.studies.definition import Answer
from sonocal.studies.measures import ERRORS, bound_errors, calibration_errors, target_place, wire_errors
from sonocal.studies.methods import METHODS, run_method
from sonocal.studies.scene import simulate_block
from sonocal.studies.summary import Row, _quantile, answer_sentences, summarise, summary_csv, summary_json
from tests.builders.similarities import random_batch, random_similarity

seeds = st.integers(0, 10_000)
replaced = msgspec.structs.replace


def drawn_block(seed=0, **scene):
    made = Scene(**{"needles": 12} | scene)
    return made, simulate_block(made, seed, 0, 0)


@given(seeds)
def test_a_calibration_is_off_by_nothing_from_itself_and_by_as_much_as_back(seed):
    a, b = (random_batch([seed, k], (5,)).matrix for k in range(2))
    np.testing.assert_allclose(calibration_errors(Scene(), a, a), 0, atol=1e-9)
    np.testing.assert_allclose(
        calibration_errors(Scene(), a, b), calibration_errors(Scene(), b, a), rtol=1e-9
    )


@given(seeds)
def test_moving_the_marker_moves_no_error(seed):
    a, b = (random_batch([seed, k], (5,)).matrix for k in range(2))
    mover = random_similarity(seed, scale=1.0).matrix
    np.testing.assert_allclose(
        calibration_errors(Scene(), mover @ a, mover @ b), calibration_errors(Scene(), a, b), rtol=1e-7
    )


@given(seeds, st.floats(1.0, 150.0), st.sampled_from([2, 3]))
def test_the_error_at_the_target_is_how_far_its_image_moves(seed, depth, dimension):
    scene = Scene(dimension=dimension, depth_mm=depth)
    a, b = random_similarity(seed), random_similarity(seed + 1)
    place = target_place(scene)
    assert place[1] * scene.scale_mm_per_px == pytest.approx(depth)
    errors = calibration_errors(scene, a.matrix, b.matrix)
    assert errors[ERRORS.index("target_mm")] == pytest.approx(np.linalg.norm((a @ place) - (b @ place)))


@given(seeds, st.floats(1e-6, 3.1), st.floats(0, 50))
def test_a_turn_and_a_shift_are_measured_as_such(seed, angle, shift):
    truth, axis = random_similarity(seed), random_similarity(seed + 1).rotation[0]
    found = truth.retract(np.r_[angle * axis, shift * axis, 0])
    rotation, translation, scale, _ = calibration_errors(Scene(), found.matrix, truth.matrix)
    np.testing.assert_allclose([np.radians(rotation), translation], [angle, shift], rtol=1e-6, atol=1e-9)
    assert scale == pytest.approx(0, abs=1e-12)


@given(seeds)
def test_a_failed_trial_is_no_number_and_spoils_no_other(seed):
    a, b = (random_batch([seed, k], (4,)).matrix for k in range(2))
    holed = a.copy()
    holed[2] = np.nan
    found, whole = (calibration_errors(Scene(), x, b) for x in (holed, a))
    assert np.isnan(found[2]).all()
    np.testing.assert_array_equal(np.delete(found, 2, 0), np.delete(whole, 2, 0))


def test_wires_are_off_by_the_distance_from_where_the_tip_touched_them():
    _, trials = drawn_block(crosswires=3)
    errors = wire_errors(trials.truth, trials)
    for t in (0, 7, 199):
        truth = Similarity.from_matrix(trials.truth[t])
        expected = np.linalg.norm((truth @ trials.wire_points[t]) - trials.wire_places[t], axis=1)
        np.testing.assert_allclose(errors[t], expected, rtol=1e-9)
    several = wire_errors(np.stack([trials.truth] * 2, axis=1), trials)
    np.testing.assert_array_equal(several[:, 0], several[:, 1])


@pytest.mark.parametrize("dimension", [2, 3])
def test_no_method_is_better_on_average_than_the_bound(dimension):
    scene, trials = drawn_block(dimension=dimension)
    bound = np.sqrt(np.mean(bound_errors(scene, trials)[0] ** 2, axis=0))
    for name, method in METHODS.items():
        if not method.applies(scene):
            continue
        _, after = run_method(name, scene, trials, threshold_mm=5.0)
        errors = calibration_errors(scene, after, trials.truth)
        # Of 200 trials the root mean square scatters by a twentieth.
        assert np.all(np.sqrt(np.nanmean(errors**2, axis=0)) > 0.85 * bound), name


@pytest.mark.parametrize("dimension", [2, 3])
def test_half_the_noise_is_half_the_bound_and_more_needles_lower_it(dimension):
    scene, trials = drawn_block(dimension=dimension)
    bound = bound_errors(scene, trials)[0]
    halved = bound_errors(replaced(scene, sigma_px=0.5, sigma_mm=0.5), trials)[0]
    np.testing.assert_allclose(halved, bound / 2, rtol=1e-6)
    more = drawn_block(dimension=dimension, needles=24)
    assert np.all(np.median(bound_errors(*more)[0], axis=0) < np.median(bound, axis=0))


@pytest.mark.parametrize("dimension", [2, 3])
def test_draws_from_the_bound_have_its_size(dimension):
    scene, trials = drawn_block(dimension=dimension)
    rms, draws = bound_errors(scene, trials)
    np.testing.assert_allclose(np.sqrt(np.mean(draws**2, 0) / np.mean(rms**2, 0)), 1, atol=0.25)


@pytest.mark.parametrize(
    "noise", [{"latency_ms": 20.0}, {"probe_sigma_mm": 0.1}, {"sigma_px": 0.0, "sigma_mm": 0.0}]
)
def test_there_is_no_bound_where_the_noise_is_not_that_of_points_and_ends(noise):
    for values in bound_errors(*drawn_block(**noise)):
        assert np.isnan(values).all()


@given(st.lists(st.floats(0, 1e3), min_size=1, max_size=300), st.sampled_from([0.25, 0.5, 0.95]))
def test_quantiles_are_numpys_and_lie_within_their_intervals(values, share):
    ordered = np.sort(np.array(values))
    middle, low, high = _quantile(ordered, share)
    assert middle == pytest.approx(np.quantile(ordered, share), rel=1e-9, abs=1e-9)
    assert low <= middle <= high
    assert {low, high} <= {*ordered.tolist(), 0.0, np.inf}  # where too few say nothing


@settings(max_examples=5)
@given(st.sampled_from([0.5, 0.95]), st.integers(0, 100))
def test_nineteen_of_twenty_intervals_hold_the_true_quantile(share, seed):
    samples = np.sort(np.random.default_rng(seed).exponential(size=(400, 150)), axis=1)
    true = -np.log(1 - share)
    held = [low <= true <= high for _, low, high in (_quantile(row, share) for row in samples)]
    assert 0.91 < np.mean(held) <= 0.995


class FakeStore:
    """Results that were never computed, as a store gives them."""

    def __init__(self, study, results):
        self.study, self.results, self.digest = study, results, "none"

    def read(self, index, name, method=None):
        values = self.results[index][name]
        return values if method is None else values[:, method]


def study_of(levels=(5, 8), methods=("sonocal",), **changes):
    return Study(
        **{"name": "t", "title": "", "methods": list(methods), "factors": {"needles": list(levels)}} | changes
    )


def fake_results(seed, trials, methods, failed=0.0):
    rng = np.random.default_rng(seed)
    errors = rng.exponential(size=(trials, methods, 2, 4)).astype(np.float32)
    errors[rng.random((trials, methods)) < failed] = np.nan
    bound = rng.exponential(size=(trials, 4)).astype(np.float32)
    return {
        "errors": errors,
        "wire_errors": np.empty((trials, methods, 2, 0), np.float32),
        "bound": bound,
        "bound_draws": bound * 2,
    }


def rows_by_key(rows):
    return {(*row.levels.values(), row.method, row.stage, row.quantity): row for row in rows}


@given(seeds, st.integers(1, 120))
def test_a_summary_is_numpys_statistics_of_every_cell_method_stage_and_quantity(seed, trials):
    study = study_of(methods=("4point2D", "sonocal"))
    results = [fake_results([seed, k], trials, 2) for k in range(2)]
    rows = rows_by_key(summarise(FakeStore(study, results)))
    assert len(rows) == 2 * (2 * 2 * 4 + 4)
    for (needles, method, stage, quantity), row in rows.items():
        own, q = results[[5, 8].index(needles)], ERRORS.index(quantity)
        if method == "bound":
            values, rms = own["bound_draws"][:, q], own["bound"][:, q].astype(float)
        else:
            values = own["errors"][:, study.methods.index(method), ("before", "after").index(stage), q]
            rms = values.astype(float)
        expected = np.quantile(values.astype(float), [0.25, 0.5, 0.75, 0.95])
        np.testing.assert_allclose([row.q1, row.median, row.q3, row.p95], expected, rtol=1e-6)
        assert row.rms == pytest.approx(np.sqrt(np.mean(rms**2)))
        assert (row.trials, row.failed) == (trials, 0)


@given(seeds, st.floats(0.0, 1.0))
def test_trials_without_an_answer_count_as_errors_without_end(seed, failed):
    study, results = study_of(levels=[8]), fake_results(seed, 60, 1, failed)
    row = rows_by_key(summarise(FakeStore(study, [results])))[8, "sonocal", "after", "target_mm"]
    values = results["errors"][:, 0, 1, 3]
    assert row.failed == np.isnan(values).sum()
    assert row.trials + row.failed == 60
    assert row.median_low <= row.median <= row.median_high
    worse = np.sort(np.where(np.isnan(values), np.inf, values).astype(float))
    assert worse[29] <= row.median <= worse[30]
    assert np.isinf(row.p95_high)  # of 60 none need be beyond the 95 % of all


@pytest.mark.parametrize("count", [3, 20, 100, 400])
@pytest.mark.parametrize("share", [0.5, 0.95])
def test_a_quantile_is_in_its_interval_in_95_percent_of_studies_of_any_size(count, share):
    draws = np.sort(np.random.default_rng(count).uniform(size=(2000, count)), axis=1)
    bounds = np.array([_quantile(one, share)[1:] for one in draws])
    assert np.mean((bounds[:, 0] <= share) & (share <= bounds[:, 1])) >= 0.95 - 3 * np.sqrt(
        0.05 * 0.95 / 2000
    )


@given(seeds)
def test_the_order_of_trials_says_nothing(seed):
    study, results = study_of(levels=[8]), fake_results(seed, 50, 1, 0.1)
    order = np.random.default_rng(seed).permutation(50)
    shuffled = {name: values[order] for name, values in results.items()}
    one, other = (summarise(FakeStore(study, [r])) for r in (results, shuffled))
    for a, b in zip(one, other, strict=True):
        assert replaced(a, rms=0.0) == replaced(b, rms=0.0)
        assert a.rms == pytest.approx(b.rms)


def row_at(needles, p95):
    numbers = dict.fromkeys(Row.__struct_fields__, 0.0) | {"p95": p95, "levels": {"needles": needles}}
    return Row(**numbers | {"method": "sonocal", "stage": "after", "quantity": "target_mm"})


@given(st.lists(st.floats(0.1, 4.0), min_size=1, max_size=8), st.sampled_from(["least", "greatest"]))
def test_the_answer_is_the_last_level_up_to_which_all_easier_ones_reach_the_goal(errors, wanted):
    """Easier are more needles where the least is wanted, fewer (of noise, say) where the greatest is."""
    levels = list(range(5, 5 + len(errors)))
    answer = Answer(goal=2.0, wanted=wanted, reached="{x} gives {value} of {goal}", missed="no: {x}, {value}")
    (sentence,) = answer_sentences(study_of(levels, answer=answer), list(map(row_at, levels, errors)))
    from_easy = list(zip(levels, errors, strict=True))[:: -1 if wanted == "least" else 1]
    reached = None
    for level, error in from_easy:
        if error > 2.0:
            break
        reached = (level, error)
    if reached:
        assert sentence == f"{reached[0]} gives {reached[1]:.2f} of 2"
    else:
        level, error = min(zip(levels, errors, strict=True), key=lambda pair: pair[1])
        assert sentence == f"no: {level}, {error:.2f}"


def test_tables_for_people_and_programs_hold_every_row_and_no_nan():
    study, results = study_of(), [fake_results(k, 30, 1, 0.5) for k in range(2)]
    store = FakeStore(study, results)
    rows = summarise(store)
    record = msgspec.json.decode(summary_json(store, rows))
    assert len(record["rows"]) == len(rows)
    assert b"NaN" not in summary_json(store, rows)
    header, *lines = summary_csv(study, rows).decode().splitlines()
    assert header.startswith("needles,method,stage,quantity,trials,failed,median,")
    assert len(lines) == len(rows)
    assert all(line.count(",") == header.count(",") for line in lines)


@pytest.mark.parametrize("count", [1, 7, 200])
def test_the_first_trials_of_a_block_are_those_of_the_whole(count):
    _, trials = drawn_block()
    part = SimpleNamespace(**vars(trials.first(count)))
    for name, values in vars(trials).items():
        np.testing.assert_array_equal(getattr(part, name), values[:count])
