"""The covariance of a mix: that of dense algebra, and as large as errors are."""

import warnings

import numpy as np
import pytest
from benchmarks.simulators.mixes import Noise, mix_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.stats import t as students

from sonocal import registration as reg
from sonocal.errors import DegenerateGeometryError
from sonocal.registration.mix_covariance import covariance_of_mix, tangent_rows
from tests.builders.mixes import errors_of, rows_of
from tests.builders.similarities import random_similarity

SEEDS = st.integers(0, 2**20)


def dense_parts(rows: reg.Rows) -> list[np.ndarray]:
    """The projections as matrices (N, N)."""
    blocks: dict[tuple, np.ndarray] = {}
    for begin, end in zip(rows.first[:-1], rows.first[1:], strict=True):
        points, normals = rows.points[begin:end], rows.planes[begin:end, :3]
        kind = (end - begin, len(np.unique(points, axis=0)))
        alike = np.all(normals[:, None] == normals[None], axis=2)
        mean = alike / alike.sum(axis=1, keepdims=True)
        for part, block in (("mean", mean), ("rest", np.eye(end - begin) - mean)):
            blocks.setdefault((kind, part), np.zeros((len(rows),) * 2))[begin:end, begin:end] = block
    return [block for block in blocks.values() if block.any()]


@given(SEEDS)
@settings(max_examples=5, deadline=None)
def test_levels_are_those_of_the_restricted_likelihood(seed):
    rows = rows_of(mix_of({"line_line": 12, "plane_plane": 14, "point_plane": 20}, seed))
    found = reg.register(rows, robust=False)
    design, residuals, to_origin = tangent_rows(rows.points, rows.planes, found.target_from_source)
    parts = dense_parts(rows)
    size = residuals @ residuals / (len(rows) - 7)

    def deviance(logs):
        sigma = size * np.einsum("l,lij->ij", np.exp(logs), parts)
        inverse = np.linalg.inv(sigma)
        information = design.T @ inverse @ design
        left = residuals - design @ np.linalg.solve(information, design.T @ inverse @ residuals)
        return np.linalg.slogdet(sigma)[1] + np.linalg.slogdet(information)[1] + left @ inverse @ left

    logs = minimize(deviance, np.zeros(len(parts))).x
    bread = np.linalg.inv(design.T @ design) @ design.T
    meat = bread @ (size * np.einsum("l,lij->ij", np.exp(logs), parts)) @ bread.T
    expected = to_origin @ meat @ to_origin.T
    np.testing.assert_allclose(np.diag(found.covariance), np.diag(expected), rtol=0.01)


@pytest.mark.parametrize(
    "kinds", [{"plane_plane": 12}, {"line_plane": 14}, {"point_point": 4, "plane_plane": 8}]
)
def test_errors_are_as_large_as_stated(kinds):
    shares = []
    for seed in range(60):
        mix = mix_of(kinds, seed, Noise(0.1, 0.3))
        found = reg.register(rows_of(mix), robust=False)
        sizes = np.abs(errors_of(found.target_from_source, mix.truth)) / np.sqrt(np.diag(found.covariance))
        shares.append(np.mean(sizes < students.ppf(0.975, found.freedom)))
    assert 0.91 < np.mean(shares) < 0.99


@given(SEEDS)
@settings(max_examples=15)
def test_the_error_of_a_point_does_not_depend_on_where_the_origin_is(seed):
    mover = random_similarity(seed % 997, scale=1.0)
    rows = rows_of(mix_of({"point_plane": 10, "line_line": 4}, seed))
    there = reg.Rows(mover @ rows.points, rows.planes, rows.first)
    place = np.array([30.0, -20.0, 50.0])
    spreads = []
    for one, at in ((rows, place), (there, mover @ place)):
        found = reg.register(one, robust=False)
        arm = found.target_from_source @ at - found.target_from_source.translation
        x, y, z = arm
        jacobian = np.column_stack([[[0, z, -y], [-z, 0, x], [y, -x, 0]], np.eye(3), arm])
        spreads.append(jacobian @ found.covariance @ jacobian.T)
    np.testing.assert_allclose(spreads[1], spreads[0], rtol=1e-4, atol=1e-9)


def test_no_row_to_spare_gives_none_and_no_residual_gives_zero():
    rows = rows_of(mix_of({"point_plane": 7}, 3))
    found = reg.register(rows)
    assert found.covariance is None
    assert found.freedom == 0
    exact = rows_of(mix_of({"point_plane": 12}, 3, Noise(0.0, 0.0)))
    found = reg.register(exact)
    assert found.freedom == 5
    assert np.all(np.sqrt(np.diag(found.covariance)) < 1e-9)


def test_points_that_are_all_at_the_origin_leave_a_turn_free_without_a_warning():
    random = np.random.default_rng(0)
    planes = np.column_stack([random.normal(size=(9, 3)), random.normal(size=9)])
    with warnings.catch_warnings(), pytest.raises(DegenerateGeometryError):
        warnings.simplefilter("error")
        reg.register(reg.point_plane(np.zeros((9, 3)), planes), robust=False)


def test_rows_that_agree_and_leave_a_motion_free_have_no_covariance():
    rows = rows_of(mix_of({"point_plane": 12}, 1))
    still = np.zeros_like(rows.points)
    at = reg.register(rows).target_from_source
    assert covariance_of_mix(still, rows.planes, rows.first, at) is None
