"""How large the errors are, and which of them rows share."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array, AxisScaled, segment_directions
from sonocal.registration.uncertainty import point_jacobian

__all__ = ["Noise", "estimate_noise", "residual_vectors", "stretch_length"]

# A grouping whose offsets the fit takes up almost whole cannot be told from the calibration itself.
LEAST_SHARE_LEFT = 0.05
# Fewer frames say nothing of how they repeat one another; fewer stretches nothing of their variance.
FEWEST_FRAMES = 16
FEWEST_STRETCHES = 4


@dataclass(frozen=True)
class Noise:
    """Standard deviations in mm, per axis, and what they do to the tangent.

    Attributes:
        row_mm: of errors independent from row to row; NaN where no row is to spare.
        shared_mm: by grouping ("frame", "target"), of an offset that all rows of a group share. A
            grouping that the data cannot tell from the rest is absent.
        covariance: (k, k), of the tangent.
    """

    row_mm: float
    covariance: Array
    shared_mm: dict[str, float] = field(default_factory=dict)


def residual_vectors(transform: AxisScaled, points: Array, segments_mm: Array) -> Array:
    """(N, 3), mm: from each line to its mapped point, at right angles to the line."""
    directions = segment_directions(segments_mm)
    away = transform.apply(points) - segments_mm[:, 0]
    return np.asarray(away - np.sum(away * directions, axis=1, keepdims=True) * directions)


def estimate_noise(
    transform: AxisScaled,
    points: Array,
    segments_mm: Array,
    unit_covariance: Array,
    groupings: dict[str, NDArray[np.int64]],
) -> Noise:
    """Noise of the rows and of their groups, and the tangent's covariance under it.

    A wire that is 0.3 mm off is off in every frame: hundreds of rows on nine wires are nearer to nine
    measurements than to hundreds. The residual of a row is taken as the sum of its own noise and of one
    offset for each group that it is in,

        r_i = J_i d + P_i (e_i + sum_g b_g(i)),        P_i = I - direction direction'

    and the variances are those that make the sums of squares, total and between groups, equal to their
    expectations after the fit has taken its part (analysis of variance with the fit's 7 or 8
    parameters as covariates).

    Args:
        transform: the fit.
        points: (N, 3), px, of the rows that agree.
        segments_mm: (N, 2, 3).
        unit_covariance: (k, k): ``(J'J)^-1`` over these rows.
        groupings: by name: (N,) the group of each row, counted from 0 without a gap.

    Returns:
        The noise and the covariance.

    Source: Henderson's method 3 (Searle, Casella and McCulloch, Variance Components, 1992, chapter 5).
    """
    k = len(unit_covariance)
    freedom = 2 * len(points) - k
    if freedom <= 0:
        return Noise(np.nan, np.full((k, k), np.nan))
    directions = segment_directions(segments_mm)
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    residuals = residual_vectors(transform, points, segments_mm)
    weighted = np.swapaxes(point_jacobian(transform, points, k), 1, 2) @ across
    candidates = {
        name: _Grouping(labels, across, weighted, residuals, unit_covariance)
        for name, labels in groupings.items()
        if 1 < labels.max() + 1 < len(labels)
    }
    groups = {name: g for name, g in candidates.items() if g.left.sum() > LEAST_SHARE_LEFT * 2 * len(points)}
    row, shared = _variances(float(np.sum(residuals**2)), freedom, groups, across, unit_covariance)
    covariance = row * unit_covariance
    for name, variance in shared.items():
        pulled = unit_covariance @ groups[name].pull
        covariance = covariance + variance * (pulled @ pulled.T)
    return Noise(float(np.sqrt(row)), covariance, {name: float(np.sqrt(v)) for name, v in shared.items()})


def stretch_length(residuals: Array, frame: NDArray[np.int64]) -> int:
    """Over how many consecutive frames the frames' mean residuals repeat one another.

    Twice the sum of the positive autocorrelations up to the first that noise could give, plus one: the
    number of frames that carry as much information as one independent frame.

    Args:
        residuals: (N, 3), mm.
        frame: (N,): the frame of each row, counted from 0 in the order of time.

    Returns:
        Frames; 1 where neighbouring frames have nothing in common.

    Source: integrated autocorrelation time (Sokal 1997, section 3).
    """
    counts = np.bincount(frame)
    frames = len(counts)
    means = np.stack([np.bincount(frame, column) / counts for column in residuals.T], axis=1)
    means -= means.mean(axis=0)
    power = float(np.sum(means**2))
    if frames < FEWEST_FRAMES or power == 0:
        return 1
    insignificant = 2.0 / np.sqrt(frames)
    length = 1.0
    for lag in range(1, frames // 2):
        correlation = float(np.sum(means[lag:] * means[:-lag])) / power
        if correlation < insignificant:
            break
        length += 2.0 * correlation
    return int(min(np.ceil(length), frames // FEWEST_STRETCHES))


class _Grouping:
    """The sums over each group that the moments need.

    With B the (3N x 3G) map from the groups' offsets to residuals, M = I - J H J' what the fit leaves
    of them and H = (J'J)^-1: ``pull`` is J'B, ``left`` the traces of the blocks of B'MB.
    """

    def __init__(
        self,
        labels: NDArray[np.int64],
        across: Array,
        weighted: Array,
        residuals: Array,
        unit_covariance: Array,
    ) -> None:
        self.labels = labels
        self.counts = np.bincount(labels)
        self.pulls = _sum_by(self.labels, weighted)  # (G, k, 3)
        self.pull = np.concatenate(list(self.pulls), axis=1)  # (k, 3G)
        taken = np.einsum("gki,kl,gli->g", self.pulls, unit_covariance, self.pulls)
        self.left = np.trace(_sum_by(self.labels, across), axis1=1, axis2=2) - taken
        self.between = float(np.sum(_sum_by(self.labels, residuals) ** 2 / self.counts[:, None]))

    def expected_between(self, other: _Grouping, across: Array, unit_covariance: Array) -> float:
        """Expected sum of squares between these groups from unit offsets of the other's groups.

        sum_t |block row t of B'M B_other|^2 / n_t, with M B_other = B_other - J H J' B_other: blocks
        where both groups have rows are computed one by one, the rest only through k x k products.
        """
        cells, index = np.unique(np.stack([self.labels, other.labels]), axis=1, return_inverse=True)
        common = _sum_by(index.reshape(-1), across)
        mine, theirs = self.pulls[cells[0]], other.pulls[cells[1]]
        taken = np.einsum("cki,kl,clj->cij", mine, unit_covariance, theirs)
        at_cells = np.sum(common**2 - 2.0 * common * taken, axis=(1, 2))
        spread = unit_covariance @ other.pull @ other.pull.T @ unit_covariance
        everywhere = np.einsum("gki,kl,gli->g", self.pulls, spread, self.pulls)
        return float(np.sum(at_cells / self.counts[cells[0]]) + np.sum(everywhere / self.counts))


def _sum_by(labels: NDArray[np.int64], values: Array) -> Array:
    flat = values.reshape(len(values), -1)
    sums = np.stack([np.bincount(labels, column) for column in flat.T], axis=1)
    return np.asarray(sums, dtype=float).reshape(-1, *values.shape[1:])


def _variances(
    total: float, freedom: int, groups: dict[str, _Grouping], across: Array, unit_covariance: Array
) -> tuple[float, dict[str, float]]:
    """Row and group variances that match the observed sums of squares; negative ones count as none."""
    names = list(groups)
    while names:
        chosen = [groups[name] for name in names]
        expected = np.array(
            [[float(freedom)] + [g.left.sum() for g in chosen]]
            + [
                [np.sum(h.left / h.counts)] + [h.expected_between(g, across, unit_covariance) for g in chosen]
                for h in chosen
            ]
        )
        solved = np.linalg.lstsq(expected, np.array([total] + [g.between for g in chosen]), rcond=1e-9)[0]
        if np.all(solved >= 0):
            return float(solved[0]), dict(zip(names, map(float, solved[1:]), strict=True))
        if solved[0] < 0 and np.all(solved[1:] >= 0):
            return 0.0, dict(zip(names, map(float, solved[1:]), strict=True))
        names.pop(int(np.argmin(solved[1:])))
    return total / freedom, {}
