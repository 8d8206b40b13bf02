"""The fit against independent oracles: SciPy's optimiser and central differences."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import least_squares

from sonocal import AxisScaled, NoConsensusError, Observations
from sonocal.calibration import point_line_rows
from sonocal.geometry import homogeneous_points, similarity_errors
from sonocal.registration.noise import residual_vectors
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.robust import fit_point_lines
from sonocal.registration.uncertainty import point_jacobian
from sonocal.simulation.scene import simulate_observations

seeds = st.integers(0, 5_000)
dimensions = st.sampled_from([2, 3])


def fit(rows, **options):
    return fit_point_lines(point_line_rows(rows), Options.of(**{"weighting": "geometric"} | options))


def retract(transform, step):
    moved = transform_similarity(transform).retract(np.r_[step[:6], 0.0])
    growth = np.exp([step[6], step[-1], (step[6] + step[-1]) / 2])
    return AxisScaled(moved.rotation, moved.translation, transform.scales * growth)


def transform_similarity(transform):
    from sonocal import Similarity

    return Similarity(transform.rotation, transform.translation, transform.scales[0])


def residuals(rows, transform):
    return residual_vectors(transform, homogeneous_points(rows.points_px), rows.segments_mm).ravel()


def numeric_jacobian(function, parameters, step=1e-6):
    columns = [(function(step * e) - function(-step * e)) / (2 * step) for e in np.eye(parameters)]
    return np.stack(columns, axis=-1)


@given(seeds, dimensions, st.sampled_from(["similarity", "anisotropic"]))
def test_covariance_is_the_inverse_of_jacobian_squared_by_differences(seed, dimension, model):
    if dimension == 3:
        model = "similarity"
    rows = simulate_observations(dimension, 12, seed=seed).observations
    found = fit(rows, model=model)
    parameters = len(found.covariance)
    jacobian = numeric_jacobian(lambda d: residuals(rows, retract(found.transform, d)), parameters)
    product = found.covariance @ jacobian.T @ jacobian
    np.testing.assert_allclose(product, np.eye(parameters), atol=2e-4)


@given(seeds, st.sampled_from([7, 8]))
def test_point_jacobian_by_differences(seed, parameters):
    rng = np.random.default_rng(seed)
    scene = simulate_observations(3, 4, seed=seed)
    points = rng.uniform(0, 500, (5, 3))
    if parameters == 8:
        points[:, 2] = 0
    numeric = numeric_jacobian(lambda d: retract(scene.probe_from_image, d) @ points, parameters)
    np.testing.assert_allclose(point_jacobian(scene.probe_from_image, points, parameters), numeric, atol=1e-4)


@given(seeds, dimensions)
def test_no_small_motion_lowers_the_cost(seed, dimension):
    rows = simulate_observations(dimension, 12, seed=seed).observations
    found = fit(rows)
    gradient = numeric_jacobian(lambda d: np.sum(residuals(rows, retract(found.transform, d)) ** 2), 7)
    assert found.converged
    np.testing.assert_allclose(gradient, 0, atol=1e-2)  # mm^2 a rad, mm or unit: the cost is some 20 mm^2


@given(seeds, dimensions)
def test_scipy_finds_no_lower_cost(seed, dimension):
    rows = simulate_observations(dimension, 12, seed=seed).observations
    found = fit(rows)
    other = least_squares(lambda d: residuals(rows, retract(found.transform, d)), np.zeros(7), method="lm")
    assert np.sum(found.residuals_mm**2) <= 2 * other.cost * (1 + 1e-9)
    np.testing.assert_allclose(found.residuals_mm**2, (other.fun.reshape(-1, 3) ** 2).sum(1), atol=1e-5)


@given(seeds, dimensions)
def test_refinement_from_a_disturbed_start_returns_to_the_fit(seed, dimension):
    rows = simulate_observations(dimension, 12, seed=seed).observations
    found = fit(rows)
    step = np.random.default_rng(seed).normal(size=7) * [0.03, 0.03, 0.03, 3, 3, 3, 0.03]
    again = refine_point_lines(
        retract(found.transform, step), point_line_rows(rows), None, Options(weighting="geometric")
    )
    assert again.converged
    np.testing.assert_allclose(again.transform.matrix, found.transform.matrix, atol=1e-6)


@given(seeds)
def test_the_anisotropic_model_finds_different_scales(seed):
    scene = simulate_observations(2, 30, sigma_px=0, sigma_mm=0, seed=seed)
    rows = scene.observations
    stretched = fit(
        Observations(points_px=rows.points_px * [1.0, 0.9], segments_mm=rows.segments_mm), model="anisotropic"
    )
    np.testing.assert_allclose(stretched.transform.scales[:2], [0.24, 0.24 / 0.9], rtol=1e-6)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("share", [0.2, 0.4, 0.6])
def test_gross_outliers_are_left_out_and_the_rest_fitted(dimension, share):
    for seed in range(20):
        scene = simulate_observations(dimension, 40, outlier_share=share, seed=seed)
        found = fit(scene.observations)
        assert found.inlier[~scene.outlier].mean() > 0.95
        error = found.transform @ [[250.0, 250, 0]] - scene.probe_from_image @ [[250.0, 250, 0]]
        assert np.linalg.norm(error) < 3


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_same_seed_gives_the_same_bits(dimension):
    rows = simulate_observations(dimension, 60, outlier_share=0.5, seed=4).observations
    first, second = fit(rows, seed=7), fit(rows, seed=7)
    np.testing.assert_array_equal(first.transform.matrix, second.transform.matrix)
    assert first.samples == second.samples


def test_all_combinations_are_tried_where_they_are_few():
    rows = simulate_observations(2, 9, seed=0).observations
    assert fit(rows).samples == 126  # 9 choose 4
    rows = simulate_observations(3, 9, seed=0).observations
    assert fit(rows).samples == 36  # 9 choose 2


def test_no_consensus_says_how_many_rows_agreed_at_best():
    rng = np.random.default_rng(0)
    rows = simulate_observations(2, 6, seed=0).observations
    nonsense = rng.normal(size=(6, 2, 3)) * 1e4
    with pytest.raises(NoConsensusError) as caught:
        fit(Observations(rows.points_px, nonsense), threshold_mm=0.01)
    best = caught.value.best_count
    assert best <= 4
    assert str(caught.value) == (
        f"no calibration brings more than {best} of 6 rows within 0.01 mm of their lines, and any 4 rows can be "
        "fitted; check that rows are matched to the right needle poses and that segments are in the probe marker's "
        "frame in mm"
    )


# The likelihood's weights


def likelihood_cost(rows, transform, sigma_px, sigma_mm, *, size=True):
    """Minus twice the log likelihood of the residuals, but for constants, with dense covariance matrices.

    Without what the residuals' own size says (`size`), it is the least squared change, in standard deviations, of
    points and needles that brings them together.
    """
    cost = 0.0
    for sighting in np.unique(rows.sightings):
        members = np.flatnonzero(rows.sightings == sighting)
        start, end = rows.segments_mm[members[0]]
        length = np.linalg.norm(end - start)
        along = (end - start) / length
        basis = np.linalg.svd(along[None])[2][1:]  # two normals
        mapped = transform @ rows.points_px[members]
        place = (mapped - start) @ along / length
        weights = np.column_stack([1 - place, place])  # how much of each end's noise a point sees
        tracking = sigma_mm**2 * np.kron(weights @ weights.T, np.eye(2))
        columns = basis @ (transform.rotation * transform.scales)[:, : rows.dimension]
        pixels = sigma_px**2 * np.kron(np.eye(len(members)), columns @ columns.T)
        residual = ((mapped - start) @ basis.T).ravel()
        cost += residual @ np.linalg.solve(tracking + pixels, residual)
        if size:
            cost += np.linalg.slogdet(tracking + pixels)[1]
    return cost


@given(seeds, dimensions, st.sampled_from([(1, 1), (3, 0.3), (0.3, 3)]))
def test_the_likelihood_fit_changes_points_and_needles_least(seed, dimension, sigma):
    """To first order in the noise. The variances move with the transform, or it would shrink the image."""
    rows = simulate_observations(dimension, 30, sigma_px=sigma[0], sigma_mm=sigma[1], seed=seed).observations
    options = {"sigma_px": sigma[0], "sigma_mm": sigma[1], "threshold_mm": 100}
    found, start = fit(rows, weighting="likelihood", **options), fit(rows)
    assert found.converged

    def cost(transform):
        return likelihood_cost(rows, transform, *sigma, size=False)

    assert cost(found.transform) <= cost(start.transform) + 0.05
    gradient = numeric_jacobian(lambda d: cost(retract(found.transform, d)), 7)
    newton = found.covariance @ gradient / 2
    assert newton @ np.linalg.solve(found.covariance, newton) < 0.01  # of 7


@given(st.integers(0, 2_000) | st.sampled_from([386, 390, 815, 1341, 1356, 1747]))
def test_of_few_rows_answers_the_likeliest_is_found(seed):
    """Several answers fit six rows of a 2D probe; refined from the truth none is likelier."""
    sigma = 0.3, 3.0
    scene = simulate_observations(2, 6, sigma_px=sigma[0], sigma_mm=sigma[1], seed=seed)
    levels = {"sigma_px": sigma[0], "sigma_mm": sigma[1]}
    found = fit(scene.observations, weighting="likelihood", threshold_mm=40.0, **levels)
    known = refine_point_lines(
        scene.probe_from_image, point_line_rows(scene.observations), None, Options(**levels)
    )
    cost = [likelihood_cost(scene.observations, one.transform, *sigma) for one in (found, known)]
    assert cost[0] <= cost[1] + 1e-3


def test_the_likelihood_halves_the_rotation_error_of_a_3d_probe():
    squares = {"geometric": 0.0, "likelihood": 0.0}
    for seed in range(40):
        scene = simulate_observations(3, 20, seed=seed)
        for weighting in squares:
            found = fit(scene.observations, weighting=weighting)
            squares[weighting] += similarity_errors(found.transform, scene.probe_from_image)[0] ** 2
    assert squares["likelihood"] < 0.45 * squares["geometric"]


@pytest.mark.parametrize("sigma", [(1, 1), (2, 0.3), (1, 2)])
def test_noise_levels_are_found(sigma):
    levels = []
    for seed in range(20):
        rows = simulate_observations(3, 60, sigma_px=sigma[0], sigma_mm=sigma[1], seed=seed).observations
        found = fit(rows, weighting="likelihood", threshold_mm=100)
        levels.append((found.sigma_px, found.sigma_mm))
    np.testing.assert_allclose(np.mean(levels, axis=0), sigma, rtol=0.25)


@given(seeds, dimensions)
def test_sigma_columns_stand_for_known_levels(seed, dimension):
    rows = simulate_observations(dimension, 15, seed=seed).observations
    columns = dataclasses.replace(rows, sigma_px=np.full(len(rows), 2.0), sigma_mm=np.full(len(rows), 0.5))
    given_alike = fit(rows, weighting="likelihood", sigma_px=2.0, sigma_mm=0.5)
    by_column = fit(columns, weighting="likelihood")
    np.testing.assert_allclose(by_column.transform.matrix, given_alike.transform.matrix, atol=1e-9)
    np.testing.assert_allclose(by_column.covariance, given_alike.covariance, rtol=1e-6, atol=1e-15)


def test_a_noisy_row_that_says_so_hardly_counts():
    scene = simulate_observations(2, 30, seed=3)
    points, sigma = scene.observations.points_px.copy(), np.ones(30)
    points[:5] += 8
    sigma[:5] = 1000
    honest = dataclasses.replace(scene.observations, points_px=points, sigma_px=sigma, sigma_mm=np.ones(30))
    without = scene.observations.select(np.arange(5, 30))
    np.testing.assert_allclose(
        fit(honest, weighting="likelihood").transform.matrix,
        fit(without, weighting="likelihood", sigma_px=1, sigma_mm=1).transform.matrix,
        atol=2e-3,
    )


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("noise", [0.1, 1.0, 3.0])
def test_the_automatic_threshold_follows_the_noise(dimension, noise):
    for seed in range(5):
        scene = simulate_observations(
            dimension, 40, sigma_px=noise, sigma_mm=noise, outlier_share=0.3, seed=seed
        )
        found = fit(scene.observations, weighting="likelihood", threshold_mm="auto")
        assert 1.2 * noise < found.threshold_mm < 8 * noise
        assert found.inlier[~scene.outlier].mean() > 0.9
        assert found.inlier[scene.outlier].mean() < 0.5


def test_ten_thousand_rows_are_fitted_as_a_few_are():
    scene = simulate_observations(2, 20_000, outlier_share=0.3, seed=0)
    found = fit(scene.observations, weighting="likelihood")
    np.testing.assert_allclose(found.transform.matrix, scene.probe_from_image.matrix, atol=0.15)
    assert found.inlier[~scene.outlier].mean() > 0.99


@pytest.mark.parametrize("rows_count", [12, 50, 400])
def test_rows_that_have_nothing_to_do_with_each_other_are_refused(rows_count):
    refused = 0
    for seed in range(10):
        rows = simulate_observations(2, rows_count, seed=seed).observations
        points = np.random.default_rng(seed).uniform(0, 500, (rows_count, 2))
        try:
            fit(Observations(points, rows.segments_mm), max_samples=500)
        except NoConsensusError:
            refused += 1
    assert refused >= 9
