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
    """The rows' sums, and what is done with them."""

    def __init__(self, residuals: Array, motions: Array, rigid: Array, groups: NDArray[np.int64]) -> None:
        self._r = residuals
        self._groups, self._count = groups, int(groups.max()) + 1
        self._k = motions.shape[2]
        both = np.concatenate([motions, rigid], axis=2)
        self._both = both / np.maximum(np.sqrt(np.sum(both**2, axis=(0, 1))), TINY)

    def starts(self) -> list[Array]:
        """Shares (G,) that part the groups along the motions which pull them most."""
        pulled = np.zeros((self._count, 6))
        np.add.at(pulled, self._groups, np.einsum("nek,ne->nk", self._both[:, :, self._k :], self._r))
        axes = np.linalg.eigh(pulled.T @ pulled)[1].T[::-1][:STARTS]
        return [np.where(pulled @ axis > 0, 0.9, 0.1) for axis in axes]

    def risen(self, shares: Array, rounds: int) -> tuple[float, Array, Array, Array]:
        """Log likelihood, shares (G,), rows without and by the motion (N, 2), after so many rounds."""
        for _ in range(rounds):
            base, moved = self._solved(shares[self._groups])
            off = [self._sums(base**2), self._sums((base - moved) ** 2)]
            part = np.clip(shares.mean(), LEAST_SHARE, 1.0 - LEAST_SHARE)
            variance = max(float((1.0 - shares) @ off[0] + shares @ off[1]) / self._r.size, TINY)
            logs = [np.log(p) - 0.5 * x / variance for p, x in zip((1.0 - part, part), off, strict=True)]
            total = np.logaddexp(*logs)
            shares = np.exp(logs[1] - total)
        return float(total.sum()) - 0.5 * self._r.size * float(np.log(variance)), shares, base, moved

    def _solved(self, share: Array) -> tuple[Array, Array]:
        """Least squares with each row's share of being off."""
        k = self._k
        weighed = self._both.copy()
        weighed[:, :, k:] *= share[:, None, None]
        flat, unsure = weighed.reshape(-1, k + 6), np.sqrt(share * (1.0 - share))[:, None, None]
        left = (self._both[:, :, k:] * unsure).reshape(-1, 6)
        normal = flat.T @ flat
        normal[k:, k:] += left.T @ left
        solved = np.linalg.lstsq(normal, flat.T @ self._r.reshape(-1), rcond=1e-10)[0]
        return self._r - self._both[:, :, :k] @ solved[:k], self._both[:, :, k:] @ solved[k:]

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
