"""An error that neighbours in pose share: its likelihood by hand, its covariance by simulation, laws of frames."""

import numpy as np
import pytest
from benchmarks.simulators.trust_faults import distortion
from benchmarks.simulators.trust_judge import table
from benchmarks.simulators.trust_scans import sound
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

import sonocal as sc
from sonocal.calibration import point_line_rows
from sonocal.registration.mapped import MappedRows
from sonocal.registration.smooth_error import smooth_error
from sonocal.registration.uncertainty import point_jacobian

PARAMETERS = 7


class Scene:
    """A calibrated scan with its poses, and the linear model that it is by hand."""

    def __init__(self, scan):
        rows = table(scan)
        found = sc.calibrate(rows, image_size_px=(500, 500))
        self.mapped = MappedRows(found.probe_from_image, point_line_rows(rows))
        self.chosen = found.inlier
        self.rotations = np.swapaxes(scan.tracker_from_probe[:, :3, :3], 1, 2)
        self.places = np.concatenate([scan.ends_mm.reshape(-1, 6), scan.tracker_from_probe[:, :3, 3]], axis=1)

    def smooth(self, **changed):
        given = {"places": self.places, "rotations": self.rotations} | changed
        return smooth_error(
            self.mapped, self.chosen, given.pop("places"), given.pop("rotations"), PARAMETERS, **given
        )

    def model(self, length):
        """Residuals (3 N,), design (3 N, k) and the covariance (3 N, 3 N) of a smooth error of unit variance."""
        rows = np.flatnonzero(self.chosen)
        across = np.eye(3) - np.einsum("ni,nj->nij", *[self.mapped.directions[rows]] * 2)
        jacobian = point_jacobian(self.mapped.transform, self.mapped.table.points[rows], PARAMETERS)
        near = np.exp(-(cdist(self.places[rows], self.places[rows]) ** 2) / (2 * length**2))
        turned = (across @ self.rotations[rows]).reshape(-1, 3)
        kernel = turned @ turned.T * np.kron(near, np.ones((3, 3)))
        projector = np.zeros((3 * len(rows), 3 * len(rows)))
        for i, part in enumerate(across):
            projector[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] = part
        return (
            self.mapped.residuals[rows].reshape(-1),
            (across @ jacobian).reshape(-1, PARAMETERS),
            kernel,
            projector,
        )


def restricted(residuals, design, covariance):
    """Twice the restricted likelihood's logarithm but for a constant, of a covariance that is singular along lines.

    By pseudo-inverse and pseudo-determinant, where what is tested takes contrasts.
    """
    values, vectors = np.linalg.eigh(covariance)
    seen = values > 1e-9 * values.max()
    root = vectors[:, seen] / np.sqrt(values[seen])
    y, x = root.T @ residuals, root.T @ design
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    return -np.log(values[seen]).sum() - np.linalg.slogdet(x.T @ x)[1] - left @ left


def scene(seed, millimetres=1.5, frames=60):
    scan = distortion(seed, millimetres, still=True).scan
    return Scene(scan.rows(np.arange(frames)))


@pytest.mark.parametrize("seed", range(3))
def test_the_gain_is_that_of_the_restricted_likelihood(seed):
    at = scene(seed)
    found = at.smooth()
    residuals, design, kernel, own = at.model(found.length)
    count = 2 * at.chosen.sum() - PARAMETERS
    alone = residuals @ residuals - residuals @ design @ np.linalg.lstsq(design, residuals, rcond=None)[0]
    with_it = restricted(residuals, design, found.own_mm**2 * own + found.sigma_mm**2 * kernel)
    assert found.gain == pytest.approx(with_it - restricted(residuals, design, alone / count * own), abs=1e-6)
    for factor in (0.7, 1.4):
        for changed in ((factor, 1.0), (1.0, factor)):
            levels = np.array([found.own_mm, found.sigma_mm]) * changed
            other = restricted(residuals, design, levels[0] ** 2 * own + levels[1] ** 2 * kernel)
            assert other < with_it


def test_the_covariance_is_that_of_fits_to_such_errors():
    at = scene(1)
    found = at.smooth()
    _, design, kernel, _ = at.model(found.length)
    values, vectors = np.linalg.eigh(kernel)
    errors = (
        vectors
        * np.sqrt(np.maximum(values, 0.0))
        @ np.random.default_rng(0).normal(size=(len(values), 20_000))
    )
    fitted = found.sigma_mm * np.linalg.lstsq(design, errors, rcond=None)[0]
    size = np.sqrt(np.diag(found.covariance))
    np.testing.assert_allclose(
        np.cov(fitted) / np.outer(size, size), found.covariance / np.outer(size, size), atol=0.05
    )


@settings(max_examples=10)
@given(st.integers(0, 10**6))
def test_where_the_tracker_stands_changes_nothing(seed):
    at, rng = scene(2), np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.uniform(-1e3, 1e3, 3)
    moved = (at.places.reshape(-1, 3, 3) @ turn.T + shift).reshape(-1, 9)
    one, other = at.smooth(), at.smooth(places=moved, rotations=at.rotations @ turn.T)
    assert other.gain == pytest.approx(one.gain, rel=1e-6)
    np.testing.assert_allclose(other.covariance, one.covariance, rtol=1e-5, atol=1e-12)


def test_in_what_unit_places_are_changes_nothing_but_the_length():
    at = scene(2)
    one, other = at.smooth(), at.smooth(places=at.places / 25.4)
    assert other.length == pytest.approx(one.length / 25.4)
    assert (other.gain, other.sigma_mm) == pytest.approx((one.gain, one.sigma_mm))


def test_places_that_mean_nothing_explain_nothing():
    """Errors that go together in pose do so no more where poses are another row's."""
    rng, at = np.random.default_rng(0), scene(3)
    assert at.smooth().gain > 15
    orders = [rng.permutation(len(at.places)) for _ in range(20)]
    mixed = [at.smooth(places=at.places[order], rotations=at.rotations[order]) for order in orders]
    assert np.median([0.0 if one is None else one.gain for one in mixed]) < 4


def test_sound_scans_have_none():
    gains = [Scene(sound(seed, 60, still=bool(seed % 2))).smooth() for seed in range(100)]
    assert sum(one is not None and one.gain > 5 for one in gains) <= 8  # by chance 3
    assert sum(one is not None and one.gain > 10 for one in gains) <= 1


def test_what_a_drift_explains_is_no_smooth_error():
    """A sweep comes by the same pose at the same time: what neighbours in time share is not counted twice."""
    scan = sound(4, 120)
    walk = np.cumsum(np.random.default_rng(0).normal(0, 0.2, (120, 3)), axis=0)
    at = Scene(scan.with_segments(scan.segments_mm() + walk[:, None]))
    time = np.arange(120.0)
    alone, beside = at.smooth(), at.smooth(drift=(time, 30.0, 3.0))
    assert alone.gain > 20
    assert beside.gain < 5


def test_few_rows_say_nothing():
    assert scene(0, frames=20).smooth() is None
