"""What is known of correspondences beyond their places: the scale, how sure each is, other answers that fit as well."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.geometry import Similarity
from sonocal.registration import constraints, register

seeds = st.integers(0, 10_000)


def truth_of(random):
    return Similarity.from_rotvec(random.normal(size=3), random.normal(size=3) * 50, 0.24)


def mix(seed, count=12, noise=0.5):
    """Points in planes and lines in planes, with noise along the planes' normals; and the truth."""
    random = np.random.default_rng(seed)
    truth = truth_of(random)
    normals = random.normal(size=(2, count, 3))
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    points, lines = random.uniform(-200, 200, (count, 3)), random.uniform(-200, 200, (count, 2, 3))
    offsets = -np.einsum("ni,ni->n", normals[0], truth @ points) + noise * random.normal(size=count)
    # A plane through both ends of each line.
    ends = truth @ lines
    across = np.cross(ends[:, 1] - ends[:, 0], normals[1])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    behind = -np.einsum("ni,ni->n", across, ends[:, 0]) + noise * random.normal(size=count)
    return (
        constraints.rows(
            constraints.point_plane(points, np.column_stack([normals[0], offsets])),
            constraints.line_plane(lines, np.column_stack([across, behind])),
        ),
        truth,
    )


def by_scipy(rows, start, weights, scale):
    """Least squares by SciPy from the truth: (4, 4)."""

    def similarity(v):
        return Similarity.from_rotvec(v[:3], v[3:6], scale or np.exp(v[6]))

    def residuals(v):
        return weights * (
            np.einsum("ni,ni->n", similarity(v) @ rows.points, rows.planes[:, :3]) + rows.planes[:, 3]
        )

    first = np.r_[Rotation.from_matrix(start.rotation).as_rotvec(), start.translation, np.log(start.scale)]
    return similarity(
        least_squares(residuals, first if scale is None else first[:6], xtol=1e-14, ftol=1e-14).x
    )


@settings(max_examples=25)
@given(seeds, st.booleans(), st.booleans())
def test_a_mix_with_what_is_told_is_scipys_least_squares(seed, weighted, known):
    rows, truth = mix(seed)
    count = len(rows.first) - 1
    sigma = np.random.default_rng(seed).uniform(0.2, 5.0, count) if weighted else None
    scale = truth.scale * 1.01 if known else None
    found = register(rows, threshold_mm=np.inf, robust=False, sigma_mm=sigma, scale=scale)
    weights = 1.0 if sigma is None else np.repeat(1 / sigma, np.diff(rows.first))
    expected = by_scipy(rows, truth, weights, scale)
    corners = np.array([[x, y, z] for x in (-200, 200) for y in (-200, 200) for z in (-200, 200)])
    assert np.abs(found.target_from_source @ corners - expected @ corners).max() < 1e-3
    if known:
        assert found.target_from_source.scale == scale
        assert np.all(found.covariance[6] == 0)
        assert np.all(found.covariance[:, 6] == 0)
        assert np.linalg.eigvalsh(found.covariance[:6, :6])[0] > 0


@given(seeds, st.floats(0.01, 100.0))
@settings(max_examples=20)
def test_sigmas_that_are_all_alike_say_nothing(seed, sigma):
    rows, _ = mix(seed)
    plain = register(rows)
    told = register(rows, sigma_mm=np.full(len(rows.first) - 1, sigma))
    np.testing.assert_allclose(told.target_from_source.matrix, plain.target_from_source.matrix, atol=1e-6)
    np.testing.assert_allclose(told.covariance, plain.covariance, rtol=1e-4, atol=1e-12)


def test_what_is_told_wrongly_is_refused_in_a_sentence():
    rows, _ = mix(0)
    for told, sentence in (
        ({"sigma_mm": [1.0, 2.0]}, r"one for each of the 24 correspondences; got shape \(2,\)"),
        ({"sigma_mm": np.r_[np.ones(23), -1]}, "sigma_mm of correspondence 23 is -1 and not positive"),
        ({"sigma_mm": np.r_[np.ones(23), 1e9]}, "a ratio beyond 1e"),
        ({"scale": 0.0}, "scale must be a positive number"),
        ({"scale": np.nan}, "scale must be a positive number"),
        ({"scale": 9e-99}, r"scale is 9e-99; give one between 1e-15 and 1e\+15"),
    ):
        with pytest.raises(sc.InputError, match=sentence):
            register(rows, **told)


def test_lines_of_a_known_scale_have_it():
    random = np.random.default_rng(3)
    truth = truth_of(random)
    lines = random.uniform(-200, 200, (8, 2, 3))
    found = register(constraints.line_line(lines, truth @ lines), scale=truth.scale)
    assert found.target_from_source.scale == truth.scale
    np.testing.assert_allclose(found.target_from_source.matrix, truth.matrix, atol=1e-6)


@pytest.mark.parametrize("seed", range(30))
def test_seven_rows_have_the_truth_among_their_answers(seed):
    random = np.random.default_rng(seed)
    truth = truth_of(random)
    points, normals = random.uniform(-200, 200, (7, 3)), random.normal(size=(7, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    planes = np.column_stack([normals, -np.einsum("ni,ni->n", normals, truth @ points)])
    found = register(constraints.point_plane(points, planes))
    answers = (found.target_from_source, *found.alternatives)
    assert min(np.abs(one @ points - truth @ points).max() for one in answers) < 1e-4


@pytest.mark.parametrize("seed", range(10))
def test_many_rows_have_one_answer(seed):
    assert register(mix(seed, count=30)[0]).alternatives == ()


@pytest.mark.parametrize("seed", range(8))
def test_lines_that_are_nearly_parallel_have_two_answers(seed):
    """The image tilted forwards and backwards against them: lines that spread by a degree do not tell."""
    random = np.random.default_rng(seed)
    truth = truth_of(random)
    points = np.column_stack([random.uniform(0, 500, (20, 2)), np.zeros(20)])
    at = truth @ points + random.normal(size=(20, 3))
    along = 200 * (truth.rotation @ [0.8, 0.2, 1.0] + 0.02 * random.normal(size=(20, 3)))
    found = register(constraints.point_line(points, np.stack([at - along, at + along], axis=1)))
    (other,) = found.alternatives
    assert np.abs(other @ points - found.target_from_source @ points).max() > 5
