"""The core's sums over residuals against the same statistics written with dense matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sonocal import _core
from sonocal.registration.noise import estimate_noise
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.rows import to_core
from tests.builders.point_lines import reordered, scene_rows, wire_rows

seeds = st.integers(0, 3_000)
dimensions = st.sampled_from([2, 3])


def fitted(rows, **options):
    return fit_point_lines(rows, Options.of(**({"threshold_mm": 100.0} | options)))


def sums_of(rows, fit, groupings=(), known_px=False, known_mm=False):
    of_fit = fit.options.to_core(fit.sigma_px, fit.sigma_mm)
    codes = [np.ascontiguousarray(codes, dtype=np.int32) for codes in groupings]
    about = to_core(fit.transform), of_fit, fit.covariance, codes
    return _core.noise_sums(rows.core, fit.inlier, *about, known_px=known_px, known_mm=known_mm)


def whitened(rows, fit):
    """Residuals of unit variance: (M,), (M, k), (M, 3), (M, 2) and the row of each."""
    of_fit = fit.options.to_core(fit.sigma_px, fit.sigma_mm)
    white = _core.white_residuals(rows.core, fit.inlier, to_core(fit.transform), of_fit)
    return white.white, white.jacobian, white.shift, white.by_level, white.row


def offsets(labels, shift):
    """(M, 3 G): the map from groups' offsets to residuals, group after group."""
    groups = np.unique(labels)
    return np.hstack([np.where((labels == group)[:, None], shift, 0.0) for group in groups])


@given(seeds, dimensions, st.sampled_from(["likelihood", "geometric"]))
def test_white_residuals_have_the_information_that_the_covariance_is_the_inverse_of(
    seed, dimension, weighting
):
    rows, _ = scene_rows(seed, dimension)
    fit = fitted(rows, weighting=weighting)
    _, jacobian, _, _, _ = whitened(rows, fit)
    size = np.sqrt(np.diag(fit.covariance))
    information = (jacobian * size).T @ (jacobian * size) @ (fit.covariance / np.outer(size, size))
    # Sightings beyond four standard deviations count less in the fit than in the white residuals.
    np.testing.assert_allclose(np.diag(information), 1.0, atol=1e-6 if weighting == "geometric" else 0.6)


@given(seeds, st.sampled_from(["likelihood", "geometric"]))
def test_sums_between_groups_are_those_of_dense_matrices(seed, weighting):
    rows = wire_rows(seed)
    fit = fitted(rows, weighting=weighting)
    residual, jacobian, shift, _, row = whitened(rows, fit)
    groupings = [rows.frame, rows.target]
    sums = sums_of(rows, fit, groupings)
    assert sums.kept == [0, 1]
    left_over = np.eye(len(residual)) - jacobian @ fit.covariance @ jacobian.T
    maps = [offsets(codes[row], shift) for codes in groupings]
    expected = np.empty((3, 3))
    expected[0] = [len(residual) - 7, *(np.trace(b.T @ left_over @ b) for b in maps)]
    observed = [residual @ residual]
    for place, mine in enumerate(maps, start=1):
        weight = np.sum(mine**2, axis=0).reshape(-1, 3).sum(axis=1).repeat(3)
        scaled = mine / np.sqrt(weight)
        observed.append(np.sum((scaled.T @ residual) ** 2))
        blocks = np.trace((scaled.T @ left_over @ scaled).reshape(len(weight), -1))
        expected[place] = [blocks, *(np.sum((scaled.T @ left_over @ b) ** 2) for b in maps)]
    np.testing.assert_allclose(sums.observed, observed, rtol=1e-9)
    np.testing.assert_allclose(sums.expected, expected, rtol=1e-6)
    for place, mine in enumerate(maps):
        pulled = fit.covariance @ jacobian.T @ mine
        scale = np.abs(pulled @ pulled.T).max()
        np.testing.assert_allclose(sums.of_offsets[place], pulled @ pulled.T, atol=1e-9 * scale)


def errors_of_levels(by_level, left_over, log_ratio):
    """Mean square and bias of the levels' squares, found by restricted likelihood; of two, with a prior."""
    scaled = by_level / np.abs(by_level).max(axis=0)
    parts = [left_over * column for column in scaled.T]
    information = np.array([[0.5 * np.trace(a @ b) for b in parts] for a in parts])
    if len(parts) == 1:
        return scaled, 1 / information, np.zeros(1)
    apart = np.array([1.0, -1.0]) / np.abs(by_level).max(axis=0)
    inverse = np.linalg.pinv(information + np.outer(apart, apart) / 4, rcond=1e-10, hermitian=True)
    bias = -inverse @ apart * log_ratio / 4
    return scaled, inverse @ information @ inverse + np.outer(bias, bias), bias


def log_ratio_of_parts(rows, fit):
    """Of what pixels and segment ends have in the variances of all residuals across the needles."""
    ends, points = rows.segments_mm[fit.inlier], fit.transform @ rows.points[fit.inlier]
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    along /= length[:, None]
    linear = fit.transform.matrix[:3, : rows.dimension]
    seen = np.sum(linear**2) - np.sum((along @ linear) ** 2, axis=1)
    tau = np.sum((points - ends.mean(axis=1)) * along, axis=1) / (length / 2)
    return np.log(fit.sigma_px**2 * np.sum(seen) / (fit.sigma_mm**2 * np.sum(1 + tau**2)))


