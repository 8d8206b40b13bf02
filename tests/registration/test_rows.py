"""Rows of points and lines: selected, counted again, made into the core's table once."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sonocal import _core
from sonocal.errors import InputError
from sonocal.registration.options import Options
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import PointLineRows, to_core
from tests.builders.point_lines import reordered, scene_rows, wire_rows
from tests.builders.similarities import random_similarity

seeds = st.integers(0, 3_000)


def masks(rows, seed):
    chosen = np.random.default_rng(seed).random(len(rows)) < 0.6
    chosen[0] = True
    return chosen


@given(seeds, st.sampled_from([2, 3]))
def test_selecting_keeps_rows_in_order_and_counts_from_zero(seed, dimension):
    rows, _ = scene_rows(seed, dimension)
    chosen = masks(rows, seed)
    some = rows.select(chosen)
    np.testing.assert_array_equal(some.points, rows.points[chosen])
    np.testing.assert_array_equal(some.segments_mm, rows.segments_mm[chosen])
    for name in ("sightings", "frame", "target"):
        before, after = getattr(rows, name), getattr(some, name)
        if before is None:
            assert after is None
            continue
        assert after.dtype == np.int32
        assert set(after) == set(range(len(set(before[chosen]))))
        same = before[chosen][:, None] == before[chosen]
        np.testing.assert_array_equal(after[:, None] == after, same)
    assert len(some.core) == chosen.sum()


@given(seeds)
def test_selecting_twice_is_selecting_what_is_in_both(seed):
    rows = wire_rows(seed)
    first = masks(rows, seed)
    second = masks(rows.select(first), seed + 1)
    both = first.copy()
    both[first] = second
    once, twice = rows.select(both), rows.select(first).select(second)
    for field in dataclasses.fields(rows):
        np.testing.assert_array_equal(getattr(twice, field.name), getattr(once, field.name))


@given(seeds)
def test_selecting_all_is_the_same_fit(seed):
    rows, _ = scene_rows(seed, 3)
    everything = rows.select(np.ones(len(rows), dtype=bool))
    here, there = fit_point_lines(rows, Options()), fit_point_lines(everything, Options())
    np.testing.assert_array_equal(here.transform.matrix, there.transform.matrix)


def test_the_table_is_made_once_and_sightings_of_a_2d_image_are_left_to_the_core():
    rows, _ = scene_rows(0, 2)
    assert rows.core is rows.core
    coded = dataclasses.replace(rows, sightings=np.zeros(len(rows), dtype=np.int32))
    np.testing.assert_array_equal(
        fit_point_lines(coded, Options()).transform.matrix, fit_point_lines(rows, Options()).transform.matrix
    )


@pytest.mark.parametrize(
    ("name", "values", "sentence"),
    [
        ("points", np.full((20, 3), np.inf), "points holds a number that is not finite"),
        ("segments_mm", np.zeros((20, 2, 3)), "a segment has no length"),
        ("frame", np.full(20, -1, dtype=np.int32), "frames holds a number below 0"),
        ("target", np.zeros(3, dtype=np.int32), "targets has 3 entries for 20 rows"),
        ("sigma_px", np.zeros(20), "noise_px holds a number that is not positive"),
    ],
)
def test_rows_that_cannot_be_fitted_are_refused_in_a_sentence(name, values, sentence):
    rows, _ = scene_rows(0, 2)
    with pytest.raises(InputError, match=f"^the rows cannot be fitted: {sentence}"):
        _ = dataclasses.replace(rows, **{name: values}).core


@given(seeds, st.floats(1e-6, 1e6))
def test_a_level_that_is_given_is_taken_and_a_column_stands_for_one(seed, sigma):
    rows = wire_rows(seed)
    assert rows.level_px(sigma) == rows.level_mm(sigma) == sigma
    assert rows.level_px(None) == rows.level_mm(None) == 0.0  # to be estimated
    columns = dataclasses.replace(rows, sigma_px=np.full(len(rows), 2.0), sigma_mm=np.full(len(rows), 3.0))
    assert columns.level_px(None) == columns.level_mm(None) == 1.0
    assert columns.level_px(sigma) == sigma


@given(seeds, st.floats(0.1, 10))
def test_a_column_is_a_factor_of_the_level(seed, factor):
    rows = wire_rows(seed)
    column = dataclasses.replace(rows, sigma_px=np.full(len(rows), factor))
    by_column = fit_point_lines(column, Options(sigma_px=1.0, sigma_mm=1.0, threshold_mm=50))
    by_level = fit_point_lines(rows, Options(sigma_px=factor, sigma_mm=1.0, threshold_mm=50))
    np.testing.assert_allclose(by_column.transform.matrix, by_level.transform.matrix, atol=1e-6)
    np.testing.assert_allclose(by_column.covariance, by_level.covariance, rtol=1e-5, atol=1e-14)


@given(seeds)
def test_a_transform_comes_back_from_the_core_as_it_went(seed):
    rows, _ = scene_rows(0, 2)
    transform = random_similarity(seed)
    options = Options().to_core(1.0, 1.0)
    white = _core.white_residuals(rows.core, np.ones(len(rows), dtype=bool), to_core(transform), options)
    np.testing.assert_array_equal(white.rotation, transform.rotation)
    np.testing.assert_array_equal(white.translation, transform.translation)
    np.testing.assert_array_equal(white.scales, transform.scales)


def test_reordering_in_these_tests_keeps_what_is_no_array():
    rows = wire_rows(0)
    other = reordered(rows, np.arange(len(rows))[::-1])
    assert isinstance(other, PointLineRows)
    assert other.dimension == 2
    np.testing.assert_array_equal(other.frame, rows.frame[::-1])
