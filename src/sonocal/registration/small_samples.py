"""Covariances whose weights were estimated from the same few residuals."""

from __future__ import annotations

import numpy as np

from sonocal.geometry import Array

__all__ = ["small_sample_covariance"]

# The greatest variance of a number between -1 and 1 (Popoviciu).
GREATEST_VARIANCE = 1.0
# Residuals to spare below this leave the approximation without meaning.
LEAST_FREEDOM = 4.5


def small_sample_covariance(jacobian: Array, covariance: Array, by_level: Array) -> tuple[Array, float]:
    """The covariance of k parameters once the noise levels behind its weights are not taken for known.

    Weights from estimated levels fit the residuals better than true ones do: ``(J'J)^-1`` is too small, and
    Mahalanobis distances under it follow no F distribution of the residuals' freedom. With V the residuals'
    covariance, linear in the levels' squares, its derivatives give both a larger covariance and the freedom of
    the F distribution that fits the distances' mean and variance.

    Args:
        jacobian: (M, k), of residuals made independent and of unit variance.
        covariance: (k, k), ``(J'J)^-1``.
        by_level: (M, L): derivative of the log variance of each residual by the square of each estimated
            level; L = 0 where all are known.

    Returns:
        The covariance (k, k), in which e' C^-1 e / k is F of k and the second value's freedom.

    Source: Kenward and Roger 1997.
    """
    size = np.abs(by_level).max(axis=0, initial=0.0)
    levels = (by_level / np.where(size > 0, size, 1.0))[:, size > 0]
    count, parameters = levels.shape[1], len(covariance)
    if count == 0:
        return covariance, np.inf
    pulls = [jacobian.T @ (column[:, None] * jacobian) for column in levels.T]  # -P_i
    shares = [pull @ covariance for pull in pulls]
    information = np.empty((count, count))
    crosses = {}
    for i in range(count):
        for j in range(count):
            crosses[i, j] = jacobian.T @ ((levels[:, i] * levels[:, j])[:, None] * jacobian)  # Q_ij
            information[i, j] = 0.5 * (
                levels[:, i] @ levels[:, j]
                - 2.0 * np.trace(covariance @ crosses[i, j])
                + np.trace(shares[i] @ shares[j])
            )
    if count == 2:
        # Neither level is negative and both together make up the variance: their difference is within +-1 of it,
        # however little the residuals say of it.
        difference = levels.mean(axis=0) * [1.0, -1.0]
        information += np.outer(difference, difference) / GREATEST_VARIANCE
    spread = np.linalg.pinv(information, rcond=1e-10, hermitian=True)  # of the levels' squares
    wider = covariance.copy()
    first = second = 0.0
    for i in range(count):
        for j in range(count):
            hidden = crosses[i, j] - pulls[i] @ covariance @ pulls[j]
            wider += 2.0 * spread[i, j] * (covariance @ hidden @ covariance)
            first += spread[i, j] * np.trace(shares[i]) * np.trace(shares[j])
            second += spread[i, j] * np.trace(shares[i] @ shares[j])
    wider = 0.5 * (wider + wider.T)
    scale, freedom = _f_distribution(parameters, float(first), float(second))
    return wider / scale, freedom


def _f_distribution(size: int, first: float, second: float) -> tuple[float, float]:
    """The factor and m such that the factor times the Wald statistic is F of (size, m); for the source's A1 and A2."""
    spread = (first + 6.0 * second) / (2.0 * size)
    g = ((size + 1) * first - (size + 4) * second) / ((size + 2) * second)
    below = 3.0 * size + 2.0 * (1.0 - g)
    c1, c2, c3 = g / below, (size - g) / below, (size + 2 - g) / below
    mean = 1.0 / max(1.0 - second / size, 1e-3)
    variance = (2.0 / size) * (1.0 + c1 * spread) / ((1.0 - c2 * spread) ** 2 * max(1.0 - c3 * spread, 1e-3))
    ratio = variance / (2.0 * mean**2)
    freedom = 4.0 + (size + 2) / (size * ratio - 1.0) if size * ratio > 1.0 else np.inf
    freedom = max(freedom, LEAST_FREEDOM)
    return (freedom / (mean * (freedom - 2.0)) if np.isfinite(freedom) else 1.0 / mean), freedom
