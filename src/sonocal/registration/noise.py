"""How large the errors are, and which of them rows share."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sonocal import _core
from sonocal.geometry import Array, AxisScaled
from sonocal.registration.fit import Fit, away_from_lines
from sonocal.registration.rows import PointLineRows, to_core
from sonocal.registration.small_samples import small_sample_covariance

__all__ = ["Noise", "estimate_noise", "residual_vectors", "stretch_length"]

# A grouping whose offsets the fit takes up almost whole cannot be told from the calibration itself.
LEAST_SHARE_LEFT = 0.05
# Fewer frames say nothing of how they repeat one another; fewer stretches nothing of their variance.
FEWEST_FRAMES = 16
FEWEST_STRETCHES = 4


@dataclass(frozen=True)
class Noise:
    """Standard deviations per axis, and what they do to the tangent.

    Attributes:
        row_mm: of the distance to the line, from errors independent from row to row; NaN where no row is to
            spare.
        covariance: (k, k), of the tangent.
        freedom: as many residuals to spare would make a known weighting as sure as this covariance is.
        sigma_px: of an image point, px, where the weights are the likelihood's; else None.
        sigma_mm: of a segment's end point, mm; likewise.
        shared_mm: by grouping ("frame", "target", "stretch"), of an offset that all rows of a group share. A
            grouping that the data cannot tell from the rest is absent.
    """

    row_mm: float
    covariance: Array
    freedom: int
    sigma_px: float | None = None
    sigma_mm: float | None = None
    shared_mm: dict[str, float] = field(default_factory=dict)


def residual_vectors(transform: AxisScaled, points: Array, segments_mm: Array) -> Array:
    """(N, 3), mm: from each line to its mapped point, at right angles to the line."""
    return away_from_lines(transform.apply(points), segments_mm)


def estimate_noise(
    rows: PointLineRows,
    fit: Fit,
    groupings: dict[str, NDArray[Any]],
    *,
    known_px: bool = False,
    known_mm: bool = False,
) -> Noise:
    """Noise of the rows and of their groups, and the tangent's covariance under it.

    A wire that is 0.3 mm off is off in every frame: hundreds of rows on nine wires are nearer to nine
    measurements than to hundreds. With residuals made independent and of unit variance under the fit's
    weights, each is taken as the sum of its own noise and of one offset for each group that it is in,

        r = J d + e + sum_g B_g b_g

    and the variances of e and b_g are those that make the sums of squares, total and between groups, equal
    to their expectations after the fit has taken its part (analysis of variance with the fit's 7 or 8
    parameters as covariates).

    Args:
        rows: points and lines.
        fit: of which only the agreeing rows count.
        groupings: by name: (N,) the group of each row.
        known_px: the image points' noise level was given. Residuals smaller than two given levels say do not
            shrink the covariance; levels estimated from the same residuals make it larger and less sure.
        known_mm: the segments' noise level was given; likewise.

    Returns:
        The noise and the covariance.

    Source: Henderson's method 3 (Searle, Casella and McCulloch, Variance Components, 1992, chapter 5).
    """
    k = len(fit.covariance)
    freedom = 2 * int(fit.inlier.sum()) - k
    weighted = fit.weighting == "likelihood"
    sigma_px, sigma_mm = (fit.sigma_px, fit.sigma_mm) if weighted else (None, None)
    if freedom <= 0:
        return Noise(np.nan, np.full((k, k), np.nan), 0, sigma_px, sigma_mm)
    white = _core.white_residuals(
        rows.core, fit.inlier, to_core(fit.transform), fit.options.to_core(fit.sigma_px, fit.sigma_mm)
    )
    jacobian, shift, by_level = white.jacobian, white.shift, white.by_level
    residual, sample_row = white.white, white.row
    total = float(residual @ residual)
    candidates = {name: _distinct(labels[sample_row]) for name, labels in groupings.items()}
    # With the likelihood's weights, what the points of one sighting share is in the weights already.
    units = len(np.unique(sample_row)) if weighted else len(residual) // 2
    groups = {
        name: _Grouping(labels, jacobian, shift, residual, fit.covariance)
        for name, labels in candidates.items()
        if 1 < labels.max() + 1 < units
    }
    groups = {name: g for name, g in groups.items() if g.left.sum() > LEAST_SHARE_LEFT * g.weight.sum()}
    unit, shared = _variances(total, freedom, groups)
    if weighted and known_px and known_mm:
        unit, of_levels = max(unit, 1.0), by_level[:, :0]
    elif weighted:
        of_levels = by_level[:, [not known_px, not known_mm]]
    else:
        of_levels = np.ones((len(residual), 1))
    base, sure = small_sample_covariance(jacobian, fit.covariance, of_levels)
    covariance = unit * base
    for name, variance in shared.items():
        pulled = fit.covariance @ groups[name].pull
        covariance = covariance + variance * (pulled @ pulled.T)
    squares = float(np.sum(fit.residuals_mm[fit.inlier] ** 2)) / freedom
    row_mm = float(np.sqrt(squares * unit * freedom / total)) if total > 0 else 0.0
    shared_mm = {name: float(np.sqrt(variance)) for name, variance in shared.items()}
    return Noise(row_mm, covariance, int(min(freedom, sure)), sigma_px, sigma_mm, shared_mm)


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
    if frames < FEWEST_FRAMES:
        return 1
    means = np.stack([np.bincount(frame, column) / counts for column in residuals.T], axis=1)
    means -= means.mean(axis=0)
    power = float(np.sum(means**2))
    if power == 0:
        return 1
    # Three vector components make chance correlations of some 1 / sqrt(2 frames).
    insignificant = 3.0 / np.sqrt(2.0 * frames)
    length = 1.0
    for lag in range(1, frames // 2):
        correlation = float(np.sum(means[lag:] * means[:-lag])) / power
        if correlation < insignificant:
            break
        length += 2.0 * correlation
    return int(min(np.ceil(length), frames // FEWEST_STRETCHES))


class _Grouping:
    """The sums over each group that the moments need.

    With B the (M x 3G) map from the groups' offsets to white residuals, P = I - J C J' what the fit leaves
    of them and C = (J'J)^-1: ``pull`` is J'B, ``weight`` and ``left`` the traces of the blocks of B'B and B'PB.
    """

    def __init__(
        self, labels: NDArray[np.int64], jacobian: Array, shift: Array, residual: Array, covariance: Array
    ) -> None:
        self.labels, self.shift, self.covariance = labels, shift, covariance
        self.pulls = _sum_by(labels, jacobian[:, :, None] * shift[:, None, :])  # (G, k, 3)
        self.pull = np.concatenate(list(self.pulls), axis=1)  # (k, 3G)
        self.weight = _sum_by(labels, np.sum(shift**2, axis=1))
        self.left = self.weight - np.einsum("gki,kl,gli->g", self.pulls, covariance, self.pulls)
        self.between = float(np.sum(_sum_by(labels, shift * residual[:, None]) ** 2 / self.weight[:, None]))

    def expected_between(self, other: _Grouping) -> float:
        """Expected sum of squares between these groups from unit offsets of the other's groups.

        sum_t |block row t of B'P B_other|^2 / weight_t, with P B_other = B_other - J C J' B_other: blocks
        where both groups have rows are computed one by one, the rest only through k x k products.
        """
        cells, index = np.unique(np.stack([self.labels, other.labels]), axis=1, return_inverse=True)
        common = _sum_by(index.reshape(-1), self.shift[:, :, None] * self.shift[:, None, :])
        mine, theirs = self.pulls[cells[0]], other.pulls[cells[1]]
        taken = np.einsum("cki,kl,clj->cij", mine, self.covariance, theirs)
        at_cells = np.sum(common**2 - 2.0 * common * taken, axis=(1, 2))
        spread = self.covariance @ other.pull @ other.pull.T @ self.covariance
        everywhere = np.einsum("gki,kl,gli->g", self.pulls, spread, self.pulls)
        return float(np.sum(at_cells / self.weight[cells[0]]) + np.sum(everywhere / self.weight))


def _sum_by(labels: NDArray[np.int64], values: Array) -> Array:
    flat = values.reshape(len(values), -1)
    sums = np.stack([np.bincount(labels, column) for column in flat.T], axis=1)
    return np.asarray(sums, dtype=float).reshape(-1, *values.shape[1:])


def _distinct(labels: NDArray[np.int64]) -> NDArray[np.int64]:
    return np.asarray(np.unique(labels, return_inverse=True)[1].reshape(-1), dtype=np.int64)


def _variances(total: float, freedom: int, groups: dict[str, _Grouping]) -> tuple[float, dict[str, float]]:
    """Unit and group variances that match the observed sums of squares; negative ones count as none."""
    names = list(groups)
    while names:
        chosen = [groups[name] for name in names]
        expected = np.array(
            [[float(freedom)] + [g.left.sum() for g in chosen]]
            + [[np.sum(h.left / h.weight)] + [h.expected_between(g) for g in chosen] for h in chosen]
        )
        # Columns have unlike units: without this, a cut-off of small singular values would depend on them.
        size = np.abs(expected).max(axis=0)
        solved = (
            np.linalg.lstsq(expected / size, np.array([total] + [g.between for g in chosen]), rcond=1e-9)[0]
            / size
        )
        if np.all(solved[1:] >= 0):
            return max(float(solved[0]), 0.0), dict(zip(names, map(float, solved[1:]), strict=True))
        names.pop(int(np.argmin(solved[1:] * size[1:])))
    return total / freedom, {}
