"""What must not change a fit, or must change it in the obvious way, whatever the rows."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal.geometry import Similarity, segment_directions
from sonocal.registration.ambiguity import better_of_mirrored, mirrored_answer, rival_of
from sonocal.registration.best_fit import best_fit
from sonocal.registration.fit import away_from_lines
from sonocal.registration.mapped import MappedRows
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.uncertainty import point_covariance
from tests.builders.point_lines import STEP, moved, reordered, scene_rows, tangent_step
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 3_000)
dimensions = st.sampled_from([2, 3])
weightings = st.sampled_from(["likelihood", "geometric"])
CORNERS = np.array([[0.0, 0, 0], [500, 0, 0], [0, 500, 0], [500, 500, 0]])


@given(seeds, dimensions, weightings)
def test_carrying_the_lines_carries_the_fit_and_its_covariance(seed, dimension, weighting):
    rows, _ = scene_rows(seed, dimension, outlier_share=0.2)
    mover, options = random_similarity(seed, scale=1.0), Options(weighting=weighting)
    here, there = fit_point_lines(rows, options), fit_point_lines(moved(rows, mover), options)
    np.testing.assert_allclose(there.transform.matrix, mover.matrix @ here.transform.matrix, atol=1e-5)
    np.testing.assert_array_equal(there.inlier, here.inlier)
    for place, carried in zip(
        point_covariance(here.transform, here.covariance, CORNERS),
        point_covariance(there.transform, there.covariance, CORNERS),
        strict=True,
    ):
        expected = mover.rotation @ place @ mover.rotation.T
        np.testing.assert_allclose(carried, expected, atol=1e-4 * np.trace(place))


@given(seeds, dimensions, weightings)
def test_the_order_of_rows_does_not_matter_to_a_refinement(seed, dimension, weighting):
    rows, truth = scene_rows(seed, dimension)
    order, options = np.random.default_rng(seed).permutation(len(rows)), Options(weighting=weighting)
    straight = refine_point_lines(truth, rows, None, options)
    shuffled = refine_point_lines(truth, reordered(rows, order), None, options)
    np.testing.assert_allclose(shuffled.transform.matrix, straight.transform.matrix, atol=1e-5)
    np.testing.assert_allclose(shuffled.residuals_mm, straight.residuals_mm[order], atol=1e-5)
    assert shuffled.sigma_px == pytest.approx(straight.sigma_px, rel=1e-3, abs=1e-6)


@given(seeds, dimensions, weightings, st.sampled_from([1e-3, 25.4, 1e3]))
def test_units_of_the_target_scale_lengths_and_nothing_else(seed, dimension, weighting, unit):
    rows, truth = scene_rows(seed, dimension)
    options = Options(weighting=weighting)
    here = refine_point_lines(truth, rows, None, options)
    grown = Similarity(truth.rotation, unit * truth.translation, unit * truth.scale)
    scaled = dataclasses.replace(rows, segments_mm=unit * rows.segments_mm)
    there = refine_point_lines(grown, scaled, None, options)
    np.testing.assert_allclose(there.transform.rotation, here.transform.rotation, atol=1e-6)
    np.testing.assert_allclose(there.residuals_mm, unit * here.residuals_mm, rtol=1e-3, atol=1e-6 * unit)
    assert there.sigma_mm == pytest.approx(unit * here.sigma_mm, rel=1e-3, abs=1e-6 * unit)
    assert there.sigma_px == pytest.approx(here.sigma_px, rel=1e-3, abs=1e-6)
    assert there.least_information == pytest.approx(here.least_information, rel=1e-3)


@given(seeds)
def test_rows_given_twice_are_as_rows_of_half_the_variance(seed):
    """Of a 2D probe under known noise, where every row is a sighting of its own."""
    rows, truth = scene_rows(seed, 2)
    options = Options(sigma_px=1.0, sigma_mm=1.0)
    once = refine_point_lines(truth, rows, None, options)
    twice = refine_point_lines(truth, reordered(rows, np.repeat(np.arange(len(rows)), 2)), None, options)
    np.testing.assert_allclose(twice.transform.matrix, once.transform.matrix, atol=1e-4)
    np.testing.assert_allclose(2 * twice.covariance, once.covariance, rtol=1e-2, atol=1e-12)


@given(seeds, dimensions)
def test_rows_that_are_not_chosen_might_as_well_not_be_there(seed, dimension):
    rows, truth = scene_rows(seed, dimension)
    chosen = np.ones(len(rows), dtype=bool)
    chosen[: 2 * dimension] = False
    options = Options(sigma_px=1.0, sigma_mm=1.0)
    marked = refine_point_lines(truth, rows, chosen, options)
    alone = refine_point_lines(truth, rows.select(chosen), None, options)
    np.testing.assert_allclose(marked.transform.matrix, alone.transform.matrix, atol=1e-6)
    np.testing.assert_allclose(marked.covariance, alone.covariance, rtol=1e-4, atol=1e-14)
    np.testing.assert_allclose(marked.residuals_mm[chosen], alone.residuals_mm, atol=1e-6)


@given(seeds, dimensions, st.floats(0.1, 10))
def test_known_levels_scale_the_covariance_by_their_square(seed, dimension, factor):
    rows, truth = scene_rows(seed, dimension, sigma_px=0.1, sigma_mm=0.1)
    fits = [
        refine_point_lines(truth, rows, None, Options(sigma_px=level, sigma_mm=level))
        for level in (5, 5 * factor)
    ]
    if all(fit.converged for fit in fits) and factor > 0.5:  # far below the noise every row is an outlier
        np.testing.assert_allclose(
            fits[1].covariance, factor**2 * fits[0].covariance, rtol=0.05, atol=1e-9 * factor**2
        )


@given(seeds, dimensions, weightings)
def test_refining_what_is_refined_changes_nothing(seed, dimension, weighting):
    rows, truth = scene_rows(seed, dimension)
    first = refine_point_lines(truth, rows, None, Options(weighting=weighting))
    again = refine_point_lines(first.transform, rows, None, first.levelled)
    np.testing.assert_allclose(again.transform.matrix, first.transform.matrix, atol=1e-4)
    step = np.random.default_rng(seed).normal(size=7) * STEP
    back = refine_point_lines(tangent_step(first.transform, step), rows, None, first.levelled)
    if back.converged and first.converged:
        np.testing.assert_allclose(back.transform.matrix, first.transform.matrix, atol=1e-3)


@given(seeds)
def test_the_wider_model_fits_no_worse(seed):
    rows, truth = scene_rows(seed, 2)
    narrow, wide = (
        refine_point_lines(truth, rows, None, Options(model=model, weighting="geometric"))
        for model in ("similarity", "anisotropic")
    )
    assert np.sum(wide.residuals_mm**2) <= np.sum(narrow.residuals_mm**2) * (1 + 1e-9)
    assert wide.covariance.shape == (8, 8)


def test_the_covariance_is_that_of_many_repetitions():
    """Known noise, drawn again and again: errors of the corners have the covariance that the fit predicts."""
    truth = scene_rows(3, 2, 40)[1]
    clean, _ = scene_rows(3, 2, 40, sigma_px=0.0, sigma_mm=0.0)
    random, options, squares, predicted = (
        np.random.default_rng(0),
        Options(sigma_px=1.0, sigma_mm=0.5),
        [],
        [],
    )
    for _ in range(300):
        points, segments = (
            clean.points.copy(),
            clean.segments_mm + 0.5 * random.normal(size=clean.segments_mm.shape),
        )
        points[:, :2] += random.normal(size=(len(points), 2))
        fit = refine_point_lines(
            truth, dataclasses.replace(clean, points=points, segments_mm=segments), None, options
        )
        squares.append(np.sum((fit.transform @ CORNERS - truth @ CORNERS) ** 2, axis=1))
        covariances = point_covariance(fit.transform, fit.covariance, CORNERS)
        predicted.append(np.trace(covariances, axis1=1, axis2=2))
    np.testing.assert_allclose(np.mean(squares, axis=0), np.mean(predicted, axis=0), rtol=0.25)


@given(seeds, dimensions)
def test_distances_are_those_to_the_nearest_point_of_the_line(seed, dimension):
    rows, truth = scene_rows(seed, dimension)
    mapped = MappedRows(truth, rows)
    fit = refine_point_lines(truth, rows, None, Options(weighting="geometric"))
    away = away_from_lines(fit.transform @ rows.points, rows.segments_mm)
    np.testing.assert_allclose(np.linalg.norm(away, axis=1), fit.residuals_mm, atol=1e-9)
    np.testing.assert_allclose(MappedRows(fit.transform, rows).residuals, away, atol=1e-9)
    np.testing.assert_allclose(np.sum(away * segment_directions(rows.segments_mm), axis=1), 0, atol=1e-9)
    places = np.linspace(-3, 3, 4001)[:, None, None]
    along = rows.segments_mm[:, 1] - rows.segments_mm[:, 0]
    on_line = rows.segments_mm[:, 0] + places * along
    nearest = np.linalg.norm(truth @ rows.points - on_line, axis=2).min(axis=0)
    inside = np.abs(mapped.along_mm) < 3 * np.linalg.norm(along, axis=1)
    assert np.all(mapped.distances[inside] <= nearest[inside] + 1e-9)
    # The nearest of the places tried is half a step from the foot at most.
    half_step = 0.5 * 6 / 4000 * np.linalg.norm(along, axis=1)[inside]
    assert np.all(nearest[inside] ** 2 <= mapped.distances[inside] ** 2 + 1.001 * half_step**2 + 1e-9)


@given(seeds, dimensions)
def test_a_mapped_point_is_its_place_along_the_line_and_its_residual_away_from_it(seed, dimension):
    rows, truth = scene_rows(seed, dimension)
    mapped = MappedRows(truth, rows)
    start, end = rows.segments_mm[:, 0], rows.segments_mm[:, 1]
    np.testing.assert_allclose(start + mapped.lengths_mm[:, None] * mapped.directions, end, atol=1e-9)
    foot = start + mapped.along_mm[:, None] * mapped.directions
    np.testing.assert_allclose(foot + mapped.residuals, truth @ rows.points, atol=1e-9)
    np.testing.assert_allclose(start + mapped.from_first, truth @ rows.points, atol=1e-9)


# Mirrored answers


def tilted_little(seed, spread=0.02):
    """Rows of a 2D probe whose lines are nearly parallel."""
    rows, truth = scene_rows(seed, 2, 30, sigma_px=0.3, sigma_mm=0.3)
    random = np.random.default_rng(seed)
    directions = [0.2, 0.1, 1.0] + spread * random.normal(size=(30, 3))
    along = 100 * directions / np.linalg.norm(directions, axis=1, keepdims=True) @ truth.rotation.T
    middle = truth @ rows.points
    ends = np.stack([middle - along, middle + along], axis=1) + 0.3 * random.normal(size=(30, 2, 3))
    return dataclasses.replace(rows, segments_mm=ends)


@given(seeds)
def test_the_mirror_of_the_mirrored_answer_is_the_answer(seed):
    rows = tilted_little(seed)
    fit = refine_point_lines(
        fit_point_lines(rows, Options()).transform, rows, None, Options(weighting="geometric")
    )
    other = mirrored_answer(rows, fit)
    if other is None:
        return
    back = mirrored_answer(rows, other)
    if back is not None and back.converged and other.converged:
        here, there = (np.sum(one.residuals_mm**2) for one in (fit, back))
        assert there <= here * 1.5 + 1e-9 or np.sum(other.residuals_mm**2) < there


@given(seeds)
def test_of_two_answers_the_better_is_first_and_the_other_no_likelier_than_even(seed):
    rows = tilted_little(seed)
    best, other = better_of_mirrored(rows, fit_point_lines(rows, Options()))
    if other is None:
        return
    squares = [np.sum(np.minimum(one.residuals_mm, best.threshold_mm) ** 2) for one in (best, other)]
    assert squares[0] <= squares[1] * (1 + 1e-9)
    rival = rival_of(best, other, best.covariance, CORNERS[:, :2])
    if rival is not None:
        assert 0 < rival.probability <= 0.5
        assert rival.apart_mm > 0
        assert np.linalg.eigvalsh(rival.covariance).min() >= -1e-9 * np.trace(rival.covariance)


@given(seeds)
def test_an_image_at_right_angles_to_its_lines_is_its_own_mirror(seed):
    rows, truth = scene_rows(seed, 2, 30)
    directions = truth.rotation[:, 2] + 0.02 * np.random.default_rng(seed).normal(size=(30, 3))
    middle = truth @ rows.points
    ends = np.stack([middle - 100 * directions, middle + 100 * directions], axis=1)
    exact = dataclasses.replace(rows, segments_mm=ends)
    fit = refine_point_lines(truth, exact, None, Options(weighting="geometric"))
    assert mirrored_answer(exact, fit) is None


@given(seeds)
def test_lines_in_all_directions_and_volumes_have_no_mirrored_answer(seed):
    for dimension in (2, 3):
        rows, _ = scene_rows(seed, dimension, 40)
        assert best_fit(rows, Options())[1] is None


@pytest.mark.parametrize("count", [7, 8, 9])
def test_a_threshold_from_the_noise_keeps_few_sound_rows(count):
    """Those of a sample fit their own answer: they say nothing of the noise."""
    kept = []
    for seed in range(40):
        rows, truth = scene_rows(seed, 2, count)
        options = Options(weighting="geometric", threshold_mm="auto")
        found = fit_point_lines(rows, options)
        everything = refine_point_lines(truth, rows, None, options)
        noise_mm = np.sqrt(everything.squares_mm2 / (2 * count - 7))
        assert 0.3 * noise_mm < found.threshold_mm < 30 * noise_mm
        kept.append(np.mean(found.inlier))
    assert np.mean(kept) > 0.85


@pytest.mark.parametrize("dimension", [2, 3])
def test_consensus_under_a_known_scale_is_as_right_as_without(dimension):
    free = known = samples = more_samples = 0
    for seed in range(40):
        rows, truth = scene_rows(seed, dimension, 40, outlier_share=0.55)
        for scale in (None, float(truth.scale)):
            told = {} if scale is None else {"model": "rigid", "scale_mm_per_px": scale}
            fit = fit_point_lines(rows, Options.of(weighting="geometric", **told))
            right = np.linalg.norm(fit.transform @ CORNERS - truth @ CORNERS, axis=1).max() < 10.0
            if scale is None:
                free, more_samples = free + right, more_samples + fit.samples
            else:
                known, samples = known + right, samples + fit.samples
    assert known >= free >= 36
    assert samples < (0.7 if dimension == 2 else 1.1) * more_samples
