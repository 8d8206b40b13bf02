"""One scale for each axis of a volume: no model that is offered, but a test of the one that is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, AxisScaled
from sonocal.registration.fit import Fit, away_from_lines
from sonocal.registration.mapped import MappedTargets
from sonocal.registration.rows import PointLineRows
from sonocal.registration.target_rows import TargetRows
from sonocal.registration.whitened import HUBER, across_lines
from sonocal.registration.whitened_targets import whitened_targets

__all__ = ["AxisScales", "axis_scales"]

PARAMETERS = 9  # a turn, a shift, three scales
STEPS = 4  # of Gauss-Newton, from an answer that is near: an error of 10 % is a thousandth after two
LONGEST = 0.5  # of a step in a scale's logarithm: twice is no stretch but another answer
LEAST_SHARE = 1e-3
# Groups of rows of which fewer say nothing of how far they err together.
FEWEST_GROUPS = 12


@dataclass(frozen=True, eq=False)
class AxisScales:
    """Scales along u, v and w that fit the rows best.

    Attributes:
        transform: with them, mm from px.
        covariance: (3, 3), of their logarithms.
        freedom: residuals to spare behind it.
    """

    transform: AxisScaled
    covariance: Array
    freedom: int

    @property
    def scales(self) -> Array:
        """(3,), mm per px."""
        return self.transform.scales

    @property
    def p_value(self) -> float:
        """How often three equal scales would come out as unequal as these: F of two contrasts."""
        from scipy.special import fdtrc

        contrast = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
        unequal = contrast @ np.log(self.scales)
        spread = contrast @ self.covariance @ contrast.T
        return float(fdtrc(2, self.freedom, unequal @ np.linalg.solve(spread, unequal) / 2.0))


def axis_scales(
    rows: PointLineRows | TargetRows, fit: Fit, groupings: dict[str, NDArray[np.int64]]
) -> AxisScales | None:
    """The scales of the agreeing rows of a volume, under the noise that the fit found.

        d(R D x + t) = w x (R D x) + v + R D diag(l) x        D = diag(s_u, s_v, s_w)

    Args:
        rows: points of a volume, and their lines or whatever targets.
        fit: with one scale.
        groupings: by name: (N,) the group of each row; what rows share widens the covariance.

    Returns:
        None where too few rows agree to tell.

    Source: Gauss-Newton on whitened residuals; clusters: Cameron and Miller 2015, section II.
    """
    table, labels = rows.select(fit.inlier), [one[fit.inlier] for one in groupings.values()]
    if rows.residuals(fit.inlier) - PARAMETERS < 2:
        return None
    rotation, scales, shift = (
        fit.transform.rotation,
        np.array(fit.transform.scales),
        fit.transform.translation,
    )
    for _ in range(STEPS):
        jacobian, residuals, of_row = _whitened(table, fit, AxisScaled(rotation, shift, scales))
        step = np.linalg.lstsq(jacobian, -residuals, rcond=None)[0]
        rotation, shift = _turned(np.asarray(step[:3])) @ rotation, shift + step[3:6]
        scales = scales * np.exp(np.clip(step[6:], -LONGEST, LONGEST))
    found = AxisScaled(rotation, shift, scales)
    return _least_sure(found, jacobian, residuals + jacobian @ step, [one[of_row] for one in labels])


def _whitened(
    table: PointLineRows | TargetRows, fit: Fit, transform: AxisScaled
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Derivatives (M, 9) and residuals (M,) of unit variance, sighting by sighting, and a row of each (M,)."""
    if isinstance(table, TargetRows):
        mapped, every = MappedTargets(transform, table), np.ones(len(table), dtype=bool)
        columns = np.concatenate([_columns(table.points, transform), mapped.residuals[:, :, None]], axis=2)
        white = whitened_targets(mapped, every, columns, fit.levels)
        return white.values[:, :-1], white.values[:, -1], white.row
    assert table.sightings is not None
    order = np.argsort(table.sightings, kind="stable")
    flat = _whitened_lines(table, order, fit, transform)
    return flat[:, :-1], flat[:, -1], np.repeat(order, 2)


