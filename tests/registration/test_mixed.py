"""The likelihood of points, lines and planes in any mix."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sonocal import _core
from sonocal import registration as reg
from sonocal.errors import InputError
from sonocal.geometry import Similarity
from sonocal.registration.mixed import maximise
from sonocal.registration.options import Options
from sonocal.registration.rows import to_core
from sonocal.registration.spanned import SpannedRows
from sonocal.registration.told import Told
from tests.builders.spanned_scenes import KINDS, scene

SEEDS = st.integers(0, 2**32 - 1)
LEVELS = {"sigma_px": 1.0, "sigma_mm": 1.0}
MIXES = [*[(kind,) for kind in KINDS], ("point", "line", "plane"), ("point on line", "line on plane")]
FLAT = [("point",), ("point on line",), ("line on plane",), ("point", "point on line", "line on plane")]
EACH = [*[(mix, False) for mix in MIXES], *[(mix, True) for mix in FLAT]]


def fitted(rows, start, told=None, **options):
    found = maximise(rows, start, Options.of(threshold_mm=np.inf, **options), told or Told())
    assert found is not None
    return found


def weighed_residuals(rows: SpannedRows, similarity: Similarity, px: float, mm: float) -> np.ndarray:
    """Residuals over their deviations, whose covariance is found by moving every number that has noise."""
    flat, out = rows.dimension == 2, []
    for c, (begin, end) in enumerate(zip(rows.first[:-1], rows.first[1:], strict=True)):
        spans = int(rows.spans[c])
        points, corners = rows.points[begin:end], rows.spanning[c, :spans]
        across = np.linalg.svd(corners[1:] - corners[0], full_matrices=True)[2][spans - 1 :]

        def of(numbers, seen=points.shape, spans=spans, across=across):
            there = similarity @ numbers[: seen[0] * 3].reshape(seen)
            spanning = numbers[seen[0] * 3 :].reshape(spans, 3)
            hull = (spanning[1:] - spanning[0]).T
            away = there - spanning[0]
            if spans > 1:
                away = away - (hull @ np.linalg.lstsq(hull, away.T, rcond=None)[0]).T
            return (away @ across.T).reshape(-1)

        numbers, step = np.concatenate([points.reshape(-1), corners.reshape(-1)]), 1e-4
        by = np.array([(of(numbers + e) - of(numbers - e)) / (2 * step) for e in step * np.eye(len(numbers))])
        sigma = np.concatenate(
            [np.tile([px, px, 0.0 if flat else px], len(points)), np.full(corners.size, mm)]
        )
        covariance = (by * sigma[:, None] ** 2).T @ by
        out.append(np.linalg.solve(np.linalg.cholesky(covariance), of(numbers)))
    return np.concatenate(out)


@pytest.mark.parametrize(("mix", "flat"), EACH)
def test_what_noise_makes_of_residuals_is_what_moving_every_number_finds(mix, flat):
    truth, rows = scene(mix, 9, 5, flat=flat)
    found = fitted(rows, truth, **LEVELS)
    at = found.transform
    start = np.concatenate([np.zeros(3), at.translation, [np.log(at.scale)]])

    def residuals(v):
        turned = Rotation.from_rotvec(v[:3]).as_matrix() @ at.rotation
        return weighed_residuals(rows, Similarity(turned, v[3:6], float(np.exp(v[6]))), 1.0, 1.0)

    best = least_squares(residuals, start, x_scale=[1e-3, 1e-3, 1e-3, 1, 1, 1, 1e-3], xtol=1e-8, ftol=1e-8)
    # SciPy's answer is ours to a part of what the data leave open.
    deviations = np.sqrt(np.diag(found.covariance.matrix))
    assert np.all(np.abs(best.x - start) < 0.1 * deviations)
    theirs = np.linalg.inv(best.jac.T @ best.jac)
    np.testing.assert_allclose(np.sqrt(np.diag(theirs)), deviations, rtol=0.08)
    assert found.covariance.freedom == np.inf


@pytest.mark.parametrize("flat", [False, True])
def test_of_lines_it_is_the_likelihood_of_needles(flat):
    truth, rows = scene(["point on line"] if flat else ["line"], 15, 3, flat=flat)
    lines = reg.point_line if flat else reg.line_line
    points = rows.points if flat else rows.points.reshape(-1, 2, 3)
    table = lines(points, rows.spanning[:, :2]).lines  # of strided arrays, too
    chosen, at = np.ones(len(table), dtype=bool), to_core(truth)
    theirs = _core.refine(table.core, chosen, at, Options().to_core(1.0, 1.0))
    ours = fitted(rows, truth, **LEVELS)
    np.testing.assert_allclose(ours.transform.rotation, theirs.rotation, atol=1e-9)
    np.testing.assert_allclose(ours.transform.translation, theirs.translation, atol=1e-7)
    np.testing.assert_allclose(ours.covariance.matrix, theirs.covariance, rtol=1e-6, atol=1e-14)
    levels = _core.refine(table.core, chosen, at, Options().to_core(0, 0))
    found = _core.maximise(rows.core, at, Options.of(threshold_mm=np.inf).to_core(0, 0))
    np.testing.assert_allclose(
        [found.level_px, found.level_mm], [levels.level_px, levels.level_mm], rtol=1e-4
    )


@given(seed=SEEDS, mix=st.sampled_from(MIXES))
@settings(max_examples=25)
def test_it_moves_with_the_target_and_with_units(seed, mix):
    truth, rows = scene(mix, 10, seed)
    found = fitted(rows, truth)
    turn = Similarity(Rotation.from_rotvec([0.3, -1.0, 0.5]).as_matrix(), np.array([50.0, -20, 400]), 10.0)
    moved = SpannedRows(rows.points, rows.first, turn @ rows.spanning, rows.spans)
    again = fitted(moved, turn @ truth)
    corners = np.array([[0.0, 0, 0], [500, 0, 0], [0, 500, 0], [250, 250, 500]])
    sure = 10 * np.sqrt(np.trace(found.covariance.matrix[3:6, 3:6]))
    np.testing.assert_allclose(
        again.transform @ corners, turn @ (found.transform @ corners), atol=1e-3 * sure
    )
    np.testing.assert_allclose(again.residuals_mm, 10 * found.residuals_mm, rtol=1e-3, atol=1e-3)


@given(seed=SEEDS, mix=st.sampled_from(MIXES))
@settings(max_examples=25)
def test_without_noise_it_is_exact_and_sure(seed, mix):
    truth, rows = scene(mix, 8, seed, px=0.0, mm=0.0)
    nudged = Similarity(
        Rotation.from_rotvec([1e-3, -1e-3, 2e-3]).as_matrix() @ truth.rotation,
        truth.translation + 0.3,
        truth.scale * 1.002,
    )
    found = fitted(rows, nudged)
    np.testing.assert_allclose(found.transform.matrix, truth.matrix, atol=1e-6)


@given(seed=SEEDS)
@settings(max_examples=10)
def test_a_scale_that_is_known_stays_and_leaves_the_rest_surer(seed):
    truth, rows = scene(["point on line", "line on plane"], 10, seed)
    free, known = fitted(rows, truth, **LEVELS), fitted(rows, truth, scale_mm_per_px=0.24, **LEVELS)
    assert float(known.transform.scale) == 0.24
    np.testing.assert_array_equal(known.covariance.matrix[6], 0.0)
    least = np.linalg.eigvalsh(free.covariance.matrix[:6, :6] - known.covariance.matrix[:6, :6])[0]
    assert least > -0.02 * np.linalg.norm(free.covariance.matrix)


@given(seed=SEEDS)
@settings(max_examples=10)
def test_of_sightings_that_are_ten_times_worse_it_takes_little(seed):
    truth, rows = scene(["point", "plane"], 12, seed)
    weights = np.where(np.arange(len(rows)) % 2 == 0, 1.0, 0.1)
    found, good = fitted(rows, truth, Told(weights=weights)), fitted(rows.select(weights == 1.0), truth)
    apart = np.abs(found.transform.translation - good.transform.translation)
    assert np.all(apart < 0.5 * np.sqrt(np.diag(good.covariance.matrix)[3:6]))


def test_the_levels_of_many_sightings_are_those_of_the_noise():
    truth, rows = scene(["point on line", "plane"], 2000, 1, px=2.0, mm=0.5)
    found = _core.maximise(rows.core, to_core(truth), Options.of(threshold_mm=np.inf).to_core(0, 0))
    np.testing.assert_allclose([found.level_px, found.level_mm], [2.0, 0.5], rtol=0.03)


def test_strangers_are_left_out_and_the_answer_is_certified():
    truth, rows = scene(["point", "plane"], 20, 2)
    strange = rows.spanning.copy()
    strange[:20:5] += [40.0, -30.0, 60.0]
    away = np.cross(strange[20:, 1] - strange[20:, 0], strange[20:, 2] - strange[20:, 0])
    strange[20::5] += 30 * (away / np.linalg.norm(away, axis=1, keepdims=True))[::5, None]
    mix = reg.rows(
        reg.point_point(rows.points[:20], strange[:20, 0]),
        reg.plane_plane(rows.points[20:].reshape(-1, 3, 3), strange[20:]),
    )
    found = reg.register(mix, threshold_mm=6.0)
    assert not found.inlier[::5].any()
    assert found.inlier.sum() >= 30
    assert found.certificate == "optimal"
    apart = np.abs(found.target_from_source.translation - truth.translation)
    assert np.all(apart < 5 * np.sqrt(np.diag(found.covariance)[3:6]))


def test_a_target_that_its_points_do_not_span_is_refused():
    points = np.random.default_rng(0).uniform(0, 500, (9, 3))
    flat = np.tile(np.array([[0.0, 0, 0], [1, 1, 1], [2, 2, 2]]), (9, 1, 1)) + points[:, None]
    with pytest.raises(InputError, match="a plane needs a normal"):
        reg.register(reg.point_plane(points, flat))


def test_of_lengths_far_below_their_noise_no_covariance_is_made_up():
    truth, rows = scene(["point", "line", "plane"], 4, 1)
    tiny = SpannedRows(rows.points, rows.first, 1e-9 * rows.spanning, rows.spans)
    at = Similarity(truth.rotation, 1e-9 * truth.translation, 1e-9 * truth.scale)
    found = maximise(tiny, at, Options.of(threshold_mm=np.inf, **LEVELS), Told())
    if found is not None and found.covariance is not None:
        assert np.linalg.eigvalsh(found.covariance.matrix)[0] >= 0
