"""Points beside their lines that one shift explains: the lines are there twice."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sonocal.geometry import Array

__all__ = ["Copy", "common_shift"]

TRIALS = 400
REFINEMENTS = 3
# Shifts that chance is measured with reach this many times as far as the one that was found.
REACH = 2.0
# The logarithm of a probability: below it what agrees does not do so by chance.
LOG_CHANCE = float(np.log(1e-3))
LEAST_GROUPS = 5


@dataclass(frozen=True, eq=False)
class Copy:
    """A shift, and what it explains.

    Attributes:
        shift: (k,), mm.
        explained: (M,): which displacements it explains.
        groups: how many groups they are of.
    """

    shift: Array
    explained: NDArray[np.bool_]
    groups: int


def common_shift(
    displaced: Array,
    by_shift: Array,
    groups: NDArray[np.int64],
    *,
    within_mm: float,
    among: int,
    seed: int = 0,
) -> Copy | None:
    """The shift that explains displacements of most groups, if it is no chance.

        displaced_i = by_shift_i shift

    Args:
        displaced: (M, e), mm: of points from where they should be.
        by_shift: (M, e, k): what a shift of 1 mm along each of k axes does to them.
        groups: (M,): of each sighting at most one displacement is explained.
        within_mm: how near explained is.
        among: how many groups there are, with those that have no displacement.
        seed: of the samples.

    Returns:
        None where none is, or where as many would be explained by chance.

    Source: random samples as in RANSAC; number of false alarms: Moisan and Stival 2004, with the chance measured.
    """
    if len(np.unique(groups)) < LEAST_GROUPS:
        return None
    rng = np.random.default_rng(seed)
    rank = by_shift.shape[2]
    each = 1 if np.linalg.matrix_rank(by_shift[0], tol=1e-6) == rank else 2
    samples = rng.integers(0, len(displaced), (TRIALS, each))
    trials = _solved(by_shift[samples].reshape(TRIALS, -1, rank), displaced[samples].reshape(TRIALS, -1))
    counts = np.array([_groups(displaced, by_shift, groups, one, within_mm) for one in trials])
    shift = trials[int(np.argmax(counts))]
    for _ in range(REFINEMENTS):
        near = _near(displaced, by_shift, shift, within_mm)
        if not near.any():
            return None
        shift = _solved(by_shift[near].reshape(1, -1, rank), displaced[near].reshape(1, -1))[0]
    explained = _near(displaced, by_shift, shift, within_mm)
    found = Copy(shift, explained, len(np.unique(groups[explained])))
    others = _elsewhere(rng, shift, trials.shape[1], within_mm)
    chance = np.mean([_groups(displaced, by_shift, groups, one, within_mm) for one in others])
    return (
        found if found.groups >= LEAST_GROUPS and _is_no_chance(found.groups, among, float(chance)) else None
    )


def _solved(by_shift: Array, displaced: Array) -> Array:
    """(T, k): least squares."""
    return np.asarray(np.einsum("tke,te->tk", np.linalg.pinv(by_shift), displaced))


def _near(displaced: Array, by_shift: Array, shift: Array, within_mm: float) -> NDArray[np.bool_]:
    left = displaced - by_shift @ shift
    return np.asarray(np.einsum("ne,ne->n", left, left) <= within_mm**2)


def _groups(
    displaced: Array, by_shift: Array, groups: NDArray[np.int64], shift: Array, within_mm: float
) -> int:
    return len(np.unique(groups[_near(displaced, by_shift, shift, within_mm)]))


def _elsewhere(rng: np.random.Generator, shift: Array, axes: int, within_mm: float) -> Array:
    """(T, k): shifts of about the same length that are not the one that was found."""
    length = max(float(np.linalg.norm(shift)), 4.0 * within_mm)
    drawn = rng.uniform(-REACH * length, REACH * length, (TRIALS, axes))
    return np.asarray(drawn[np.linalg.norm(drawn - shift, axis=1) > 2.0 * within_mm])


def _is_no_chance(count: int, among: int, by_chance: float) -> bool:
    """Whether so many of all groups would hardly be explained by the best of all shifts that were tried."""
    from scipy.special import bdtrc

    chance = (by_chance + 1.0) / (among + 2.0)
    tail = bdtrc(count - 2, among, min(chance, 1.0))
    return bool(tail == 0 or np.log(TRIALS) + np.log(tail) < LOG_CHANCE)