@given(seeds, dimensions, st.sampled_from([(False, False), (True, False), (False, True)]))
def test_the_wider_covariance_is_that_of_dense_matrices(seed, dimension, known):
    rows, _ = scene_rows(seed, dimension, 8)
    fit = fitted(rows)
    _, jacobian, _, by_level, _ = whitened(rows, fit)
    sums = sums_of(rows, fit, known_px=known[0], known_mm=known[1])
    by_level = by_level[:, [not known[0], not known[1]]]
    by_level = by_level[:, np.abs(by_level).max(axis=0) > 0]
    if by_level.shape[1] == 0:
        np.testing.assert_array_equal(sums.covariance, fit.covariance)
        return
    left_over = np.eye(len(jacobian)) - jacobian @ fit.covariance @ jacobian.T
    # Of the logarithms: what they are a part of is the variance of one.
    size_of = np.array([fit.sigma_px**2, fit.sigma_mm**2])[: by_level.shape[1]]
    if by_level.shape[1] == 2:
        by_level = by_level * size_of
    scaled, spread, bias = errors_of_levels(by_level, left_over, log_ratio_of_parts(rows, fit))
    wider = fit.covariance.copy()
    for column, off in zip(by_level.T, bias / np.abs(by_level).max(axis=0), strict=True):
        share = (jacobian * column[:, None]).T @ jacobian
        wider += np.expm1(-off) * fit.covariance @ share @ fit.covariance
    for i, j in np.ndindex(spread.shape):
        hidden = (jacobian * scaled[:, [i]]).T @ left_over @ (jacobian * scaled[:, [j]])
        wider += 2.0 * spread[i, j] * fit.covariance @ hidden @ fit.covariance
    wider = 0.5 * (wider + wider.T)
    # The core scales it so that distances are F distributed: the shape is what can be compared.
    ratio = sums.covariance / wider
    size = np.sqrt(np.diag(wider))
    factor = np.median(np.diag(ratio))
    np.testing.assert_allclose(
        sums.covariance / np.outer(size, size), factor * wider / np.outer(size, size), atol=1e-5 * factor
    )
    assert 0.2 < factor < 5


@given(seeds, dimensions)
def test_one_level_leaves_the_covariance_alone_and_the_freedom_of_linear_regression(seed, dimension):
    rows, _ = scene_rows(seed, dimension, 9)
    fit = fitted(rows, weighting="geometric")
    sums = sums_of(rows, fit)
    np.testing.assert_allclose(sums.covariance, fit.covariance, rtol=1e-6)
    assert sums.freedom == pytest.approx(2 * len(rows) - 7, rel=1e-6)
    assert estimate_noise(rows, fit, {}).freedom == 2 * len(rows) - 7


@given(seeds, dimensions)
def test_known_levels_leave_nothing_to_widen(seed, dimension):
    rows, _ = scene_rows(seed, dimension, 9)
    fit = fitted(rows, sigma_px=1.0, sigma_mm=1.0)
    sums = sums_of(rows, fit, known_px=True, known_mm=True)
    np.testing.assert_array_equal(sums.covariance, fit.covariance)
    assert sums.freedom == np.inf


@given(seeds, dimensions)
@settings(max_examples=15)
def test_levels_that_were_estimated_leave_a_finite_freedom(seed, dimension):
    rows, _ = scene_rows(seed, dimension, 12)
    fit = fitted(rows)
    known = sums_of(rows, fit, known_px=True, known_mm=True)
    one, both = sums_of(rows, fit, known_px=True), sums_of(rows, fit)
    assert both.freedom <= known.freedom
    assert one.freedom <= known.freedom
    assert 4 < both.freedom < np.inf


@given(seeds)
def test_names_of_groups_do_not_matter_and_neither_does_the_order_of_rows(seed):
    rows, random = wire_rows(seed), np.random.default_rng(seed)
    fit = fitted(rows)
    noise = estimate_noise(rows, fit, {"frame": rows.frame, "target": rows.target})
    renamed = random.permutation(1000).astype(np.int32)
    other = estimate_noise(rows, fit, {"frame": renamed[rows.frame], "target": renamed[rows.target]})
    np.testing.assert_allclose(other.covariance, noise.covariance, rtol=1e-6, atol=1e-18)
    assert other.shared_mm == pytest.approx(noise.shared_mm)
    order = random.permutation(len(rows))
    shuffled = reordered(rows, order)
    again = refine_point_lines(fit.transform, shuffled, None, fit.levelled)
    mixed = estimate_noise(shuffled, again, {"frame": shuffled.frame, "target": shuffled.target})
    assert mixed.row_mm == pytest.approx(noise.row_mm, rel=1e-4)
    assert mixed.shared_mm == pytest.approx(noise.shared_mm, rel=1e-3, abs=1e-6)


@given(seeds)
def test_a_shared_error_widens_what_independent_errors_leave(seed):
    rows = wire_rows(seed, drift_mm=1.0)
    fit = fitted(rows)
    alone, grouped = (estimate_noise(rows, fit, groups) for groups in ({}, {"target": rows.target}))
    if grouped.shared_mm.get("target", 0.0) > alone.row_mm:
        assert np.trace(grouped.covariance[3:6, 3:6]) > np.trace(alone.covariance[3:6, 3:6])
    assert grouped.row_mm <= alone.row_mm * (1 + 1e-9)


def test_no_row_to_spare_leaves_no_number():
    rows, truth = scene_rows(0, 2, 3)
    noise = estimate_noise(rows, refine_point_lines(truth, rows, None, Options(weighting="geometric")), {})
    assert noise.freedom == 0
    assert np.isnan(noise.row_mm)
    assert np.isnan(noise.covariance).all()