def _columns(points: Array, transform: AxisScaled) -> Array:
    """(N, 3, 9): derivatives of mapped points by a turn, a shift and the scales' logarithms."""
    turned = (points * transform.scales) @ transform.rotation.T
    own = points[:, None] * transform.scales * transform.rotation
    return np.concatenate([_cross(turned), np.broadcast_to(np.eye(3), own.shape), own], axis=2)


def _whitened_lines(table: PointLineRows, order: NDArray[np.int64], fit: Fit, transform: AxisScaled) -> Array:
    """(2 N, 10): derivatives and residuals across the lines, row by row in the order given, of unit variance."""
    points, segments = table.points[order], table.segments_mm[order]
    mapped, scales = transform.apply(points), transform.scales
    along = segments[:, 1] - segments[:, 0]
    lengths = np.linalg.norm(along, axis=1)
    across = across_lines(along / lengths[:, None])
    away = away_from_lines(mapped, segments)
    both = across @ np.concatenate([_columns(points, transform), away[:, :, None]], axis=2)  # (N, 2, 10)
    place = np.einsum("ni,ni->n", mapped - segments[:, 0], along) / lengths**2
    level_px, level_mm = _levels(table, fit, order, float(scales.mean()))
    counts = np.bincount(table.sightings[order] if table.sightings is not None else order)
    first = np.cumsum(counts) - counts
    for count in np.unique(counts[counts > 0]):
        rows = first[counts == count][:, None] + np.arange(count)
        ends = np.stack([1.0 - place[rows], place[rows]], axis=-1) * level_mm[rows][..., None]
        spread = ends @ np.swapaxes(ends, 1, 2) + np.eye(count) * (level_px[rows] ** 2)[:, None]
        white = np.linalg.solve(np.linalg.cholesky(spread), both[rows].reshape(len(rows), count, -1))
        white = white.reshape(len(rows), count, 2, PARAMETERS + 1)
        size = np.sqrt(np.mean(white[..., -1] ** 2, axis=(1, 2)))
        both[rows] = white * np.sqrt(np.minimum(1.0, HUBER / np.maximum(size, HUBER)))[:, None, None, None]
    return np.asarray(both.reshape(-1, PARAMETERS + 1))


def _levels(table: PointLineRows, fit: Fit, order: NDArray[np.int64], scale: float) -> tuple[Array, Array]:
    """(N,) and (N,), mm: noise of the points and of the segments' ends; all alike where the fit weighed none."""
    if fit.weighting != "likelihood":
        return np.ones(len(order)), np.zeros(len(order))
    ones = np.ones(len(order))
    px = fit.sigma_px * scale * (ones if table.sigma_px is None else table.sigma_px[order])
    mm = fit.sigma_mm * (ones if table.sigma_mm is None else table.sigma_mm[order])
    # Points without any noise leave nothing to divide by.
    return np.maximum(px, LEAST_SHARE * max(float(mm.mean()), np.finfo(float).tiny)), mm


def _cross(vectors: Array) -> Array:
    """(N, 3, 3): the derivative of w x v by w."""
    return np.asarray(-np.cross(vectors[:, None, :], np.eye(3)))  # columns: e_i x v


def _turned(rotvec: Array) -> Array:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(rotvec).as_matrix())


def _least_sure(
    transform: AxisScaled, jacobian: Array, left: Array, labels: list[NDArray[np.int64]]
) -> AxisScales:
    """The scales with that covariance, of single rows' and of groups', under which they differ least surely."""
    freedom = len(left) - PARAMETERS
    inverse = np.linalg.pinv(jacobian.T @ jacobian)
    found = [AxisScales(transform, (left @ left / freedom * inverse)[6:, 6:], freedom)]
    scores = jacobian * left[:, None]
    for label in labels:
        codes = np.unique(label, return_inverse=True)[1].reshape(-1)
        count = int(codes.max()) + 1
        if FEWEST_GROUPS <= count < len(left) // 2:
            summed = np.zeros((count, PARAMETERS))
            np.add.at(summed, codes, scores)
            widened = count / (count - 1) * len(left) / freedom * inverse @ (summed.T @ summed) @ inverse
            found.append(AxisScales(transform, widened[6:, 6:], count - 1))
    return max(found, key=lambda one: one.p_value)
