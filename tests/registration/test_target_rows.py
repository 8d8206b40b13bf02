"""What is said of rows on lines and what is said of the same rows as those of a mix is the same."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import _core
from sonocal.registration.fit_targets import fit_targets, refine_targets
from sonocal.registration.mapped import MappedRows, MappedTargets
from sonocal.registration.model_test import model_tests
from sonocal.registration.noise import estimate_noise
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import to_core
from sonocal.registration.uncertainty import point_jacobian
from sonocal.registration.whitened_targets import whitened_targets
from tests.builders.mixed_tables import mixed_table
from tests.builders.point_lines import scene_rows, wire_rows
from tests.builders.target_rows import as_targets, of_observations

seeds = st.integers(0, 3_000)
dimensions = st.sampled_from([2, 3])


@given(seeds, st.sampled_from(["likelihood", "geometric"]))
@settings(max_examples=25)
def test_noise_of_lines_is_that_of_the_same_lines_as_a_mix(seed, weighting):
    rows = wire_rows(seed, frames=30)
    mix, options = as_targets(rows), Options(threshold_mm=100.0, weighting=weighting)
    fit = fit_point_lines(rows, options)
    groups = {"frame": rows.frame, "target": rows.target}
    time = rows.frame.astype(float)
    found, other = (estimate_noise(one, fit, groups, time=time) for one in (rows, mix))
    if found.drift is None and other.drift is None:  # else the search for it may rest a little elsewhere
        size = np.sqrt(np.diag(found.covariance))
        np.testing.assert_allclose(
            other.covariance / np.outer(size, size), found.covariance / np.outer(size, size), atol=2e-3
        )
        assert other.shared_mm == pytest.approx(found.shared_mm, rel=1e-3, abs=1e-6)
    assert other.row_mm == pytest.approx(found.row_mm, rel=1e-2)
    if weighting == "likelihood":
        assert other.apparent == pytest.approx(found.apparent, rel=2e-2, abs=1e-6)


@given(seeds, dimensions)
def test_places_under_a_transform_are_those_of_lines(seed, dimension):
    rows, truth = scene_rows(seed, dimension)
    lines, mix = MappedRows(truth, rows), MappedTargets(truth, as_targets(rows))
    np.testing.assert_allclose(mix.residuals, lines.residuals, atol=1e-8)
    np.testing.assert_allclose(mix.shares[:, :2], lines.shares, atol=1e-8)
    np.testing.assert_allclose(mix.shares[:, 2], 0.0, atol=1e-12)
    every = np.arange(len(rows))
    moved = point_jacobian(truth, rows.points)
    np.testing.assert_allclose(
        mix.across(every, moved), lines.across(every, moved), atol=1e-8 * np.abs(moved).max()
    )


@given(seeds, st.booleans(), st.sampled_from([(2.0, 0.6), (4.0, 0.3), (0.0, 0.0)]))
@settings(max_examples=25)
def test_white_numbers_of_python_and_core_have_the_same_squares(seed, flat, levels):
    truth, table = mixed_table(seed, 6, flat=flat)
    rows = of_observations(table.select(np.random.default_rng(seed).permutation(len(table))))
    mapped, every = MappedTargets(truth, rows), np.ones(len(rows), dtype=bool)
    columns = np.concatenate([point_jacobian(truth, rows.points), mapped.residuals[:, :, None]], axis=2)
    white = whitened_targets(mapped, every, columns, levels)
    options = Options(weighting="likelihood" if any(levels) else "geometric").to_core(*levels)
    core = _core.white_residuals(rows.core, rows.marks(every), to_core(truth), options)
    theirs = np.column_stack([core.jacobian, core.white])
    mine = white.values
    if not any(levels):
        mine = mine * np.linalg.norm(theirs[:, -1]) / np.linalg.norm(mine[:, -1])
    assert mine.shape == theirs.shape == (rows.residuals(every), 8)
    size = np.linalg.norm(theirs, axis=0)
    np.testing.assert_allclose(
        (mine / size).T @ (mine / size), (theirs / size).T @ (theirs / size), atol=1e-6
    )
    assert set(rows.sightings[white.row]) == set(range(rows.sightings.max() + 1))


@given(seeds, dimensions)
@settings(max_examples=15)
def test_fits_of_lines_and_of_a_mix_of_them_rest_together(seed, dimension):
    rows, truth = scene_rows(seed, dimension, 20)
    options, every = Options(threshold_mm=100.0), np.ones(len(rows), dtype=bool)
    fit = refine_point_lines(truth, rows, every, options)
    sure = 1e-2 * float(np.sqrt(np.trace(fit.covariance[3:6, 3:6])))
    for other in (
        refine_targets(truth, as_targets(rows), every, options),
        fit_targets(as_targets(rows), options),
    ):
        np.testing.assert_allclose(other.transform.matrix, fit.transform.matrix, atol=5 * sure)
        assert other.sigma_mm == pytest.approx(fit.sigma_mm, rel=0.2, abs=0.05)


@given(seeds, dimensions)
@settings(max_examples=15)
def test_models_of_stretched_rows_are_told_apart_as_those_of_lines(seed, dimension):
    rows, _ = scene_rows(seed, dimension, 20)
    stretched = dataclasses.replace(
        rows, points=rows.points * np.array([1.0, 1.1, 1.0])[: rows.points.shape[1]]
    )
    fit = fit_point_lines(stretched, Options(threshold_mm=100.0))
    (mine,), (theirs,) = (
        model_tests(
            one, fit, lambda other, one=one: estimate_noise(one, other, {"frame": rows.frame}), rows.points
        )
        for one in (as_targets(stretched), stretched)
    )
    assert len(mine.wider_mm_per_px) == dimension
    np.testing.assert_allclose(mine.wider_mm_per_px, theirs.wider_mm_per_px, rtol=2e-3)
    assert mine.p_value == pytest.approx(theirs.p_value, rel=0.2, abs=1e-4)


def test_rows_in_any_order_are_the_same_rows():
    _, table = mixed_table(3, 10)
    order = np.random.default_rng(0).permutation(len(table))
    rows, mixed = of_observations(table), of_observations(table.select(order))
    fits = [fit_targets(one, Options()) for one in (rows, mixed)]
    noises = [
        estimate_noise(one, fit, {"frame": one.frame % 5})
        for one, fit in zip((rows, mixed), fits, strict=True)
    ]
    size = np.sqrt(np.diag(noises[0].covariance))
    np.testing.assert_allclose(
        (noises[1].covariance - noises[0].covariance) / np.outer(size, size), 0.0, atol=0.02
    )
    np.testing.assert_allclose(fits[1].residuals_mm, fits[0].residuals_mm[order], atol=1e-2)
