"""Noise along the image's normal is seen where lines lean, and makes a covariance as much larger as it makes errors."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sonocal.geometry import Similarity
from sonocal.registration.mapped import MappedRows
from sonocal.registration.off_plane import off_plane_noise
from sonocal.registration.options import Options
from sonocal.registration.refine import refine_point_lines
from sonocal.registration.rows import PointLineRows
from sonocal.registration.whitened import whitened

SCALE, COUNT = 0.3, 150


def scan(seed, off_px, px=0.5, mm=0.1, dimension=2):
    """Lines that lean by up to 60 deg, and dots that lie off the image by so much along its normal; the truth."""
    rng = np.random.default_rng(seed)
    truth = Similarity(Rotation.random(random_state=rng).as_matrix(), rng.uniform(-80, 80, 3), SCALE)
    points = np.column_stack([rng.uniform(0, 300, (COUNT, 2)), np.zeros(COUNT)])
    lean = np.tan(np.radians(rng.uniform(0, 60, COUNT)))[:, None] * unit(rng.normal(size=(COUNT, 2)))
    ways = unit(np.column_stack([lean, np.ones(COUNT)]))
    ends = points[:, None] + np.array([[-250.0], [250.0]]) * ways[:, None]
    seen = points + np.column_stack([px * rng.normal(size=(COUNT, 2)), np.zeros(COUNT)])
    seen[:, :2] += off_px * rng.normal(size=(COUNT, 1)) * lean
    segments = truth.apply(ends.reshape(-1, 3)).reshape(-1, 2, 3) + mm * rng.normal(size=(COUNT, 2, 3))
    return PointLineRows(seen, segments, dimension), truth


def unit(vectors):
    """Of length one."""
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def found_in(rows, truth):
    """The fit near the truth, its noise levels, and the noise off its plane."""
    fit = refine_point_lines(truth, rows, None, Options.of())
    levels = fit.sigma_px, fit.sigma_mm
    mapped, every = MappedRows(fit.transform, rows), np.ones(COUNT, dtype=bool)
    return fit, levels, off_plane_noise(mapped, every, levels, len(fit.covariance))


def test_its_size_is_found():
    sizes = [found_in(*scan(seed, 2.0))[-1].sigma_px for seed in range(40)]
    assert np.sqrt(np.mean(np.square(sizes))) == pytest.approx(2.0, rel=0.1)


def test_where_there_is_none_it_is_rarely_seen():
    scores = [found_in(*scan(seed, 0.0))[-1].score for seed in range(80)]
    assert np.mean(np.array(scores) > 2.0) <= 0.1
    assert abs(np.mean(scores)) < 0.5


def test_errors_are_as_large_as_the_wider_covariance_says():
    squares, kept = [], [0, 1, 2, 6]  # turn and scale: where the origin lies is far from the image
    for seed in range(150):
        rows, truth = scan(seed, 2.0)
        fit, levels, off = found_in(rows, truth)
        turn = Rotation.from_matrix(fit.transform.rotation @ truth.rotation.T).as_rotvec()
        error = np.append(turn, np.log(fit.transform.scales[0] / SCALE))
        covariance = white_variance(rows, fit, levels) * fit.covariance + off.covariance
        squares.append(error @ np.linalg.solve(covariance[np.ix_(kept, kept)], error))
    assert np.mean(squares) == pytest.approx(4.0, rel=0.2)


def white_variance(rows, fit, levels):
    """Of residuals in units of the levels, beside the fit."""
    mapped = MappedRows(fit.transform, rows)
    white = whitened(mapped, np.arange(COUNT), mapped.residuals[:, :, None], levels)
    return np.sum(white**2) / (2 * COUNT - 7)


def test_no_direction_gets_surer():
    for seed in range(10):
        off = found_in(*scan(seed, 1.0))[-1]
        values = np.linalg.eigvalsh(off.covariance / np.outer(*[np.sqrt(np.diag(off.covariance))] * 2))
        assert values.min() > -1e-9


def test_of_a_volume_nothing_is_said():
    rows, truth = scan(0, 1.0)
    volume = PointLineRows(rows.points, rows.segments_mm, 3)
    assert off_plane_noise(MappedRows(truth, volume), np.ones(COUNT, dtype=bool), (0.5, 0.1), 7) is None


def test_of_few_rows_nothing_is_said():
    rows, truth = scan(0, 1.0)
    few = np.arange(COUNT) < 8
    assert off_plane_noise(MappedRows(truth, rows), few, (0.5, 0.1), 7) is None
