"""How a calibration would have to move for the lines of a short sweep to agree with it, by generalised least squares.

    r_i = -B_i (J_i d + e_i)
    cov(e_i, e_j) = w^2 [i = j] + f^2 [one frame] + g^2 [one target] + s^2 exp(-|t_i - t_j| / m)

`B` are two directions across each line. Ten seconds do not tell what their neighbouring frames share: a tracker's error
that is forgotten in half a second leaves twenty independent ones, and no test sees it in them. So the levels are those
that the calibration's own, longer scan showed, unless the sweep shows more. A motion that no row sees keeps what is
assumed of it, and is known to be unknown.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sonocal.calibration import Calibration, point_line_rows
from sonocal.calibration.groupings import groupings_of
from sonocal.geometry import Array, AxisScaled, area_places, homogeneous_points, segment_directions
from sonocal.observations import Observations, group_codes
from sonocal.registration.noise import Noise, residual_vectors, stretch_length
from sonocal.registration.uncertainty import point_jacobian

__all__ = ["MotionOfRows", "motion_of_rows"]

# So far a calibration may have moved before anything is seen of it, mm rms over the image.
FAR_MM = 100.0
FEWEST, MOST = 10, 800
ROUNDS, CUT = 4, 3.5
MEDIAN_2D = 1.1774
"""The median length of a normal vector of two numbers, in deviations."""


class MotionOfRows(NamedTuple):
    """The motion (k,), its covariance (k, k) by the sweep, the residuals to spare, and the rows that agree."""

    tangent: Array
    covariance: Array
    freedom: float
    rows: int


class _System(NamedTuple):
    """Residuals (N, 2) across the lines, their derivatives (N, 2, k), and the two directions (N, 2, 3)."""

    left: Array
    jacobian: Array
    across: Array

    def at(self, kept: NDArray[np.bool_]) -> _System:
        return _System(self.left[kept], self.jacobian[kept], self.across[kept])


def motion_of_rows(
    calibration: Calibration, sweep: Observations, begin: AxisScaled | None = None
) -> MotionOfRows:
    """The motion from `begin` with which most of a sweep of lines agrees.

    Args:
        calibration: of which the noise is known.
        sweep: the lines and where they were seen.
        begin: what most of the sweep agrees with; default: the calibration.
    """
    transform = begin or calibration.probe_from_image
    assert calibration.covariance is not None
    k = len(calibration.covariance)
    prior = _prior(calibration, k)
    nothing = MotionOfRows(np.zeros(k), np.asarray(np.linalg.inv(prior)), 0.0, 0)
    if len(sweep) > MOST:  # of more, every so many tell as much: neighbours share their errors
        sweep = sweep.select(np.arange(0, len(sweep), 1 + len(sweep) // MOST))
    system = _system(transform, sweep, k)
    kept = np.linalg.norm(system.left, axis=1) <= calibration.threshold_mm
    for _ in range(ROUNDS):
        if kept.sum() < FEWEST:
            return nothing
        rest = system.left + system.jacobian @ _plain(system.at(kept), prior)
        kept = np.linalg.norm(rest, axis=1) <= CUT * _spread(rest[kept])
    if kept.sum() < FEWEST:
        return nothing
    return _weighed(system.at(kept), sweep.select(np.flatnonzero(kept)), calibration.noise, prior)


def _weighed(system: _System, rows: Observations, noise: Noise, prior: Array) -> MotionOfRows:
    """The motion under the errors that rows share."""
    k = len(prior)
    flat, right = system.jacobian.reshape(-1, k), -system.left.reshape(-1)
    variance = _variance(system, rows, noise)
    factor = np.linalg.cholesky(variance)
    white = np.linalg.solve(factor, np.column_stack([flat, right]))
    design, told = white[:, :k], white[:, k]
    tangent = np.asarray(np.linalg.solve(design.T @ design + prior, design.T @ told))
    freedom = float(len(told) - np.linalg.matrix_rank(flat))
    # A sweep whose rows are noisier than the calibration's is less sure; none is surer, for what it shares is not seen.
    excess = max(float(np.sum((told - design @ tangent) ** 2)) / max(freedom, 1.0), 1.0)
    rest = (system.left + system.jacobian @ tangent)[:, None] @ system.across
    if noise.drift is None:
        excess *= _repeats(rest[:, 0], rows)
    else:
        freedom = min(freedom, 2 * noise.drift.stretches)
    covariance = np.linalg.inv(design.T @ design / excess + prior)
    return MotionOfRows(tangent, np.asarray(covariance), max(freedom, 0.0), len(rows))


def _variance(system: _System, rows: Observations, noise: Noise) -> Array:
    """(2 N, 2 N), mm^2: of the residuals."""
    table = point_line_rows(rows)
    time = groupings_of(table, rows).time
    shared = noise.shared_mm
    count = len(rows)
    common = np.zeros((count, count))
    if noise.drift is not None:
        apart = np.abs(time[:, None] - time)
        common += shared["stretch"] ** 2 * np.exp(-apart / max(noise.drift.memory_frames, 1e-3))
    for name, codes in (("frame", table.frame), ("target", table.target)):
        assert codes is not None
        common += shared.get(name, 0.0) ** 2 * (codes[:, None] == codes)
    turned = np.einsum("iak,jbk->iajb", system.across, system.across)
    joint = (turned * common[:, None, :, None]).reshape(2 * count, 2 * count)
    own = noise.row_mm if noise.row_mm > 0 else _spread(system.left)
    return np.asarray(joint + own**2 * np.eye(2 * count))


def _repeats(vectors: Array, rows: Observations) -> int:
    frame = group_codes(rows.split, rows.frame)
    order = np.argsort(frame, kind="stable")
    return stretch_length(vectors[order], frame[order])


def _system(transform: AxisScaled, rows: Observations, k: int) -> _System:
    points = homogeneous_points(rows.points_px)
    along = segment_directions(rows.segments_mm)
    across = np.linalg.svd(along[:, None])[2][:, 1:]
    left = residual_vectors(transform, points, rows.segments_mm)
    jacobian = point_jacobian(transform, points, k)
    return _System(np.einsum("nij,nj->ni", across, left), across @ jacobian, across)


def _plain(system: _System, prior: Array) -> Array:
    """(k,): the motion if all rows were alike."""
    k = len(prior)
    flat, right = system.jacobian.reshape(-1, k), -system.left.reshape(-1)
    weight = 1 / _spread(system.left) ** 2
    return np.asarray(np.linalg.solve(weight * flat.T @ flat + prior, weight * flat.T @ right))


def _prior(calibration: Calibration, k: int) -> Array:
    """(k, k): the information that a motion is no larger than `FAR_MM` over the image."""
    jacobian = point_jacobian(calibration.probe_from_image, area_places(calibration.area_px), k)
    metric = np.einsum("nik,nil->kl", jacobian, jacobian) / len(jacobian)
    return np.asarray(metric / FAR_MM**2 + 1e-12 * np.eye(k))


def _spread(vectors: Array) -> float:
    """Standard deviation per axis across a line, from the median length."""
    return max(float(np.median(np.linalg.norm(vectors, axis=1))) / MEDIAN_2D, 1e-6)
