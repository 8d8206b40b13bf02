"""Residuals of which some are off by one rigid motion of the lines: two definitions of a marker, used by turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = ["TwoMotions", "two_motions"]

# Directions that a first guess parts the rows along, and rounds of expectation and maximisation.
STARTS, FIRST_ROUNDS, ROUNDS = 3, 6, 30
LEAST_SHARE = 0.15
# Of the variance that one motion has if every group has a share of its own of it, to the rows': what is tried.
RATIOS = np.concatenate([[0.0], np.logspace(-3, 3, 40)])
TINY = float(np.finfo(float).tiny)
# Of columns of unit length.
RIDGE = 1e-10


@dataclass(frozen=True, eq=False)
class TwoMotions:
    """What parts the groups in two.

    Attributes:
        gain: how much likelier, as a logarithm, two lumps are than as wide a spread of the same motion about one.
        moved: (N, 2), mm: what the motion does to each row.
        second: (G,), of each group: how likely it is off by it.
    """

    gain: float
    moved: Array
    second: Array


def two_motions(residuals: Array, motions: Array, rigid: Array, groups: NDArray[np.int64]) -> TwoMotions:
    """The motion that part of the groups is off by, and how much likelier that makes the residuals.

        r_i = motions_i m + rigid_i g z_i + e_i        z_i: 0 or 1, of a group alike

    It is measured against z_i normal: any one motion that varies, as noise, drift and errors along one axis make it,
    is that likely, and two lumps with little in between are not.

    Args:
        residuals: (N, 2), mm, across the lines.
        motions: (N, 2, k): what the transform's motions do to them.
        rigid: (N, 2, 6): what a rigid motion of the lines does to them.
        groups: (N,), counted from 0: of rows that are on the same side.

    Source: expectation and maximisation (Dempster, Laird and Rubin 1977), a likelihood ratio of two models with as
        many parameters.
    """
    mixture = _Mixture(residuals, motions, rigid, groups)
    tried = [mixture.risen(start, FIRST_ROUNDS) for start in mixture.starts()]
    second = mixture.risen(max(tried, key=lambda one: one[0])[1], ROUNDS)
    likelihood, shares, base, moved = second
    return TwoMotions(likelihood - mixture.spread(base, moved), moved, shares)


class _Mixture:
    """The rows' sums, and what is done with them.

    Rows of a group share its weight, so that all of a round is in the products of a group's columns with one another.
    """

    def __init__(self, residuals: Array, motions: Array, rigid: Array, groups: NDArray[np.int64]) -> None:
        self._r = residuals
        self._groups, self._count = groups, int(groups.max()) + 1
        self._k = motions.shape[2]
        both = np.concatenate([motions, rigid], axis=2)
        self._both = both / np.maximum(np.sqrt(np.sum(both**2, axis=(0, 1))), TINY)
        moments = self._moments_of(np.concatenate([self._both, residuals[:, :, None]], axis=2))
        self._pulled, self._size = moments[:, self._k : -1, -1], moments.shape[1]
        self._flat = moments.reshape(self._count, -1)
        self._all = moments.sum(axis=0)

    def _moments_of(self, columns: Array) -> Array:
        """(G, K, K): of each group, products of the columns (N, 2, K) with one another."""
        order = np.argsort(self._groups, kind="stable")
        first = np.searchsorted(self._groups[order], np.arange(self._count))
        columns = columns[order]
        products = [np.einsum("ne,nek->nk", columns[:, :, one], columns) for one in range(columns.shape[2])]
        return np.stack([np.add.reduceat(one, first, axis=0) for one in products], axis=1)

    def starts(self) -> list[Array]:
        """Shares (G,) that part the groups along the motions which pull them most."""
        axes = np.linalg.eigh(self._pulled.T @ self._pulled)[1].T[::-1][:STARTS]
        return [np.where(self._pulled @ axis > 0, 0.9, 0.1) for axis in axes]

    def risen(self, shares: Array, rounds: int) -> tuple[float, Array, Array, Array]:
        """Log likelihood, shares (G,), rows without and by the motion (N, 2), after so many rounds."""
        for _ in range(rounds):
            solved = self._solved(shares)
            off = self._squares(solved)
            part = np.clip(shares.mean(), LEAST_SHARE, 1.0 - LEAST_SHARE)
            variance = max(float((1.0 - shares) @ off[0] + shares @ off[1]) / self._r.size, TINY)
            logs = [np.log(p) - 0.5 * x / variance for p, x in zip((1.0 - part, part), off, strict=True)]
            total = np.logaddexp(*logs)
            shares = np.exp(logs[1] - total)
        k, likelihood = self._k, float(total.sum()) - 0.5 * self._r.size * float(np.log(variance))
        base, moved = self._r - self._both[:, :, :k] @ solved[:k], self._both[:, :, k:] @ solved[k:]
        return likelihood, shares, base, moved

    def _solved(self, shares: Array) -> Array:
        """(k + 6,): least squares with each group's share of being off."""
        k = self._k
        # A share that is not sure counts for the motion's squares as a whole one would: E[z^2] = E[z].
        weighed = (shares @ self._flat).reshape(self._size, self._size)
        weighed[:k, :k], weighed[:k, -1] = self._all[:k, :k], self._all[:k, -1]
        # Of equal shares the motion does what the transform's motions do.
        weighed[np.diag_indices(self._size - 1)] += RIDGE
        return np.asarray(np.linalg.solve(weighed[:-1, :-1], weighed[:-1, -1]))

    def _squares(self, solved: Array) -> list[Array]:
        """Of each group (G,), the squares that are left of its rows without the motion and with it."""
        with_motion = np.append(-solved, 1.0)
        without = with_motion.copy()
        without[self._k : -1] = 0.0
        return [np.maximum(self._flat @ np.outer(one, one).ravel(), 0.0) for one in (without, with_motion)]

    def _sums(self, values: Array) -> Array:
        return np.asarray(np.bincount(self._groups, values.sum(axis=1), self._count), dtype=float)

    def spread(self, base: Array, moved: Array) -> float:
        """Log likelihood if each group had its own share of the motion, from one normal distribution."""
        lengths, along, squares = self._sums(moved**2), self._sums(base * moved), self._sums(base**2)
        shrunk = 1.0 / (1.0 + RATIOS[:, None] * lengths)
        mean = (shrunk @ along / np.maximum(shrunk @ lengths, TINY))[:, None]
        left = along - mean * lengths
        own = squares - 2.0 * mean * along + mean**2 * lengths - RATIOS[:, None] * shrunk * left**2
        size = self._r.size
        variance = np.maximum(own.sum(axis=1) / size, TINY)
        return float(np.max(0.5 * np.log(shrunk).sum(axis=1) - 0.5 * size * (np.log(variance) + 1.0)))
